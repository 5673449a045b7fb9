"""Rigid transforms (4, 4), and poses as the controller writes them: x, y, z [m] and a rotation
vector [rad]."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pliant.sim.arm import rotation, rotation_vector
from pliant.ur5e.configuration import placed

Array = NDArray[np.float64]


def transform(pose: Sequence[float] | Array) -> Array:  # (4, 4)
    """The transform of a pose (6,)."""
    return placed(pose[:3], rotation(np.asarray(pose[3:], dtype=float)))


def pose(t: Array) -> tuple[float, ...]:
    """The pose (6,) of a transform."""
    return (*t[:3, 3].tolist(), *rotation_vector(t[:3, :3]).tolist())


def inverse(t: Array) -> Array:  # (4, 4)
    return placed(-t[:3, :3].T @ t[:3, 3], t[:3, :3].T)


def cross(a: Array, b: Array) -> Array:  # (3,)
    """The vector product; NumPy's own takes many times as long for one pair."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
