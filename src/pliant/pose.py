"""Poses in the task frame: where the wrist's hinge point is, and which axes a goal speaks of.

The task frame has its origin at the nominal hole's centre on the board's surface, z up. The side
camera stands at +x and looks along -x, so +y is right in its picture. Lengths are metres, angles
radians. Positive roll (right-hand about +x) leans the tool's top to -y, Table I's "left".
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Axis(StrEnum):
    """One axis of a pose: x, y, z [m]; roll, pitch, yaw [rad]."""

    X = "x"
    Y = "y"
    Z = "z"
    ROLL = "roll"
    PITCH = "pitch"
    YAW = "yaw"

    @property
    def is_angle(self) -> bool:
        return self in (Axis.ROLL, Axis.PITCH, Axis.YAW)

    @property
    def report_unit(self) -> str:
        """The unit used at the command line, in prompts and in reports."""
        return "deg" if self.is_angle else "mm"

    def to_report(self, value: float) -> float:
        """Convert an SI value to millimetres or degrees."""
        return math.degrees(value) if self.is_angle else value * 1e3

    def from_report(self, value: float) -> float:
        """Convert millimetres or degrees to SI."""
        return math.radians(value) if self.is_angle else value * 1e-3


_AXES = tuple(Axis)

Partial = Mapping[Axis, float]
"""Some axes of a pose, each in SI units: a goal names only the axes its formation owns."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Pose of the wrist's hinge point with the wrist unsprung: x, y, z [m], roll, pitch, yaw [rad].

    The rotation is Rz(yaw) Ry(pitch) Rx(roll); all zero, the tool hangs straight down.

    Raises:
        ValueError: a component is not finite.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        values = (self.x, self.y, self.z, self.roll, self.pitch, self.yaw)
        for axis, value in zip(_AXES, values, strict=True):
            if not math.isfinite(value):
                raise ValueError(f"pose {axis} is {value}: it must be a finite number")

    def __getitem__(self, axis: Axis) -> float:
        return float(getattr(self, axis))

    def updated(self, goal: Partial) -> "Pose":
        """This pose with the axes that `goal` names replaced."""
        return replace(self, **{axis.value: float(value) for axis, value in goal.items()})

    def error(self, other: "Pose", axes: Iterable[Axis]) -> dict[Axis, float]:
        """The difference `other - self` on the given axes, angles wrapped to (-pi, pi]."""
        return {
            axis: math.remainder(other[axis] - self[axis], math.tau)
            if axis.is_angle
            else other[axis] - self[axis]
            for axis in axes
        }

    def distance_to(self, other: "Pose") -> float:
        """The distance between two positions [m]."""
        return float(np.linalg.norm(self.position() - other.position()))

    def turn_to(self, other: "Pose") -> float:
        """The angle of the one turn that brings this orientation to the other [rad]."""
        cosine = (float(np.trace(self.rotation().T @ other.rotation())) - 1.0) / 2.0
        return math.acos(max(-1.0, min(1.0, cosine)))

    def position(self) -> NDArray[np.float64]:  # (3,) [m]
        """The position x, y, z (3,) [m]."""
        return np.array([self.x, self.y, self.z])

    def rotation(self) -> NDArray[np.float64]:  # (3, 3)
        """The tool's axes as columns in the task frame (3, 3)."""
        return rotation_matrix(self.roll, self.pitch, self.yaw)


def rotation_matrix(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:  # (3, 3)
    """The rotation matrix (3, 3) Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_from(position: NDArray[np.float64], rotation: NDArray[np.float64]) -> Pose:
    """Pose of a frame at `position` (3,) [m] with `rotation` (3, 3); the inverse of `rotation`."""
    roll, pitch, yaw = angles_from(rotation)
    x, y, z = (float(v) for v in position)
    return Pose(x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=yaw)


def angles_from(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """The angles (roll, pitch, yaw) [rad] of a rotation matrix (3, 3), for |pitch| < pi/2."""
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    pitch = -math.asin(max(-1.0, min(1.0, float(rotation[2, 0]))))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    return roll, pitch, yaw


def describe(goal: Partial) -> str:
    """A goal in words for a person: "y -35.0 mm, roll 10.0 deg"."""
    return ", ".join(f"{a} {a.to_report(v):.1f} {a.report_unit}" for a, v in goal.items())
