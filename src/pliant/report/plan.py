"""The display of a recovery: the analysis, and each step from what was proposed over what was
admitted to what was commanded."""

from collections.abc import Sequence

from pliant.formations import OWNED, Step
from pliant.html import Html, join, tag
from pliant.records import Execution, FailureAnalysis, Probed, Recovery
from pliant.report import words
from pliant.report.parts import facts, notice, section, table
from pliant.report.transcript import thumbnails, transcript
from pliant.store import Pictures
from pliant.table import Table


def probes(found: Sequence[Probed], pictures: Pictures) -> Html:
    """The probes that were made before a recovery was planned; empty where there was none."""
    if not found:
        return Html("")
    told = [
        tag(
            "li",
            tag("p", f"{probed}."),
            tag("p", f"Why: {probed.probe.reason} (by {probed.probe.by})"),
            thumbnails(
                [
                    (view.image, f"Probe {number}, {name} camera")
                    for name, view in probed.looks[-1].observation.views.items()
                ],
                pictures,
            ),
            transcript(probed.probe.exchanges, pictures),
        )
        for number, probed in enumerate(found, start=1)
    ]
    return section("Probes", tag("ol", *told, class_="probes"))


def recovery(executions: Sequence[Execution], index: int, pictures: Pictures) -> Html:
    """The recovery that was planned after execution `index` failed; empty after a success."""
    execution = executions[index]
    found, admission = execution.recovery, execution.admission
    if found is None:
        if execution.verdict.success:
            return Html("")
        return section("Recovery", tag("p", "None was planned."))
    refusals = [tag("li", reason) for reason in (admission.refusals if admission else ())]
    refused = join(tag("p", "Refused:"), tag("ul", *refusals)) if refusals else Html("")
    return section(
        "Recovery",
        _departures(found),
        _analysis(found.analysis, found.by),
        _steps(executions, index),
        refused,
        transcript(found.exchanges, pictures),
    )


def _departures(found: Recovery) -> Html:
    """Notices where the plan is not the model's own, or it was silent about probes, plainly."""
    notices = []
    if found.no_answer_about_probes:
        notices.append(
            notice(
                "No usable answer, when asked whether it needs a probe:"
                f" {found.no_answer_about_probes}"
            )
        )
    if found.fallback:
        notices.append(notice(f"The rules planned in the model's place: {found.fallback}"))
    if found.clamped is not None:
        notices.append(notice("Clamped: the model's plan was cut down to what may be done."))
    return join(*notices)


def _analysis(analysis: FailureAnalysis, by: str) -> Html:
    pairs = [
        ("what happened", analysis.what),
        ("why", analysis.why),
        ("how to recover", analysis.how),
        ("motion", words.goal(analysis.motion) or "none"),
        ("by", by),
    ]
    if analysis.changes:
        told = "; ".join(f"{f} {words.goal(by)}" for f, by in analysis.changes.items())
        pairs.insert(4, ("change of each goal", told))
    return facts(pairs)


def _steps(executions: Sequence[Execution], index: int) -> Html:
    found, admission = executions[index].recovery, executions[index].admission
    assert found is not None
    if not found.steps and not found.clamped:
        return tag("p", "No steps: stop.")
    proposed = found.steps if found.clamped is None else found.clamped
    admitted = admission.steps if admission is not None else ()
    columns = [
        [words.step(step) for step in proposed],
        [words.step(step) for step in found.steps],
        [
            words.step(admitted[n]) if n < len(admitted) else "refused"
            for n in range(len(found.steps))
        ],
        _commanded(executions, index, admitted),
    ]
    head = ["proposed", "clamped to", "admitted", "commanded"]
    if found.clamped is None:
        del columns[1], head[1]
    rows = [
        [column[n] if n < len(column) else "–" for column in columns]
        for n in range(max(map(len, columns)))
    ]
    caption = "Proposed, what of it may be done, and the goal that the robot was then given."
    return table(Table(head, rows), caption)


def _commanded(executions: Sequence[Execution], index: int, admitted: Sequence[Step]) -> list[str]:
    """The command that followed each admitted step, or why there was none."""
    shown: list[str] = []
    for n in range(1, len(admitted) + 1):
        if index + n >= len(executions):
            shown.append("not reached: the trial ended")
            continue
        later = executions[index + n]
        result = later.outcome
        goal = {axis: result.target[axis] for axis in OWNED[later.formation]}
        link = tag("a", f"execution {later.index + 1}", href=f"#execution-{later.index + 1}")
        shown.append(join(f"{str(later.formation).capitalize()} to {words.goal(goal)}, ", link))
        if later.recovery is not None:
            shown += ["not reached: planned anew"] * (len(admitted) - n)
            break
    return shown
