"""What of a case is told in words, wherever it is told: checks, goals, poses, with their units."""

from collections.abc import Iterable

from pliant.formations import Step
from pliant.pose import Axis, Partial, Pose
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Case, Check, Evidence

NOT_MADE = "–"


def tells_measurements(settings: Settings, case: Case) -> bool:
    """Whether the model is told what was measured: where the skills go by it, unless it is
    withheld; else, if asked for."""
    return settings.measurements or (settings.belief and case.method.follows_belief)


def goal(step: Step, case: Case) -> str:
    """A step's goal: its own axes, then the shifts that it has."""
    return in_units(step.goal, [a for a in case.method.plannable[step.formation] if a in step.goal])


def of_checks(evidence: Evidence, settings: Settings, case: Case) -> dict[str, str]:
    """The checks' findings, by the name that the model reads: the paper's, and the metric one with
    the measurements that the skills go by."""
    measured = case.method.follows_belief and tells_measurements(settings, case)
    shown = {
        "pose_check": ("pose", settings.pose_check),
        "compression_check": ("compression", True),
        "table_i": ("table_i", settings.table_i),
        "metric_check": ("metric", measured),
    }
    told = {label: of_check(evidence[name]) for label, (name, on) in shown.items() if on}
    implausible = evidence["plausible"]
    if measured and implausible is not None:
        told["plausibility"] = of_check(implausible)
    return told


def of_check(check: Check | None) -> str:
    if check is None:
        return NOT_MADE
    vote = {True: "success", False: "failure", None: "not available"}[check.vote]
    return vote if check.message == vote else f"{vote} ({check.message})"


def in_units(values: Pose | Partial, axes: Iterable[Axis]) -> str:
    """Values with the unit in the name: "y_mm -35.2, roll_deg 10.0"."""
    return ", ".join(f"{a}_{a.report_unit} {tenths(a.to_report(values[a]))}" for a in axes)


def tenths(value: float) -> str:
    """Write a value to a tenth; nothing below zero is written "-0.0"."""
    return f"{round(value, 1) + 0.0:.1f}"
