"""The right answers to cases, by the truth: whether an execution succeeded, and on failure what to
do next.

A formation succeeds when the peg is where the next skill can take over from it; pictures, poses and
checks play no part. What to do next is the oracle's plan: the rules with the truth in place of
every measurement.
"""

import math
from dataclasses import dataclass, replace

from pliant.cell import Truth
from pliant.checks import TILT_TOLERANCE_DEG, half_hole, pose_check
from pliant.conditions import Setup
from pliant.envelope import Limits
from pliant.experiment.oracle import Oracle
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.records import Case, Verdict
from pliant.recovery import admit
from pliant.task import Task

TOUCHING_M = 0.0005
"""The compression from which a wrist at rest touches something [m]; in free hang it is pressed by
less."""

BELOW_M = 0.0005
"""The depth below the board's surface at which an edge is in the hole [m]: contact is softer than
that."""

CHANGE_M = 0.001
"""The change up to which a goal counts as the same goal [m]: the paper's p_th."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The right answer to a case: the verdict and, after a failure, the right steps from the first
    that changes something. No steps after a failure: none of the three formations that a plan may
    hold mends it, and no reasoner is asked to, unless it is right to `stop` and say so, or to
    `go_on` with a plan of which no more is scored than that there is one.

    `goals_m` are the least and the greatest goal [m] of the first step that reach its formation
    from here, found by trying them in the simulator.
    """

    success: bool
    steps: tuple[Step, ...] = ()
    goals_m: tuple[float, float] | None = None
    stop: bool = False
    go_on: bool = False

    @property
    def asks(self) -> bool:
        """Whether a reasoner is asked to recover from the case."""
        return bool(self.steps) or self.stop or self.go_on


def answer(case: Case, truth: Truth, setup: Setup) -> Answer | None:
    """The right answer to a case, its goals not yet tried; None where the right steps may not be
    done or change nothing: such a case has no answer to score by."""
    if succeeded(case, truth):
        return Answer(success=True)
    if case.outcome.step.formation not in RECOVERABLE:
        return Answer(success=False)
    failed = Verdict(success=False, reason="", votes={}, conflict=None, by="truth")
    recovery = Oracle(truth=lambda: truth, setup=setup).recover(case, failed)
    assert recovery is not None, "the oracle always plans"
    steps = _shortened(recovery.steps, case)
    whole = replace(recovery, steps=steps)
    changes = bool(steps) and (steps[0].retreat or abs(change(steps[0], case.goals)) > CHANGE_M)
    if not changes or admit(whole, case, Limits()).steps != steps:
        return None
    return Answer(success=False, steps=steps)


def succeeded(case: Case, truth: Truth) -> bool:
    """Whether the executed formation was reached, by the truth.

    Approach: the pose is reached and the peg hangs free above the board. Contact: the peg presses
    on the board. Fit: its low edge is in the hole, and its trailing edge has left the near rim.
    Align: its whole bottom face is in the hole, and it leans at most 5 degrees. Insertion: the
    centre of its bottom face is at least 10 mm deep in the hole.
    """
    match case.outcome.step.formation:
        case Formation.APPROACH:
            free = truth.depth_m < 0.0 and truth.compression_m < TOUCHING_M
            return free and pose_check(case.outcome).vote is True
        case Formation.CONTACT:
            return truth.compression_m >= TOUCHING_M
        case Formation.FIT:
            return truth.fit is True and _has_left_near_rim(case.task, truth)
        case Formation.ALIGN:
            upright = abs(math.degrees(truth.tilt_rad)) <= TILT_TOLERANCE_DEG
            return upright and _whole_face_in_hole(case.task, truth)
        case Formation.INSERTION:
            return truth.inserted is True


def change(step: Step, goals: Goals) -> float:
    """The amount [m] by which a step of Fit, Align or Insertion changes the goal in force."""
    axis = OWNED[step.formation][0]
    return step.goal[axis] - goals.formations[step.formation][axis]


def _shortened(steps: tuple[Step, ...], case: Case) -> tuple[Step, ...]:
    """The steps without a leading Align that changes nothing: a peg that stands well and was not
    stopped is pushed on from where it is, at least as deep as was taught."""
    stopped = case.outcome.stop.is_early
    if (
        case.outcome.step.formation is not Formation.INSERTION
        or stopped
        or len(steps) != 2
        or abs(change(steps[0], case.goals)) > CHANGE_M
    ):
        return steps
    axis = OWNED[Formation.INSERTION][0]
    taught = case.teaching.goals.formations[Formation.INSERTION][axis]
    deeper = {axis: min(taught, steps[1].goal[axis])}
    return (Step(formation=Formation.INSERTION, goal=deeper),)


def _has_left_near_rim(task: Task, truth: Truth) -> bool:
    """Whether the bottom face's trailing edge is past the rim it came over, toward -y, or below
    it."""
    half = task.peg.half_extents[1]
    trailing = truth.tip[1] + half * math.cos(truth.tilt_rad)
    below = truth.depth_m - half * math.sin(truth.tilt_rad)
    return trailing < truth.hole_y + half_hole(task) or below > BELOW_M


def _whole_face_in_hole(task: Task, truth: Truth) -> bool:
    """Whether both edges of the bottom face are below the board's surface, and its centre in the
    hole."""
    up = task.peg.half_extents[1] * abs(math.sin(truth.tilt_rad))
    return abs(truth.tip[1] - truth.hole_y) < half_hole(task) and truth.depth_m - up > BELOW_M
