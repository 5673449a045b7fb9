"""A recovery decision in numbers: what a case holds, and the action that answers it.

`numbers` and `as_recovery` are what `pliant/Recovery-v0` shows and takes; with `as_action`, the way
back, recorded recoveries become examples to learn from, and a learned policy a reasoner.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pliant.cell import Stop
from pliant.formations import OWNED, RECOVERABLE, Formation, Step
from pliant.pose import Axis
from pliant.records import Case, FailureAnalysis, Recovery, Verdict

CHECKS = ("pose", "compression", "table_i", "metric", "goal_picture")

FIELDS: Mapping[str, tuple[float, float]] = {
    **{f"failed_{formation}": (0.0, 1.0) for formation in Formation},  # one of them 1
    # The terminal pose [m, rad], the compression then and at most [m]; 1: it hit the limit.
    "y": (-0.11, 0.11),
    "z": (0.10, 0.45),
    "roll": (-0.55, 0.55),
    "compression": (-0.05, 0.05),
    "peak_compression": (-0.05, 0.05),
    "stopped": (0.0, 1.0),
    # Measured in the picture [m, rad]: the bottom face's centre, the lean, the hole, the board.
    # Each is 0 where `seen` is.
    "peg_seen": (0.0, 1.0),
    "tip_y": (-0.2, 0.2),
    "tip_z": (-0.2, 0.4),
    "tilt": (-math.pi / 2, math.pi / 2),
    "hole_seen": (0.0, 1.0),
    "hole_y": (-0.2, 0.2),
    "surface_z": (-0.1, 0.1),
    # The goals in force [m].
    "fit_y": (-0.11, 0.11),
    "align_y": (-0.11, 0.11),
    "insertion_z": (0.10, 0.45),
    # The belief from all looks so far [m, rad]; 0 where there is none.
    "hole_believed": (0.0, 1.0),
    "believed_hole_y": (-0.2, 0.2),
    "grasp_believed": (0.0, 1.0),
    "believed_grasp_roll": (-math.pi / 2, math.pi / 2),
    **{f"vote_{name}": (-1.0, 1.0) for name in CHECKS},  # 1 success, -1 failure, 0 no vote
    # Counts: executions so far, recoveries before this one, failed verdicts in a row.
    "executions": (0.0, 40.0),
    "recoveries": (0.0, 40.0),
    "failures": (0.0, 40.0),
}
"""The names of the values that `numbers` gives, in order, each with its bounds."""

ACTION = ("start", "retreat", "fit_y", "align_y", "insertion_z")
"""The names of an action's values, each from -1 to 1: the formation that the plan starts from
(below -1/3 Fit, to 1/3 Align, above it Insertion), whether to retreat first (above 0), and by how
much the goals in force change, as parts of `MOST`. A change before the start is ignored."""

MOST: Mapping[Formation, float] = {
    Formation.FIT: 0.040,
    Formation.ALIGN: 0.040,
    Formation.INSERTION: 0.010,
}
"""The change of a goal that an action's value 1 stands for [m]: of y for Fit and Align, of z for
Insertion."""


def numbers(case: Case, verdict: Verdict) -> NDArray[np.float32]:
    """A case as numbers (len(FIELDS),) within the bounds of `FIELDS`."""
    outcome, belief = case.outcome, case.belief
    peg, hole = outcome.scene.peg, outcome.scene.hole
    seen, pose = outcome.looks[-1].observation, outcome.pose
    goals = case.goals.formations
    verdicts = [e.verdict.success for e in case.history] + [verdict.success]
    values = {
        **{f"failed_{f}": f is outcome.step.formation for f in Formation},
        "y": pose.y,
        "z": pose.z,
        "roll": pose.roll,
        "compression": seen.compression_m,
        "peak_compression": outcome.peak_compression_m,
        "stopped": outcome.stop is Stop.COMPRESSION,
        "peg_seen": peg is not None,
        "tip_y": peg.tip_y.value if peg else 0.0,
        "tip_z": peg.tip_z.value if peg else 0.0,
        "tilt": peg.tilt.value if peg else 0.0,
        "hole_seen": hole is not None,
        "hole_y": hole.y.value if hole else 0.0,
        "surface_z": hole.surface_z.value if hole else 0.0,
        "fit_y": goals[Formation.FIT][Axis.Y],
        "align_y": goals[Formation.ALIGN][Axis.Y],
        "insertion_z": goals[Formation.INSERTION][Axis.Z],
        "hole_believed": belief.hole_y is not None,
        "believed_hole_y": belief.hole_y.value if belief.hole_y else 0.0,
        "grasp_believed": belief.grasp_roll is not None,
        "believed_grasp_roll": belief.grasp_roll.value if belief.grasp_roll else 0.0,
        **{f"vote_{name}": _vote(case, name) for name in CHECKS},
        "executions": len(verdicts),
        "recoveries": sum(e.recovery is not None for e in case.history),
        "failures": _last_failures(verdicts),
    }
    low, high = np.array(list(FIELDS.values()), np.float32).T
    return np.clip(np.array([values[name] for name in FIELDS], np.float32), low, high)


def as_recovery(action: NDArray[np.float64], case: Case, verdict: Verdict, by: str) -> Recovery:
    """The recovery that an action (5,) within -1 to 1 stands for."""
    which = 0 if action[0] < -1 / 3 else 1 if action[0] <= 1 / 3 else 2
    steps: list[Step] = []
    for formation, change in zip(RECOVERABLE[which:], action[2 + which :].tolist(), strict=True):
        axis = OWNED[formation][0]
        goal = case.goals.formations[formation][axis] + change * MOST[formation]
        first = not steps
        steps.append(
            Step(formation=formation, goal={axis: goal}, retreat=first and bool(action[1] > 0))
        )
    start = steps[0]
    motion = {a: v - case.goals.formations[start.formation][a] for a, v in start.goal.items()}
    analysis = FailureAnalysis(what=verdict.reason, why="not asked", how=str(start), motion=motion)
    return Recovery(analysis=analysis, steps=tuple(steps), by=by)


def as_action(recovery: Recovery, case: Case) -> NDArray[np.float64]:  # (5,)
    """The action that stands for a recovery with steps; changes beyond `MOST` are cut."""
    action = np.zeros(len(ACTION))
    action[0] = RECOVERABLE.index(recovery.steps[0].formation) - 1
    action[1] = 1.0 if recovery.steps[0].retreat else -1.0
    for step in recovery.steps:
        axis = OWNED[step.formation][0]
        change = step.goal[axis] - case.goals.formations[step.formation][axis]
        action[2 + RECOVERABLE.index(step.formation)] = change / MOST[step.formation]
    return np.clip(action, -1.0, 1.0)


def _vote(case: Case, name: str) -> float:
    check = case.evidence[name]
    return 0.0 if check is None or check.vote is None else 1.0 if check.vote else -1.0


def _last_failures(verdicts: list[bool]) -> int:
    """The number of failures in a row at the end of the verdicts."""
    return next((n for n, success in enumerate(reversed(verdicts)) if success), len(verdicts))
