"""What really happened in an execution, from the truth: success, kind of failure, where, why, and
what would have been right. Nothing here is known to a method."""

import math
from dataclasses import dataclass

from pliant.cell import Stop, Truth
from pliant.checks import TILT_TOLERANCE_DEG, pose_check
from pliant.experiment.oracle import Oracle
from pliant.formations import Formation, Goals
from pliant.records import Case, Execution, Recovery, Trial, Verdict
from pliant.task import NOMINAL, Setup
from pliant.teaching import Teaching

KINDS = {
    "goal_missed": "Approach or Contact did not reach its goal",
    "missed_edge": "the peg is not in the hole and stands before the hole's centre",
    "overshot": "the peg is not in the hole and stands beyond the hole's centre",
    "tilted": "in the hole, and it leans more than 5 degrees after Align",
    "compression_stop": "in the hole, and the compression limit ended the push",
    "wedged": "in the hole, not deep enough, and not stopped by the compression limit",
}
"""Kinds of a failed execution. "Before" is where Fit comes from: right in the side picture (+y)."""


@dataclass(frozen=True, kw_only=True)
class Label:
    """The truth about an execution: `kind` is None where it succeeded."""

    execution: Execution
    truth: Truth
    goals: Goals  # in force when it was judged
    success: bool
    kind: str | None

    @property
    def offset_m(self) -> float:
        """From the hole's centre to the centre of the peg's bottom face, along y."""
        return self.truth.tip[1] - self.truth.hole_y

    @property
    def tilt_deg(self) -> float:
        """The peg's lean, positive to the left in the side picture."""
        return math.degrees(self.truth.tilt_rad)


def labels(trial: Trial) -> list[Label]:
    """One label per execution whose truth was sampled."""
    found = []
    goals = trial.goals
    for execution, truth in zip(trial.executions, trial.truths, strict=False):
        goals = goals.updated(execution.outcome.step)
        success = _succeeded(execution, truth)
        kind = None if success else _kind(execution, truth)
        found.append(
            Label(execution=execution, truth=truth, goals=goals, success=success, kind=kind)
        )
    return found


def correction(trial: Trial, index: int) -> Recovery | None:
    """The plan that the rules make after an execution when every measurement is the truth's."""
    label = labels(trial)[index]
    execution = label.execution
    oracle = Oracle(truth=lambda: label.truth, setup=setup_of(trial))
    verdict = Verdict(
        success=False, reason=KINDS[label.kind or "wedged"], votes={}, conflict=None, by="truth"
    )
    case = Case(
        task=trial.task,
        teaching=Teaching(goals=trial.goals, demonstrations={}, scenes={}),
        goals=label.goals,
        history=trial.executions[:index],
        outcome=execution.outcome,
        evidence=execution.evidence,
        belief=execution.belief,
    )
    return oracle.recover(case, verdict)


def setup_of(trial: Trial) -> Setup:
    """What was actual in the trial."""
    return Setup(seed=trial.seed, **trial.drawn)


def causes(trial: Trial) -> list[str]:
    """How the trial differed from the nominal task, in words, the largest effects first."""
    setup = setup_of(trial)
    drawn = setup.quantities()
    words = []
    if drawn["hole_y"] != NOMINAL["hole_y"]:
        side = "right" if setup.hole_y > 0 else "left"
        words.append(f"the hole is {abs(setup.hole_y) * 1e3:.1f} mm to the {side} of where taught")
    if drawn["grasp_roll"] != NOMINAL["grasp_roll"]:
        side = "left" if setup.grasp_roll > 0 else "right"
        angle = abs(math.degrees(setup.grasp_roll))
        words.append(f"the peg leans {angle:.1f} degrees to the {side} in the grasp")
    if drawn["friction"] != NOMINAL["friction"]:
        words.append(f"the board's friction is {setup.friction:.1f} times the nominal")
    return words


def _succeeded(execution: Execution, truth: Truth) -> bool:
    """Approach and Contact: the goal was reached. Fit: the low edge is in the hole. Align: that,
    and the peg stands within Table I's 5 degrees. Insertion: the paper's criterion."""
    formation = execution.formation
    if formation in (Formation.APPROACH, Formation.CONTACT):
        return bool(pose_check(execution.outcome).vote)
    if formation is Formation.INSERTION:
        return bool(truth.inserted)
    upright = abs(math.degrees(truth.tilt_rad)) <= TILT_TOLERANCE_DEG
    return bool(truth.fit) and (formation is Formation.FIT or upright)


def _kind(execution: Execution, truth: Truth) -> str:
    if execution.formation in (Formation.APPROACH, Formation.CONTACT):
        return "goal_missed"
    if not truth.fit:
        return "missed_edge" if truth.tip[1] > truth.hole_y else "overshot"
    if execution.formation is Formation.ALIGN:
        return "tilted"
    return "compression_stop" if execution.outcome.stop is Stop.COMPRESSION else "wedged"
