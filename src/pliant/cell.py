"""The cell as the method sees it: a robot that moves, waits and observes.

`Robot` is everything a skill or a reasoner can reach; the simulated and the real cell implement the
same six calls. `Workcell` prepares trials and knows the truth: only experiments hold one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from types import TracebackType
from typing import Annotated, Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator

from pliant.conditions import Setup
from pliant.pose import Axis, Partial, Pose
from pliant.task import Task
from pliant.wrist import SensorAnswer

HOME_ABOVE_BOARD = 0.06  # [m] of the peg's tip, before a trial


def _array_from(value: Any) -> NDArray[np.float64]:
    try:
        return np.asarray(value, dtype=np.float64)
    except TypeError as error:
        raise ValueError("it must be nested lists of numbers") from error


def _array_to(value: NDArray[np.float64]) -> list[Any]:
    return [float(f"{v:.6g}") for v in value] if value.ndim == 1 else [_array_to(v) for v in value]


Array = Annotated[NDArray[np.float64], PlainValidator(_array_from), PlainSerializer(_array_to)]
"""A numeric array that is stored as nested lists, to six significant digits."""


def _image_from(value: Any, info: Any) -> NDArray[np.uint8]:
    if isinstance(value, np.ndarray):
        return value
    return info.context.load(value)


def _image_to(value: NDArray[np.uint8], info: Any) -> Any:
    return info.context.save(value)


Image = Annotated[NDArray[np.uint8], PlainValidator(_image_from), PlainSerializer(_image_to)]
"""A picture (height, width, 3), RGB. Stored by hash through the store's picture folder."""


class Stop(StrEnum):
    """The reason why a motion ended. Robots tell the first two; a skill knows which of its limits
    was meant to be met."""

    REACHED = "reached"
    COMPRESSION = "compression"
    TOUCH = "touch"  # a guarded motion that was to end at a compression below the limit, and did

    @property
    def is_early(self) -> bool:
        return self is not Stop.REACHED


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The measurements along a motion, for plots: one row per sample."""

    time_s: Array  # (n,) robot clock
    pose: Array  # (n, 6) x, y, z [m], roll, pitch, yaw [rad]
    compression_m: Array  # (n,) from free hang


class Samples:
    """A trace while it is being taken."""

    def __init__(self) -> None:
        self.times_s: list[float] = []
        self._poses: list[list[float]] = []
        self._compressions_m: list[float] = []

    def take(self, time_s: float, pose: Pose, compression_m: float) -> None:
        self.times_s.append(time_s)
        self._poses.append([pose[axis] for axis in Axis])
        self._compressions_m.append(compression_m)

    def trace(self) -> Trace:
        return Trace(
            time_s=np.array(self.times_s),
            pose=np.array(self._poses),
            compression_m=np.array(self._compressions_m),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One straight motion: the pose asked for, the one commanded, and where it ended."""

    requested: Pose
    commanded: Pose  # after the envelope
    ended: Pose  # measured
    stop: Stop
    peak_compression_m: float
    started_s: float
    ended_s: float
    trace: Trace = field(repr=False)
    answer: SensorAnswer | None = None  # of the wrist's reading, where the motion pressed it

    @property
    def off(self) -> tuple[float, float]:
        """The distance [m] and the angle [rad] from where it was sent to where it ended."""
        return self.commanded.distance_to(self.ended), self.commanded.turn_to(self.ended)


def outside(low: Pose, high: Pose, goal: Partial, workspace: str = "the workspace") -> str | None:
    """The reason why a goal lies outside a workspace from `low` to `high`, or None."""
    for axis, value in goal.items():
        if not low[axis] <= value <= high[axis]:
            least, most = axis.to_report(low[axis]), axis.to_report(high[axis])
            return (
                f"{axis} {axis.to_report(value):.1f} {axis.report_unit} is outside {workspace},"
                f" {least:.1f} to {most:.1f} {axis.report_unit}"
            )
    return None


def missed(off_m: float, turn: float) -> str:
    """Say that a motion ended so far [m, rad] from where it was sent."""
    return f"a motion ended {off_m * 1e3:.1f} mm and {math.degrees(turn):.1f} deg from its goal"


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A pinhole camera without distortion, calibrated to the task frame.

    `rotation` (3, 3) holds the camera's axes as columns in the task frame: x right, y down, z
    forward. `focal_px` is the focal length, the principal point is the picture's centre.
    """

    name: str
    width: int
    height: int
    focal_px: float
    position: Array  # (3,) [m]
    rotation: Array  # (3, 3)

    def project(self, point: NDArray[np.float64]) -> tuple[float, float]:
        """Pixel (column, row) of a point (3,) [m] in the task frame."""
        right, down, forward = (np.asarray(point) - self.position) @ self.rotation
        scale = self.focal_px / forward
        return float(self.width / 2 + right * scale), float(self.height / 2 + down * scale)

    def on_plane_x(self, u: float, v: float, x: float) -> tuple[float, float]:
        """The point (y, z) [m] where the ray through pixel (u, v) meets the plane at `x` [m]."""
        ray = self.rotation @ np.array(
            [(u - self.width / 2) / self.focal_px, (v - self.height / 2) / self.focal_px, 1.0]
        )
        point = self.position + ray * (x - self.position[0]) / ray[0]
        return float(point[1]), float(point[2])

    def metres_per_pixel(self, x: float) -> float:
        """Size of a pixel on the plane at `x` [m], for a camera that looks along x."""
        return float(abs(self.position[0] - x) / self.focal_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A picture, when it was taken on the robot's clock, and the camera that took it."""

    camera: Camera
    time_s: float
    image: Image = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """An observation of the cell: measured pose, compression from free hang, with the standard
    deviation that the readings' noise leaves in it, pictures."""

    time_s: float
    pose: Pose
    compression_m: float
    views: Mapping[str, View]
    compression_sd_m: float = 0.0


class Robot(Protocol):
    """The arm with its soft wrist, gripper and cameras. Any call may raise RobotFault."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...
    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        """Move the hinge point in a straight line in the task frame; end at once, as a result, when
        the wrist is pressed past the limit (Sec. V-A, "Compression limit")."""
        ...

    def settle(self, seconds: float) -> None:
        """Wait on the robot's clock."""
        ...

    def tare(self) -> None:
        """Count compression from here on: at rest, in free hang."""
        ...

    def clock(self) -> float:
        """Seconds since the cell was prepared."""
        ...

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        """Measure, and take a picture with each named camera; none for ()."""
        ...

    def halt(self) -> None:
        """Stop the arm where it is, now."""
        ...


class RobotBehind:
    """A robot behind another one, which passes on what is asked of it: all but `move_to`, which
    whoever derives from it says."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def __enter__(self) -> Self:
        self._robot.__enter__()
        return self

    def __exit__(self, *ended: Any) -> None:
        self._robot.__exit__(*ended)

    def settle(self, seconds: float) -> None:
        self._robot.settle(seconds)

    def tare(self) -> None:
        self._robot.tare()

    def clock(self) -> float:
        return self._robot.clock()

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        return self._robot.observe(cameras)

    def halt(self) -> None:
        self._robot.halt()


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Ground truth, sampled by the experiment. Never part of a Case."""

    inserted: bool | None  # None: nobody has labelled it yet
    depth_m: float  # of the centre of the peg's bottom face below the board; negative above
    tip: tuple[float, float, float]  # that centre in the task frame [m]
    tilt_rad: float  # the peg's lean about x, positive toward -y
    hole_y: float  # [m]
    compression_m: float
    fit: bool | None = None  # the peg's low edge is inside the hole, below its rim


class Workcell(Protocol):
    """A cell that an experiment prepares. Its truth stays on the experiment's side."""

    @property
    def kind(self) -> str:
        """The kind of cell, as results name it: "sim", "ur5e", or "emulator", which is a simulated
        cell behind a UR5e's software."""
        ...

    def prepare(self, task: Task, setup: Setup) -> Robot:
        """The robot for one trial: at home, in free hang, tared, its clock at zero. May raise
        RobotFault."""
        ...

    def truth(self) -> Truth:
        """The ground truth now."""
        ...
