"""A trial along time: a bar of its executions under the video, and what the robot measured."""

import math
from collections.abc import Sequence
from dataclasses import astuple
from typing import Any

from pliant.cell import Motion
from pliant.checks import POSE_TOLERANCE_M, POSE_TOLERANCE_RAD
from pliant.formations import OWNED
from pliant.html import Html, join, tag
from pliant.pose import Axis
from pliant.records import Execution, Trial
from pliant.repeats import repeats
from pliant.report import words
from pliant.report.parts import outcome
from pliant.report.video import Span

SHOWN = (Axis.Y, Axis.Z, Axis.ROLL)
COMPRESSION = "compression"
_MOST_SAMPLES = 4000  # of a trial, so that a page stays small
_LEAST_WIDTH = 3.2  # [em] of an execution's button: its sign and its number


def bar(trial: Trial, spans: Sequence[Span] | None) -> Html:
    """The executions side by side, each as wide as it is long, to choose from. The bar scrolls
    where they do not fit: the shortest still shows its number."""
    lengths = [
        max(0.1, spans[n].ends - spans[n].begins if spans else ends - begins)
        for n, (begins, ends) in enumerate(times(trial))
    ]
    em = _LEAST_WIDTH / min(lengths, default=1.0)  # a second's width
    buttons = []
    for execution, repeat, (begins, ends) in zip(
        trial.executions, repeats(trial.executions), times(trial), strict=True
    ):
        name, success = str(execution.formation).capitalize(), execution.verdict.success
        number = execution.index + 1
        again = "" if repeat is None else f", {repeat}"
        button = tag(
            "button",
            tag("span", "✓" if success else "✗", aria_hidden="true"),
            f" {number} {name}",
            "" if repeat is None else tag("span", " ↻", aria_hidden="true"),
            type="button",
            class_=outcome(success),
            data_execution=str(execution.index),
            title=f"{number} {name}: {outcome(success)}, {begins:.1f} to {ends:.1f} s{again}",
            aria_label=f"Execution {number}, {name}: {outcome(success)}{again}. Go there.",
        )
        length = lengths[execution.index]
        style = f"flex: {length:.2f} 0 {length * em:.2f}em"
        buttons.append(tag("li", button, style=style))
    label = "Executions in the order of time"
    how = (
        "As wide as it takes time. ✓ judged a success, ✗ striped: a failure, ↻ a state that was"
        " there before. Choose an execution to go there; the arrow keys move between them."
    )
    return join(
        tag("ol", *buttons, class_="timeline", aria_label=label, tabindex="-1"),
        tag("p", how, class_="hint"),
    )


def plots(trial: Trial) -> Html:
    """The places of the plots, which the page's script draws."""
    return join(
        *(_plot(trial, of) for of in (*SHOWN, COMPRESSION)), tag("p", _LEGEND, class_="hint")
    )


_LEGEND = (
    "Robot time, from the motions' measurements; between motions the arm holds where it is. Dashed:"
    " the goal of each execution, with the pose check's tolerance shaded where its formation owns"
    " the axis. Hatched, with ✗ above: judged a failure. Red, dotted: limits. The upright line is"
    " the video's time: a click takes the video there. Drag to look closer, double-click to see"
    " all."
)


def data(trial: Trial, spans: Sequence[Span] | None) -> dict[str, Any]:
    """The data that the page's script draws: times [s], lengths [mm], angles [deg]."""
    limits = trial.limits
    motions = [motion for e in trial.executions for motion in e.motions]
    motions += trial.aborted.motions if trial.aborted is not None else ()
    every = math.ceil(sum(len(m.trace.time_s) for m in motions) / _MOST_SAMPLES) or 1
    return {
        "executions": [
            {
                "name": str(execution.formation).capitalize(),
                "success": execution.verdict.success,
                "time": [_number(t, 3) for t in robot],
                "video": [*astuple(spans[execution.index])] if spans else None,
                "goal": {a: _report(a, execution.outcome.target[a]) for a in SHOWN},
                "owned": list(OWNED[execution.formation]),
            }
            for execution, robot in zip(trial.executions, times(trial), strict=True)
        ],
        "tolerance": {
            a: _report(a, POSE_TOLERANCE_RAD if a.is_angle else POSE_TOLERANCE_M) for a in SHOWN
        },
        "limits": {
            **{a: [_report(a, limits.low[a]), _report(a, limits.high[a])] for a in SHOWN},
            COMPRESSION: [limits.compression_m * 1e3],
        },
        "traces": _traces(motions, every),
    }


def times(trial: Trial) -> list[tuple[float, float]]:
    """The times at which each execution begins and is judged, on the robot's clock [s]."""
    result: list[tuple[float, float]] = []
    for execution in trial.executions:
        motions = execution.outcome.motions
        ends = execution.outcome.looks[-1].observation.time_s
        result.append((motions[0].started_s if motions else ends, ends))
    return result


def _traces(motions: Sequence[Motion], every: int) -> dict[str, list[float | None]]:
    """Columns of a plot over all motions. Between them the arm holds, and a line joins them."""
    columns: dict[str, list[float | None]] = {n: [] for n in ("time", *SHOWN, COMPRESSION)}
    order = list(Axis)
    for motion in motions:
        trace = motion.trace
        for n in range(0, len(trace.time_s), every):
            columns["time"].append(_number(float(trace.time_s[n]), 3))
            for axis in SHOWN:
                columns[axis].append(_report(axis, float(trace.pose[n][order.index(axis)])))
            columns[COMPRESSION].append(_number(float(trace.compression_m[n]) * 1e3, 2))
    return columns


def _plot(trial: Trial, of: str) -> Html:
    """The place of one plot, described for those who cannot see it."""
    name, unit = ("compression", "mm") if of == COMPRESSION else (of, Axis(of).report_unit)
    shown = unit.replace("deg", "°")
    return tag(
        "figure",
        tag("figcaption", f"{name} [{shown}]"),
        tag("div", class_="plot", data_of=of, role="img", aria_label=_described(trial, of)),
        class_="wide",
    )


def _described(trial: Trial, of: str) -> str:
    parts = []
    for execution in trial.executions:
        reached = _reached(execution, of)
        parts.append(f"{execution.index + 1} {execution.formation} {reached}")
    return f"{of} over time; by execution: {'; '.join(parts)}"


def _reached(execution: Execution, of: str) -> str:
    result = execution.outcome
    if of == COMPRESSION:
        return f"peak {words.millimetres(result.peak_compression_m)}"
    axis = Axis(of)
    goal, came = words.in_units(axis, result.target[axis]), words.in_units(axis, result.pose[axis])
    return f"goal {goal}, reached {came}"


def _report(axis: Axis, value: float) -> float | None:
    return _number(axis.to_report(value), 2)


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
