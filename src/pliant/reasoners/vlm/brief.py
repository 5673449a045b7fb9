"""The situation in brief, for a model that was trained on it: the same facts in few words, lengths
in millimetres and angles in degrees."""

from collections.abc import Iterable, Mapping

from pliant.belief import Belief
from pliant.cell import Stop
from pliant.formations import OWNED, RECOVERABLE, Formation
from pliant.pose import Axis, Partial, Pose, describe
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.telling import NOT_MADE, of_checks, tells_measurements, tenths
from pliant.records import Case, Execution, FailureAnalysis, Outcome, Verdict
from pliant.vision.scene import Measured, Scene

_NAMES = {
    "pose_check": "pose",
    "compression_check": "compression",
    "table_i": "table_i",
    "metric_check": "metric",
    "plausibility": "plausible",
}


def sections(
    case: Case, settings: Settings, verdict: Verdict | None, analysis: FailureAnalysis | None
) -> Iterable[str]:
    """The lines of the text."""
    goals = (f"{f} {_numbers(case.goals.formations[f], OWNED[f])}" for f in RECOVERABLE)
    yield f"Goals: {', '.join(goals)}"
    if settings.history:
        for execution in case.history[-settings.history :]:
            yield f"Before: {_execution(execution, case, settings)}"
    yield f"Now: {_now(case, settings)}"
    if tells_measurements(settings, case):
        yield from _measured(case.outcome.scene, case.belief)
    for number, probed in enumerate(case.probes, start=1):
        yield f"Probe {number}: {probed}"
    if verdict is not None:
        yield f"Failure: {verdict.reason}"
    if analysis is not None:
        changes = [_change(f, by, case) for f, by in analysis.changes.items()]
        yield f"How: {analysis.how}"
        yield f"Changes: {'; '.join(changes) or 'none'}"


def _change(formation: Formation, by: Partial, case: Case) -> str:
    """A change, and the goal that it leads to: a small model does not add."""
    now = case.goals.formations[formation]
    to = {axis: now[axis] + by[axis] for axis in OWNED[formation] if axis in by}
    return f"{formation} {describe(by)}" + (f", to {_numbers(to, to)}" if to else "")


def _execution(execution: Execution, case: Case, settings: Settings) -> str:
    judged = "success" if execution.verdict.success else "failure"
    return f"{_what(execution.outcome, case)}; {_told(execution, case, settings)}; {judged}"


def _told(execution: Execution, case: Case, settings: Settings) -> str:
    return _checks(of_checks(execution.evidence, settings, case))


def _checks(told: Mapping[str, str]) -> str:
    """Each check's vote; what it says besides only where it is no success."""
    found = []
    for name, says in told.items():
        if says != NOT_MADE:
            vote, _, _ = says.partition(" (")
            found.append(f"{_NAMES[name]} {vote if vote == 'success' else says}")
    return ", ".join(found)


def _what(outcome: Outcome, case: Case) -> str:
    """What was executed: the skill with its goal, its shifts and how it ended."""
    step = outcome.step
    axes = [a for a in case.method.plannable[step.formation] if a in step.goal]
    retreat = " after a retreat" if step.retreat else ""
    stopped = ", stopped" if outcome.stop is Stop.COMPRESSION else ""
    return f"{step.formation}{retreat} {_numbers(step.goal, axes)}{stopped}"


def _now(case: Case, settings: Settings) -> str:
    outcome = case.outcome
    named = {axis for axes in case.method.plannable.values() for axis in axes}
    pose = _numbers(outcome.pose, [axis for axis in Axis if axis in named])
    peak = f"peak {outcome.peak_compression_m * 1e3:.1f}"
    checks = _checks(of_checks(case.evidence, settings, case))
    return f"no {len(case.history) + 1}, {_what(outcome, case)}; at {pose}; {peak}; {checks}"


def _measured(scene: Scene, belief: Belief) -> Iterable[str]:
    """What was measured after the skill, and what is believed of all looks."""
    peg, hole, across = scene.peg, scene.hole, scene.across
    seen: dict[str, Measured | None] = {
        "y": None if peg is None else peg.tip_y,
        "z": None if peg is None else peg.tip_z,
        "roll": None if peg is None else peg.tilt,
        "x": None if across is None else across.tip_x,
        "pitch": None if across is None else across.pitch,
    }
    yield f"Tip: {_values(seen)}"
    there: dict[str, Measured | None] = {
        "y": None if hole is None else hole.y,
        "z": None if hole is None else hole.surface_z,
        "x": None if across is None else across.hole_x,
    }
    yield f"Hole: {_values(there)}"
    believed = {
        "x": belief.hole_x,
        "y": belief.hole_y,
        "z": belief.surface_z,
        "yaw": belief.board_yaw,
        "roll": belief.grasp_roll,
    }
    yield f"Believed: {_values(believed)}"


def _values(named: Mapping[str, Measured | None]) -> str:
    told = (
        f"{name} {tenths(Axis[name.upper()].to_report(m.value))}"
        for name, m in named.items()
        if m is not None
    )
    return ", ".join(told) or "not seen"


def _numbers(values: Pose | Partial, axes: Iterable[Axis]) -> str:
    return " ".join(f"{a} {tenths(a.to_report(values[a]))}" for a in axes)
