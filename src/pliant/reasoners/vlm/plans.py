"""Turns a model's reply into steps: compiled, held against the analysis, clamped (Sec. V-B).

Nothing here repairs a reply in silence. What may not be done is refused with a reason that goes
back to the model.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

from pydantic import BaseModel

from pliant.envelope import Limits
from pliant.formations import OWNED, RECOVERABLE, Formation, Step, steps_from
from pliant.pose import Axis, Partial
from pliant.reasoners.vlm.replies import (
    AbsolutePlan,
    Analysis,
    BoundedPlan,
    change_field,
    motion_field,
    shift_field,
)
from pliant.records import Case, FailureAnalysis, Recovery, shifts
from pliant.recovery import admit, changes

_NO_MOTION = 0.0005  # [m, rad] a change or a suggestion smaller than this has no direction
_ROUNDING_M = 1e-9  # a change of exactly the limit is within it
_STOP, _NONE = "stop", "none"


def analysis_of(reply: Analysis) -> FailureAnalysis:
    changes = {f: _told(reply, partial(change_field, f), OWNED[f]) for f in RECOVERABLE}
    motion = changes.get(Formation(reply.wrong_goal), {}) if reply.wrong_goal != _NONE else {}
    corners = (
        f"bottom-left corner {reply.bottom_left_corner},"
        f" bottom-right corner {reply.bottom_right_corner}"
    )
    return FailureAnalysis(
        what=f"{reply.what_happened} ({corners})",
        why=reply.why,
        how=reply.how_to_recover,
        motion={**motion, **_told(reply, motion_field, Axis)},
        changes={f: by for f, by in changes.items() if by},
    )


def _told(reply: BaseModel, field: Callable[[Axis], str], axes: Iterable[Axis]) -> Partial:
    """What the reply's fields for axes name [m, rad]; nothing of an axis without one, or with 0."""
    told = {axis: axis.from_report(getattr(reply, field(axis), 0)) for axis in axes}
    return {axis: by for axis, by in told.items() if by}


def steps_of(reply: BaseModel, case: Case) -> tuple[Step, ...]:
    """The steps that a plan in either form names; none: stop. A shift is kept where its formation
    has none, too, to be refused."""
    if isinstance(reply, AbsolutePlan):
        return tuple(
            Step(
                formation=Formation(step.skill),
                goal={
                    OWNED[Formation(step.skill)][0]: step.goal_mm * 1e-3,
                    **_told(step, shift_field, Axis),
                },
                retreat=step.retreat_first,
            )
            for step in reply.steps
        )
    assert isinstance(reply, BoundedPlan)
    if reply.resume_from == _STOP:
        return ()
    goals = {}
    for formation in RECOVERABLE:
        current, own = case.goals.formations[formation], shifts(case.method, formation)
        told = _told(reply, partial(change_field, formation), (*current, *own))
        moved = {axis: value + told.get(axis, 0.0) for axis, value in current.items()}
        goals[formation] = {**moved, **{axis: told[axis] for axis in own if axis in told}}
    return steps_from(Formation(reply.resume_from), goals, retreat=reply.retreat_first)


def in_metres(steps: Sequence[Step], case: Case) -> str | None:
    """The reason why a plan of absolute goals seems to be written in metres, and so says nothing;
    None: it does not."""
    for step in steps:
        for axis in OWNED[step.formation]:
            told, current = step.goal[axis] * 1e3, case.goals.formations[step.formation][axis] * 1e3
            if abs(told * 1e3 - current) < abs(told - current):
                return f"{step.formation}: goal_mm is {told:g}, which looks like metres; give mm"
    return None


def refusal(recovery: Recovery, case: Case, limits: Limits, step_limit_m: float) -> str | None:
    """The reason why a plan may not be done, in words for the model; None: it may."""
    if not recovery.steps:
        return None
    tighter = replace(limits, goal_step_m=min(limits.goal_step_m, step_limit_m + _ROUNDING_M))
    refused = admit(recovery, case, tighter).refusals
    if refused:
        return refused[0]
    if recovery.steps[-1].formation is not Formation.INSERTION:
        return f"a plan ends with {Formation.INSERTION}"
    told = (_against_analysis(step, recovery.analysis, case) for step in recovery.steps)
    return next(filter(None, told), None)


def _against_analysis(step: Step, analysis: FailureAnalysis, case: Case) -> str | None:
    """The reason why a change of the plan opposes the analysis's direction; None: it does not."""
    of_goal = analysis.changes.get(step.formation, {})
    for axis, change in changes(step, case).items():
        suggested = of_goal if axis in OWNED[step.formation] else analysis.motion
        told = suggested.get(axis, 0.0)
        if _opposed(change, told):
            unit = axis.report_unit
            return (
                f"{step.formation}: changes {axis} by {axis.to_report(change):+.1f} {unit}, but the"
                f" analysis says {axis.to_report(told):+.1f} {unit}"
            )
    return None


def clamped(
    recovery: Recovery, evidence: Recovery | None, case: Case, limits: Limits, most_m: float
) -> Recovery | None:
    """A refused plan with each change cut down to `most_m`, of an angle to one step's reach, where
    it starts and goes the way that the evidence points, which is the rules' plan's; None: it does
    not, or may still not be done."""
    if not recovery.steps or evidence is None or not evidence.steps:
        return None
    if not _same_way(recovery.steps, evidence.steps, case):
        return None
    steps = tuple(
        replace(
            step,
            goal={
                axis: case.goals.formations[step.formation].get(axis, 0.0)
                + _cut(by, limits.goal_step_rad if axis.is_angle else most_m)
                for axis, by in changes(step, case).items()
            },
        )
        for step in recovery.steps
    )
    cut = replace(recovery, steps=steps, clamped=recovery.steps)
    return None if refusal(cut, case, limits, most_m) else cut


def _cut(by: float, most: float) -> float:
    return max(-most, min(most, by))


def _same_way(steps: tuple[Step, ...], right: tuple[Step, ...], case: Case) -> bool:
    """Whether both start with the same formation and move its goal the same way, and no later goal
    the other way."""
    wanted = {step.formation: changes(step, case) for step in right}
    if steps[0].formation is not right[0].formation:
        return False
    pairs = [
        (by, wanted.get(step.formation, {}).get(axis, 0.0))
        for step in steps
        for axis, by in changes(step, case).items()
    ]
    return pairs[0][0] * pairs[0][1] > 0 and not any(_opposed(*pair) for pair in pairs)


def _opposed(one: float, other: float) -> bool:
    """Whether two motions [m, rad] along an axis have a direction, and not the same."""
    return min(abs(one), abs(other)) > _NO_MOTION and one * other < 0
