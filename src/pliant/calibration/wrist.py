"""The wrist's stiffness: press the peg on the board in small steps of the arm, and release it.

The arm is stiff and knows how far it went, so each millimetre past the touch is a millimetre of
compression. What the cell reports instead, through the stiffness it believes in, tells the true
one; a wrong sign is refused. How far the arm goes is bounded by position, whatever the force seems
to be.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pliant.envelope import Guarded
from pliant.errors import InputError
from pliant.pose import Axis, Pose
from pliant.task import Task

LEAST_SLOPE = 0.05  # of reported over real compression: less is none
WORST_BEND = 0.02  # of the force's range: rms between the line and a parabola
WORST_HYSTERESIS = 0.15  # of the force's range, between pressing and releasing
WORST_SD = 0.05  # of the stiffness

_BESIDE = Pose(x=0.025, y=-0.040)  # on the board, whatever peg, clear of the hole
_ABOVE_M = 0.020  # of the nominal touch: the wrist hangs lower by its sag
_BELOW_M = 0.004  # of the nominal touch: no lower, also where nothing is felt
_ENOUGH_M = 0.006  # reported compression that ends the pressing
_STEP_M = 0.0005
_SPEED_M_S = 0.005
_LIMIT_M = 0.012
_SETTLE_S = 0.25
_CYCLES = 3
_FELT = 0.3  # of the highest reading: beyond it the peg stands flat
_LEAST_READINGS = 4  # beyond it, each way


@dataclass(frozen=True, kw_only=True, eq=False)
class Press:
    """Readings while pressing: the hinge point's height [m], the reported compression [m], and the
    direction."""

    height_m: NDArray[np.float64] = field(repr=False)  # (n,)
    compression_m: NDArray[np.float64] = field(repr=False)  # (n,)
    is_release: NDArray[np.bool_] = field(repr=False)  # (n,)


@dataclass(frozen=True, kw_only=True)
class WristFound:
    """The wrist's response to pressing: its stiffness, the height of the touch, bend and
    hysteresis."""

    stiffness_n_m: float
    sd_n_m: float
    touch_m: float  # the hinge point's height when the tip touches the board
    bend: float  # rms between the line and a parabola, over the force's range
    hysteresis: float  # mean gap between pressing and releasing, over the force's range

    def problem(self) -> str | None:
        """Why the result is too poor to be used, and what to do; None: it is good."""
        if self.sd_n_m > WORST_SD * self.stiffness_n_m:
            return (
                f"the stiffness is known to {self.sd_n_m / self.stiffness_n_m:.0%} only, worse than"
                f" {WORST_SD:.0%}: keep the table still, and press again"
            )
        if self.bend > WORST_BEND:
            return (
                f"force and travel are not in proportion: {self.bend:.1%} of the range off a line,"
                f" more than {WORST_BEND:.0%}: check that the peg stands on the board, does not"
                " slip in the grasp, and that nothing else touches"
            )
        if self.hysteresis > WORST_HYSTERESIS:
            return (
                f"pressing and releasing differ by {self.hysteresis:.0%} of the force, more than"
                f" {WORST_HYSTERESIS:.0%}: check that the peg does not slip, and the springs"
            )
        return None


def press(
    robot: Guarded, task: Task, tell: Callable[[float, float], None] = lambda z, c: None
) -> Press:
    """Press beside the hole and release, three times. Ends above the board.

    Raises:
        RobotFault: the robot's own.
    """
    start = _BESIDE.updated({Axis.Z: task.tip_below_hinge + _ABOVE_M})
    lowest = task.tip_below_hinge - _BELOW_M
    here = robot.observe(cameras=()).pose
    lifted = Pose(x=here.x, y=here.y, z=max(here.z, start.z + 0.02))
    for pose in (lifted, start.updated({Axis.Z: lifted.z}), start):
        robot.move_to(pose, speed_m_s=0.05, stop_at_compression_m=_LIMIT_M)
    robot.settle(3.0)
    robot.tare()
    readings: list[tuple[float, float, bool]] = []

    def go(z: float, is_release: bool) -> float:
        pose = start.updated({Axis.Z: z})
        robot.move_to(pose, speed_m_s=_SPEED_M_S, stop_at_compression_m=_LIMIT_M)
        robot.settle(_SETTLE_S)
        seen = robot.observe(cameras=())
        readings.append((seen.pose.z, seen.compression_m, is_release))
        tell(seen.pose.z, seen.compression_m)
        return seen.compression_m

    top = start.z
    for _ in range(_CYCLES):
        z = top
        while z - _STEP_M > lowest and abs(go(z, False)) < _ENOUGH_M:
            z -= _STEP_M
        while z < top and (abs(go(z, True)) > 0.1 * _ENOUGH_M or z < task.tip_below_hinge):
            z += _STEP_M
        top = min(top, z + 2 * _STEP_M)  # the way down to the touch is known now
    robot.move_to(lifted, speed_m_s=0.02, stop_at_compression_m=_LIMIT_M)
    heights, compressions, releases = map(np.array, zip(*readings, strict=True))
    return Press(height_m=heights, compression_m=compressions, is_release=releases)


def evaluate(pressed: Press, stiffness_n_m: float) -> WristFound:
    """The stiffness from the readings of a cell that believes in `stiffness_n_m`.

    Raises:
        InputError: nothing was felt, or too little of it, or pressing as stretching.
    """
    height, reading = pressed.height_m, pressed.compression_m
    top = float(np.max(np.abs(reading)))
    is_turned = -np.min(reading) > np.max(reading)
    felt = np.abs(reading) > _FELT * top
    down, up = felt & ~pressed.is_release, felt & pressed.is_release
    if top < LEAST_SLOPE * _ENOUGH_M or min(np.sum(down), np.sum(up)) < _LEAST_READINGS:
        raise InputError(
            f"pressing was hardly felt: {top * 1e3:.2f} mm of compression reported down to"
            f" {np.min(height) * 1e3:.1f} mm: check the task frame's z, that wrist.axis is z (the"
            " tool's axis that stands upright), and the stiffness"
        )
    if is_turned:
        raise InputError(
            f"pressing reads as {top * 1e3:.1f} mm of stretching: turn wrist.sign round in the"
            " cell's file, and look with pliant check-cell, before anything is pressed again"
        )
    # One slope, a line of its own each way.
    back = pressed.is_release[felt].astype(float)
    columns = np.column_stack([-height[felt], 1.0 - back, back])
    solution, *_ = np.linalg.lstsq(columns, reading[felt], rcond=None)
    slope, offset_down, offset_up = (float(v) for v in solution)
    off = reading[felt] - columns @ solution
    variance = float(off @ off) / max(1, len(off) - 3)
    slope_sd = math.sqrt(variance * float(np.linalg.inv(columns.T @ columns)[0, 0]))
    if slope < LEAST_SLOPE:
        raise InputError(
            f"a millimetre of pressing reads as {slope:.2f} mm: check that wrist.axis is z (the"
            " tool's axis that stands upright), and that the peg does not slip in the grasp"
        )
    return WristFound(
        stiffness_n_m=stiffness_n_m * slope,
        sd_n_m=stiffness_n_m * slope_sd,
        touch_m=(offset_down + offset_up) / 2 / slope,
        bend=_bend(height[felt], columns, reading[felt]) / top,
        hysteresis=abs(offset_down - offset_up) / top,
    )


def _bend(
    height: NDArray[np.float64], columns: NDArray[np.float64], reading: NDArray[np.float64]
) -> float:
    """Rms [m] of the part of the readings that a parabola explains and a line does not."""
    square = (height - np.mean(height)) ** 2
    rest, off = (
        v - columns @ np.linalg.lstsq(columns, v, rcond=None)[0] for v in (square, reading)
    )
    share = float(rest @ off) / float(rest @ rest)
    return abs(share) * math.sqrt(float(np.mean(rest**2)))
