"""The right answers to cases, by the truth: whether an execution succeeded, and on failure what to
do next.

What to do next is the oracle's plan: the rules with the truth in place of
every measurement.
"""

from dataclasses import dataclass, replace

from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.envelope import Limits
from pliant.experiment.oracle import Oracle
from pliant.experiment.success import succeeded
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.records import Case, Verdict
from pliant.recovery import admit

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
    if succeeded(case.task, case.outcome, truth):
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
