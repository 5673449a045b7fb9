"""What a model is told and shown (Sec. V): the static part first, so that servers can cache it,
then the goal picture, the situation, and the picture taken after the skill.

It sees what the case holds and no more; numbers are in millimetres and degrees, as their names say.
"""

from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from string import Template

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic_ai.messages import BinaryContent, UserContent

from pliant.cell import Stop
from pliant.checks import INSERTED_DEPTH_M
from pliant.formations import OWNED, Formation, Goals
from pliant.pose import Axis, Partial, Pose, describe
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Case, Check, Evidence, Execution, FailureAnalysis, Outcome, Verdict
from pliant.task import Task

_IN_PLANE = (Axis.Y, Axis.Z, Axis.ROLL)
_NOT_MADE = "–"


def instructions(settings: Settings, task: Task, *stages: str) -> str:
    """The static part: the task, then what is asked in each of `stages`."""
    values = {
        "peg": f"the {task.peg.name}, {task.peg.length * 1e3:.0f} mm long",
        "clearance_mm": f"{task.hole.clearance * 1e3:g}",
        "depth_mm": f"{INSERTED_DEPTH_M * 1e3:g}",
        "step_limit_mm": f"{settings.step_limit_mm:g}",
    }
    return "\n".join(Template(_prompt(name)).substitute(values) for name in ("task", *stages))


@cache
def _prompt(name: str) -> str:
    return (files("pliant.reasoners.vlm") / "prompts" / f"{name}.md").read_text()


def situation(
    case: Case,
    settings: Settings,
    *,
    goal_picture: bool = False,
    verdict: Verdict | None = None,
    analysis: FailureAnalysis | None = None,
) -> list[UserContent]:
    """The case as text and pictures; with the verdict or the analysis that came before."""
    content: list[UserContent] = []
    formation = case.outcome.step.formation
    shown = case.teaching.demonstrations.get(formation) if goal_picture else None
    if shown is not None:
        content += [
            f"Goal picture: how {formation} looked when it succeeded with the {shown.peg} peg.",
            _picture(shown.view.image, settings),
        ]
    content.append("\n\n".join(filter(None, _sections(case, settings, verdict, analysis))))
    if settings.picture:
        image = case.outcome.looks[-1].observation.views["side"].image
        content += [f"Picture taken after this {formation}:", _picture(image, settings)]
    return content


def _sections(
    case: Case,
    settings: Settings,
    verdict: Verdict | None,
    analysis: FailureAnalysis | None,
) -> Iterable[str]:
    yield _goals(case.goals)
    if settings.history and case.history:
        yield _history(case.history, settings)
    yield _executed(case, settings)
    if settings.measurements:
        yield _measured(case)
    if verdict is not None:
        yield f"## Verdict\nfailure: {verdict.reason}" + (
            f"\nconflict: {verdict.conflict}" if verdict.conflict else ""
        )
    if analysis is not None:
        motion = describe(analysis.motion) or "none"
        yield (
            f"## Analysis\nwhat happened: {analysis.what}\nwhy: {analysis.why}\n"
            f"how to recover: {analysis.how}\nsuggested motion: {motion}"
        )


def _goals(goals: Goals) -> str:
    rows = [[f, _mm(goals.formations[f], OWNED[f])] for f in Formation]
    return "## Current goals\n" + _table(["skill", "goal"], rows)


def _history(history: Sequence[Execution], settings: Settings) -> str:
    told = history[-settings.history :]
    rows = [
        [
            str(e.index + 1),
            str(e.formation) + (" after a retreat" if e.outcome.step.retreat else ""),
            _mm(e.outcome.step.goal, OWNED[e.formation]),
            *_checks(e.evidence, settings).values(),
            "success" if e.verdict.success else "failure",
        ]
        for e in told
    ]
    names = _checks(told[0].evidence, settings)
    return "## Earlier executions\n" + _table(["no", "skill", "goal", *names, "judged"], rows)


def _executed(case: Case, settings: Settings) -> str:
    outcome = case.outcome
    formation = outcome.step.formation
    checks = _checks(case.evidence, settings)
    return "\n".join(
        [
            f"## Executed last: no {len(case.history) + 1}, {formation}"
            + (" after a retreat" if outcome.step.retreat else ""),
            f"goal: {_mm(outcome.step.goal, OWNED[formation])}",
            f"terminal pose: {_mm(outcome.pose, _IN_PLANE)}",
            _compression(outcome),
            *(f"{name}: {told}" for name, told in checks.items() if told != _NOT_MADE),
        ]
    )


def _compression(outcome: Outcome) -> str:
    ended = "ended by the compression limit" if outcome.stop is Stop.COMPRESSION else "ran its way"
    return f"skill: {ended}, peak_compression_mm {outcome.peak_compression_m * 1e3:.1f}"


def _measured(case: Case) -> str:
    """pliant's own measurements, which the paper's model did not get."""
    lines = ["## Measured in the picture"]
    scene, belief = case.outcome.scene, case.belief
    if scene.peg is not None:
        lines.append(
            f"peg: tip_y_mm {_tenths(scene.peg.tip_y.value * 1e3)},"
            f" tip_z_mm {_tenths(scene.peg.tip_z.value * 1e3)},"
            f" tilt_deg {_tenths(scene.peg.tilt_deg)} (positive: to the left)"
        )
    if belief.hole_y is not None:
        lines.append(f"hole: y_mm {_tenths(belief.hole_y.value * 1e3)}")
    if belief.grasp_roll is not None:
        angle = Axis.ROLL.to_report(belief.grasp_roll.value)
        lines.append(f"peg's angle in the grasp: roll_deg {_tenths(angle)}")
    metric = case.evidence["metric"]
    if metric is not None:
        lines.append(f"metric check: {_told(metric)}")
    return "\n".join([*lines, *scene.problems])


def _checks(evidence: Evidence, settings: Settings) -> dict[str, str]:
    """What the paper's checks found, by the name that the model reads."""
    shown = {
        "pose_check": ("pose", settings.pose_check),
        "compression_check": ("compression", True),
        "table_i": ("table_i", settings.table_i),
    }
    return {label: _told(evidence[name]) for label, (name, on) in shown.items() if on}


def _told(check: Check | None) -> str:
    if check is None:
        return _NOT_MADE
    vote = {True: "success", False: "failure", None: "not available"}[check.vote]
    return vote if check.message == vote else f"{vote} ({check.message})"


def _mm(values: Pose | Partial, axes: Iterable[Axis]) -> str:
    """Values with the unit in the name: "y_mm -35.2, roll_deg 10.0"."""
    return ", ".join(f"{a}_{a.report_unit} {_tenths(a.to_report(values[a]))}" for a in axes)


def _tenths(value: float) -> str:
    """To a tenth, and nothing below zero is written "-0.0"."""
    return f"{round(value, 1) + 0.0:.1f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])


def _picture(image: NDArray[np.uint8], settings: Settings) -> BinaryContent:
    """A picture (height, width, 3), RGB, as PNG."""
    done, png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    assert done, "OpenCV encodes any 8-bit picture"
    return BinaryContent(
        png.tobytes(), media_type="image/png", vendor_metadata={"detail": str(settings.detail)}
    )
