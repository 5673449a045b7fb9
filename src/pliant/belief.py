"""The belief about the hole and the grasp after the looks so far: a pure fold over measurements."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from pliant.envelope import Descent
from pliant.formations import Formation, Step
from pliant.pose import Pose
from pliant.task import Task, load_task
from pliant.teaching import Teaching
from pliant.vision.offset import hanging_tip
from pliant.vision.scene import Measured, Scene

JUMP_M = 0.003  # a reading so far from the belief is not believed until others agree


@dataclass(frozen=True, kw_only=True)
class Belief:
    """Estimates of what the method cannot know beforehand; None until something was seen.

    `hole_y`, `hole_x` and `surface_z` [m] are the hole's centre on the board, `board_yaw` [rad] how
    the board is turned, `grasp_roll` [rad] the peg's angle in the grasp; `upright_roll` and
    `upright_pitch` [rad] those of the hand with which the peg would hang upright. `readings` are
    the last of each, for the soft estimates. `hole_shift` [m] is how far along y from where it is
    read the hole is looked for since the last Fit; `hole_y` has it in it. `tip_in_hand` [m] is
    where the tip was seen to hang, from the hinge, in axes that turn with the peg.
    """

    hole_y: Measured | None = None
    grasp_roll: Measured | None = None
    hole_x: Measured | None = None
    surface_z: Measured | None = None
    board_yaw: Measured | None = None
    upright_roll: Measured | None = None
    upright_pitch: Measured | None = None
    readings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    hole_shift: float = 0.0
    tip_in_hand: tuple[float, float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One look: the step during which and the measured pose in which it was taken, and what was
    measured."""

    step: Step
    pose: Pose
    scene: Scene


def hang_share(teaching: Teaching) -> float:
    """The share of the hand's angle that a freely hanging peg takes on: gravity turns the soft
    wrist back. Read off the goals, which were taught with an aligned peg."""
    shown = teaching.scenes[Formation.APPROACH].peg
    if shown is None:
        return 0.5
    return shown.tilt.value / teaching.goals.target(Formation.APPROACH).roll


@lru_cache(maxsize=8)  # asked for at every look, and it reads the peg's file
def sag_m(teaching: Teaching) -> float:
    """The length [m] by which the tool's weight stretches the wrist in free hang, read off the
    goals."""
    shown, seen = teaching.demonstrations[Formation.APPROACH], teaching.scenes[Formation.APPROACH]
    if seen.peg is None:
        return 0.0
    task, share = load_task(shown.peg), hang_share(teaching)
    _, z = hanging_tip(task, shown.pose, seen.peg.tilt, hang_share=share, sag_m=0.0)
    return (z.value - seen.peg.tip_z.value) / math.cos(shown.pose.roll) ** 2


def descent_of(
    belief: Belief,
    task: Task,
    teaching: Teaching,
    *,
    slid_m: float = 0.0,
    sunk_m: float = 0.0,
    seen_z: float = math.inf,
) -> Descent:
    """The geometric limit on how low the hand may go, by what is believed of the board; nominal
    until it was seen. A peg that has slid up in the grasp by `slid_m` [m] touches so much later;
    `sunk_m` [m] is how deep it was seen in the hole, with the hand at `seen_z` [m]."""
    surface = belief.surface_z.value if belief.surface_z is not None else 0.0
    hang = task.tip_below_hinge + sag_m(teaching) - slid_m
    return Descent(surface_z=surface, hang_m=hang, depth_m=task.depth, sunk_m=sunk_m, seen_z=seen_z)
