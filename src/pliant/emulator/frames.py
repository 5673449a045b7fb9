"""Rigid transforms (4, 4), and poses as the controller writes them: x, y, z [m] and a rotation
vector [rad]."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def transform(pose: Sequence[float] | Array) -> Array:  # (4, 4)
    """The transform of a pose (6,)."""
    result = np.eye(4)
    result[:3, :3] = rotation(np.asarray(pose[3:], dtype=float))
    result[:3, 3] = pose[:3]
    return result


def placed(position: Array, matrix: Array) -> Array:  # (4, 4)
    """The transform with a position (3,) and a rotation matrix (3, 3)."""
    result = np.eye(4)
    result[:3, :3] = matrix
    result[:3, 3] = position
    return result


def pose(t: Array) -> tuple[float, ...]:
    """The pose (6,) of a transform."""
    return (*t[:3, 3].tolist(), *rotation_vector(t[:3, :3]).tolist())


def inverse(t: Array) -> Array:  # (4, 4)
    result = np.eye(4)
    result[:3, :3] = t[:3, :3].T
    result[:3, 3] = -t[:3, :3].T @ t[:3, 3]
    return result


def cross(a: Array, b: Array) -> Array:  # (3,)
    """The vector product; NumPy's own takes many times as long for one pair."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def rotation_vector(matrix: Array) -> Array:  # (3,) [rad], at most half a turn long
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(matrix).ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def rotation(vector: Array) -> Array:  # (3, 3)
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    quaternion, matrix = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
