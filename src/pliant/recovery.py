"""The protocol of a reasoner, and which of its plans may be done (Sec. V-B)."""

import math
from typing import Protocol, runtime_checkable

from pliant.cell import Stop
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.formations import RECOVERABLE, Formation, Step, check_axes
from pliant.pose import Axis, Partial
from pliant.records import Admission, Case, Probe, Recovery, Verdict, shifts

_UNCHANGED_M = 0.0005  # y
_SAME_Z_M = 1e-6


class Reasoner(Protocol):
    """Judges an execution, and on failure says what happened and what to do."""

    @property
    def name(self) -> str: ...

    def judge(self, case: Case) -> Verdict: ...

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        """The recovery after a failed verdict. None: keep to the plan. A recovery without steps:
        stop."""
        ...


@runtime_checkable
class Inquirer(Protocol):
    """What a reasoner has beside that, if it may ask for probes."""

    def inquire(self, case: Case, verdict: Verdict) -> Probe | None:
        """The probe to make before a recovery is planned after a failed verdict. None: there is no
        need. It is asked again with the result, as long as the trial grants one."""
        ...


def admit(recovery: Recovery, case: Case, limits: Limits) -> Admission:
    """The steps of a recovery that may be done, with a reason for each refusal.

    A plan runs in the order of the formations from Fit to Insertion, each goal names the axes its
    formation owns, is finite, lies in the workspace and within one step's reach of the goal in
    force. Where the method takes shifts it may name those, each within that reach of none. After a
    compression stop the first step must unload the wrist, and no insertion goes deeper, unless y
    changed; after a probe, which lifts the peg out, it must retreat. A plan with a refused step is
    refused from that step on.
    """
    admitted: list[Step] = []
    for step in recovery.steps:
        before = admitted[-1].formation if admitted else None
        reason = _refusal(step, before, case, limits, admitted)
        if reason is not None:
            return Admission(steps=tuple(admitted), refusals=(f"{step.formation}: {reason}",))
        admitted.append(step)
    return Admission(steps=tuple(admitted))


def _refusal(
    step: Step, before: Formation | None, case: Case, limits: Limits, admitted: list[Step]
) -> str | None:
    if step.formation not in RECOVERABLE:
        return f"a plan may hold {', '.join(RECOVERABLE)} only"
    if before is not None and step.formation.order != before.order + 1:
        return f"out of order after {before}"
    try:
        check_axes(step.formation, step.goal, shifts=shifts(case.method, step.formation))
    except InputError as error:
        return str(error)
    if not all(math.isfinite(v) for v in step.goal.values()):
        return "a goal must be a finite number"
    touch_down = case.teaching.goals.touch_down_y(step)
    on_the_way = {Axis.Y: touch_down} if touch_down is not None else {}
    outside = limits.outside(step.goal, margin=True) or limits.outside(on_the_way, margin=True)
    if outside is not None:
        return outside
    for axis, change in changes(step, case).items():
        reach = limits.goal_step_rad if axis.is_angle else limits.goal_step_m
        if abs(change) > reach:
            return (
                f"moves {axis} by {axis.to_report(change):+.1f}"
                f" {axis.report_unit}, more than {axis.to_report(reach):.0f} {axis.report_unit}"
            )
    if step.formation is Formation.INSERTION and _deeper_into_resistance(step, case, admitted):
        return "no deeper after a compression stop unless y changes"
    if before is None and case.probes and not step.retreat:
        return "the peg was lifted out to probe: retreat first"
    if before is None and case.method.presses_on(step, case):
        return "presses on after a compression stop: retreat, or unload the wrist first"
    return None


def changes(step: Step, case: Case) -> Partial:
    """The change [m, rad] that a step makes to its formation's goal in force; a shift is its own
    change."""
    current = case.goals.formations[step.formation]
    return {axis: value - current.get(axis, 0.0) for axis, value in step.goal.items()}


def _deeper_into_resistance(step: Step, case: Case, admitted: list[Step]) -> bool:
    """Whether a step goes deeper than the last insertion that the compression limit stopped, at the
    same y."""
    stopped = [
        o.target
        for o in case.outcomes
        if o.step.formation is Formation.INSERTION and o.stop is Stop.COMPRESSION
    ]
    if not stopped:
        return False
    goals = case.goals
    for earlier in admitted:
        goals = goals.updated(earlier)
    target = goals.updated(step).target(Formation.INSERTION)
    same_y = abs(target.y - stopped[-1].y) <= _UNCHANGED_M
    return same_y and target.z < stopped[-1].z - _SAME_Z_M
