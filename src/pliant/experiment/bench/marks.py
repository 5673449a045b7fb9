"""One case put to a reasoner, and its answers marked against what was right."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from pliant.envelope import Limits
from pliant.errors import InputError, PliantError, described
from pliant.experiment.bench.answers import CHANGE_M, Answer, change
from pliant.experiment.bench.cases import BenchCase, Kind
from pliant.formations import OWNED, Formation, Step
from pliant.records import Case, Decision, Exchange, Recovery, Verdict
from pliant.recovery import Reasoner, admit

Make = Callable[[str], Reasoner]
"""A maker of the reasoner for a case, given the case's name: each gets one of its own, as each
trial."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A reasoner's plan marked beside the right one. What admission refuses of it would not be
    done, and does not count: a goal that a plan leaves alone stays the goal in force.

    `direction` is None where the right change of the goal is no more than 1 mm.
    """

    refusal: str  # why some of it may not be done; empty: all of it may
    start: bool  # its first step that changes something is of the right formation
    retreat: bool  # leaves the hole first, or not, as it should
    direction: bool | None
    toward_m: float  # how much nearer its goal is to the goals that reach, than the one in force
    reaches: bool  # that step is the right one, and its goal is among those that reach


@dataclass(frozen=True, kw_only=True)
class Mark:
    """The marks of a case's answers. `plan` None: the execution had succeeded, or no plan could
    mend it. `stopped` None: nothing was asked."""

    name: str
    kind: Kind
    formation: Formation
    peg: str
    success: bool  # what was right
    judged: bool
    plan: Plan | None
    stop: bool  # whether it was right to stop
    stopped: bool | None
    own: tuple[bool, ...]  # per decision that asked a model: it made it
    clamped: int  # plans of a model that were cut down
    fallbacks: int  # decisions made by the rules in a model's place
    decisions: tuple[tuple[Exchange, ...], ...]  # per decision that asked a model


def put(question: BenchCase, name: str, make: Make) -> Mark:
    """Ask a reasoner about a case: to judge it, and after a true failure to recover.

    A reasoner that took the failure for a success is asked to recover from a plain verdict of
    failure in its place.

    Raises:
        InputError: the reasoner raised something, or answered what is no verdict or recovery.
    """
    try:
        return _put(question, make(question.name))
    except PliantError:
        raise
    except (Exception, SystemExit) as error:  # a user's reasoner may raise anything
        raise InputError(
            f"reasoner '{name}' failed at case {question.name}: {described(error)}; mend it, or"
            " leave it out"
        ) from error


def _put(question: BenchCase, mind: Reasoner) -> Mark:
    case, key = question.case, question.key
    verdict = mind.judge(case)
    made: list[Decision] = [verdict]
    plan = stopped = None
    if key.answer.asks:
        failed = _failure(case) if verdict.success else verdict
        recovery = mind.recover(case, failed)
        plan = _marked(recovery, case, key.answer) if key.answer.steps else None
        stopped = recovery is not None and not recovery.steps
        made += [recovery] if recovery is not None else []
    return Mark(
        name=question.name,
        kind=key.kind,
        formation=key.formation,
        peg=key.origin.peg,
        success=key.answer.success,
        judged=bool(verdict.success),
        plan=plan,
        stop=key.answer.stop,
        stopped=stopped,
        own=tuple(d.is_own for d in made if d.is_asked),
        clamped=sum(isinstance(d, Recovery) and d.clamped is not None for d in made),
        fallbacks=sum(bool(d.fallback) for d in made),
        decisions=tuple(d.exchanges for d in made if d.exchanges),
    )


def _failure(case: Case) -> Verdict:
    return Verdict(
        success=False,
        reason="the execution failed",
        votes=case.evidence.votes,
        conflict=None,
        by="benchmark",
    )


def _marked(recovery: Recovery | None, case: Case, answer: Answer) -> Plan:
    right = answer.steps[0]
    axis = OWNED[right.formation][0]
    steps: tuple[Step, ...] = ()
    refusal = "no plan" if recovery is None else "no steps"
    if recovery is not None and recovery.steps:
        admission = admit(recovery, case, Limits())
        steps, refusal = admission.steps, "; ".join(admission.refusals)
    before = case.goals.formations[right.formation][axis]
    planned = next((s.goal[axis] for s in steps if s.formation is right.formation), before)
    wanted = right.goal[axis] - before
    first = next((s for s in steps if s.retreat or abs(change(s, case.goals)) > CHANGE_M), None)
    first = first or (steps[0] if steps else None)
    starts = first is not None and first.formation is right.formation
    leaves = first is not None and first.retreat == right.retreat
    distance = _outside(planned, answer)
    return Plan(
        refusal=refusal,
        start=starts,
        retreat=leaves,
        direction=(planned - before) * wanted > 0.0 if abs(wanted) > CHANGE_M else None,
        toward_m=_outside(before, answer) - distance,
        reaches=starts and leaves and distance == 0.0,
    )


def _outside(goal: float, answer: Answer) -> float:
    """The distance [m] of a goal from the nearest goal that reaches the formation."""
    right = answer.steps[0].goal
    low, high = answer.goals_m or (min(right.values()), max(right.values()))
    assert math.isfinite(goal), "admission refuses other goals"
    return max(low - goal, goal - high, 0.0)
