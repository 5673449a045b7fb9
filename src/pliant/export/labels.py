"""The truth about an execution: success, kind of failure, where, why, and what would have been
right. Nothing here is known to a method."""

import math
from dataclasses import dataclass

from pliant.cell import Truth
from pliant.conditions import NOMINAL, Setup
from pliant.experiment.oracle import Oracle
from pliant.experiment.success import KINDS, kind, succeeded
from pliant.formations import Goals
from pliant.levels import EDGES, load_level
from pliant.methods.named import method
from pliant.records import Case, Execution, Recovery, Trial, Verdict
from pliant.teaching import Teaching, shipped
from pliant.vision.measure import SIMULATED


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
        """The distance [m] along y from the hole's centre to the centre of the peg's bottom
        face."""
        return self.truth.tip[1] - self.truth.hole_y

    @property
    def tilt_deg(self) -> float:
        """The peg's lean, positive to the left in the side picture."""
        return math.degrees(self.truth.tilt_rad)


def labels(trial: Trial) -> list[Label]:
    """One label per execution whose truth is known."""
    found = []
    goals = trial.goals
    for execution, truth in zip(trial.executions, trial.truths, strict=False):
        goals = goals.updated(execution.outcome.step)
        if truth.fit is None:  # nobody measured where the peg was
            continue
        judged = trial.task, execution.outcome, truth
        success = succeeded(*judged)
        found.append(
            Label(
                execution=execution,
                truth=truth,
                goals=goals,
                success=success,
                kind=None if success else kind(*judged),
            )
        )
    return found


def correction(trial: Trial, label: Label) -> Recovery | None:
    """The plan that the rules make after a failure when every measurement is the truth's."""
    assert label.kind is not None, "only failures are corrected"
    oracle = Oracle(truth=lambda: label.truth, setup=setup_of(trial))
    verdict = Verdict(success=False, reason=KINDS[label.kind], votes={}, conflict=None, by="truth")
    return oracle.recover(case_of(trial, label), verdict)


def case_of(trial: Trial, label: Label) -> Case:
    """The case after an execution, as its reasoner met it. The goal pictures are there where the
    trial went by the shipped goals, and the colours where it was simulated: a record holds
    neither."""
    execution, taught = label.execution, shipped().for_task(trial.task)
    if taught.goals != trial.goals:
        taught = Teaching(goals=trial.goals, demonstrations={}, scenes={})
    known = trial.cell == "sim" and load_level(trial.level).senses != EDGES
    return Case(
        task=trial.task,
        teaching=taught,
        goals=label.goals,
        history=trial.executions[: execution.index],
        outcome=execution.outcome,
        evidence=execution.evidence,
        belief=execution.belief,
        method=method(trial.method),
        colours=SIMULATED if known else None,
    )


def setup_of(trial: Trial) -> Setup:
    """The setup that was drawn for the trial."""
    return Setup(seed=trial.seed, **trial.drawn)


def causes(trial: Trial) -> list[str]:
    """The trial's differences from the nominal task, in words; but for what rounds to 0."""
    setup = setup_of(trial)
    words = []
    if abs(hole_mm := setup.hole_y * 1e3) >= 0.05:
        side = "right" if hole_mm > 0 else "left"
        words.append(f"the hole is {abs(hole_mm):.1f} mm to the {side} of where taught")
    if abs(grasp_deg := math.degrees(setup.grasp_roll)) >= 0.05:
        side = "left" if grasp_deg > 0 else "right"
        words.append(f"the peg leans {abs(grasp_deg):.1f} degrees to the {side} in the grasp")
    if abs(setup.friction - NOMINAL["friction"]) >= 0.05:
        words.append(f"the board's friction is {setup.friction:.1f} times the nominal")
    return words
