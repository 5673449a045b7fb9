"""Recoveries by rules: what the planners of all methods give."""

from pliant.formations import Step
from pliant.pose import describe
from pliant.records import Case, FailureAnalysis, Recovery


def going_on(
    case: Case, by: str, what: str, why: str, how: str, steps: tuple[Step, ...]
) -> Recovery:
    """The recovery that goes on with steps; its analysis says how far the first goes from the goal
    in force."""
    first = steps[0]
    current = case.goals.formations[first.formation]
    motion = {axis: value - current[axis] for axis, value in first.goal.items()}
    how = f"{how} ({first.formation}: {describe(motion)})"
    analysis = FailureAnalysis(what=what, why=why, how=how, motion=motion)
    return Recovery(analysis=analysis, steps=steps, by=by)


def stopping(by: str, what: str, why: str) -> Recovery:
    """The recovery that stops."""
    analysis = FailureAnalysis(what=what, why=why, how="stop", motion={})
    return Recovery(analysis=analysis, steps=(), by=by)
