"""Finds executions that repeat a state: the same skill was sent to the same goal and ended the
same.

An attempt that changes nothing is no new attempt. What counts as nothing is decided here alone,
from what the method itself commanded and measured, so that it can be said of a real cell as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pliant.checks import POSE_TOLERANCE_M, POSE_TOLERANCE_RAD
from pliant.pose import Axis, Pose
from pliant.records import Execution
from pliant.vision.scene import Measured, Scene

SAME_GOAL_M, SAME_GOAL_RAD = 0.0009, math.radians(0.5)
"""The tolerance of commanded poses: less than the least change that a plan in whole millimetres can
make. Guided skills correct what they are sent to by a few tenths each time."""
SAME_POSE_M, SAME_POSE_RAD = POSE_TOLERANCE_M, POSE_TOLERANCE_RAD
"""The tolerance of measured poses: what the pose check lets pass as the same goal reached."""
SAME_SEEN_M, SAME_SEEN_RAD = 0.001, math.radians(1.0)
"""The tolerance of what a picture shows, tip, depth and lean: blind retries in simulation, which
end at the same place, are measured up to 0.6 mm and 0.2 deg apart."""
SAME_COMPRESSION_M = 0.001
"""The tolerance of compression, at its peak and at the end: 1 N on the published wrist's spring of
1 N/mm, less than a UR5e's own force sensor can be trusted for."""


@dataclass(frozen=True, kw_only=True)
class Repeat:
    """An execution repeated the state of execution `first`, an index, for the `times`-th time: 2 is
    the first repetition."""

    first: int
    times: int

    def __str__(self) -> str:
        return f"as execution {self.first + 1}: nothing changed ({_ordinal(self.times)} time)"


def repeats(executions: Sequence[Execution]) -> tuple[Repeat | None, ...]:
    """The earlier execution that each execution repeated; None: it was new. Each is compared with
    the first of its kind, so that small changes that add up are a change."""
    firsts: list[tuple[int, Execution]] = []
    times: dict[int, int] = {}
    found: list[Repeat | None] = []
    for index, execution in enumerate(executions):
        first = next((i for i, e in firsts if is_same(e, execution)), None)
        if first is None:
            firsts.append((index, execution))
            times[index] = 1
            found.append(None)
        else:
            times[first] += 1
            found.append(Repeat(first=first, times=times[first]))
    return tuple(found)


def of_which(executions: Sequence[Execution]) -> str:
    """The words to say after the number of executions: ", of which 26 repeated a state", or
    nothing."""
    n = sum(repeat is not None for repeat in repeats(executions))
    return f", of which {n} repeated a state" if n else ""


def is_same(one: Execution, other: Execution) -> bool:
    """Whether two executions were the same skill, sent to the same pose, and ended in the same
    state as far as it was measured, on whatever way. What only one of them saw is a difference."""
    a, b = one.outcome, other.outcome
    return (
        (one.formation, a.stop) == (other.formation, b.stop)
        and _near(a.target, b.target, SAME_GOAL_M, SAME_GOAL_RAD)
        and _near(a.pose, b.pose, SAME_POSE_M, SAME_POSE_RAD)
        and abs(a.peak_compression_m - b.peak_compression_m) <= SAME_COMPRESSION_M
        and abs(_at_end(one) - _at_end(other)) <= SAME_COMPRESSION_M
        and _looks_the_same(a.scene, b.scene)
    )


def _at_end(execution: Execution) -> float:
    return execution.outcome.looks[-1].observation.compression_m


def _near(a: Pose, b: Pose, metres: float, radians: float) -> bool:
    return all(abs(a[axis] - b[axis]) <= (radians if axis.is_angle else metres) for axis in Axis)


def _looks_the_same(a: Scene, b: Scene) -> bool:
    """Whether the peg and the hole stand in the same places, or are hidden in both."""
    pairs = [(a.board_yaw, b.board_yaw, SAME_SEEN_RAD)]
    for one, other, name, tolerance in (
        (a.peg, b.peg, "tip_y", SAME_SEEN_M),
        (a.peg, b.peg, "tip_z", SAME_SEEN_M),
        (a.peg, b.peg, "tilt", SAME_SEEN_RAD),
        (a.hole, b.hole, "y", SAME_SEEN_M),
        (a.hole, b.hole, "surface_z", SAME_SEEN_M),
    ):
        pairs.append((getattr(one, name, None), getattr(other, name, None), tolerance))
    return all(_agree(*pair) for pair in pairs)


def _agree(a: Measured | None, b: Measured | None, tolerance: float) -> bool:
    if a is None or b is None:
        return a is b
    return abs(a.value - b.value) <= tolerance


def _ordinal(n: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}th" if n % 100 in (11, 12, 13) else f"{n}{ending}"
