"""One execution as a card of the page: where it was sent and came to, what was seen, how it was
judged, what was planned next, and apart from it all, the truth."""

from dataclasses import dataclass

from pliant.cell import Stop, Truth
from pliant.formations import OWNED
from pliant.pose import Axis
from pliant.records import Check, Evidence, Exchange, Execution, Verdict
from pliant.report import words
from pliant.report.html import Html, join, tag

_AXES = (Axis.Y, Axis.Z, Axis.ROLL, Axis.X, Axis.PITCH, Axis.YAW)  # in the plane first
_CHECKS = {"table_i": "Table I", "goal_picture": "goal picture"}
_VOTES = {True: ("yes", "✓ yes"), False: ("no", "✗ no"), None: ("none", "– not made")}


@dataclass(frozen=True, kw_only=True)
class Media:
    """An execution's files, relative to the page, and its place in the video [s]."""

    snapshot: str
    overlay: str
    goal: str | None
    start_s: float | None


def card(execution: Execution, truth: Truth | None, media: Media) -> Html:
    name, number = str(execution.formation).capitalize(), execution.index + 1
    return tag(
        "article",
        tag(
            "header",
            tag("h3", f"{number} · {name}", id=f"title-{number}"),
            badge(outcome(execution.verdict.success), execution.verdict.success),
            _video_button(number, media.start_s),
        ),
        _pictures(execution, media),
        tag(
            "div",
            section("Goal and terminal pose", _poses(execution), _motions(execution)),
            section("Checks", _checks(execution.evidence)),
            section("Verdict", _verdict(execution.verdict)),
            _recovery(execution),
            class_="parts",
        ),
        _truth(truth),
        id=f"execution-{number}",
        class_=f"card {outcome(execution.verdict.success)}",
        aria_labelledby=f"title-{number}",
    )


def badge(name: str, success: bool) -> Html:
    """A word with a tick or a cross, on the verdict's colour."""
    return tag("span", f"{'✓' if success else '✗'} {name}", class_=f"badge {outcome(success)}")


def outcome(success: bool) -> str:
    return "success" if success else "failure"


def section(title: str, *content: Html) -> Html:
    return tag("section", tag("h4", title), *content)


def facts(pairs: list[tuple[str, str]]) -> Html:
    """Names and values."""
    rows = (tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs)
    return tag("dl", *rows, class_="facts")


def table(head: list[str], rows: list[Html], caption: str) -> Html:
    columns = (tag("th", name, scope="col") for name in head)
    return tag(
        "div",
        tag(
            "table",
            tag("caption", caption),
            tag("thead", tag("tr", *columns)),
            tag("tbody", *rows),
        ),
        class_="scroll",
    )


def _video_button(number: int, start_s: float | None) -> Html:
    if start_s is None:
        return Html("")
    return tag(
        "button",
        "▶ in the video",
        type="button",
        data_start=f"{start_s:.2f}",
        aria_label=f"Show execution {number} in the video",
    )


def _pictures(execution: Execution, media: Media) -> Html:
    name = execution.formation
    figures = [_figure(media.overlay, f"After {name}, with what was measured drawn in", "reached")]
    if media.goal is not None:
        figures.append(
            _figure(media.goal, f"Goal picture of {name}, measured likewise", "taught goal")
        )
    return tag("div", *figures, class_="pictures")


def _figure(source: str, alt: str, caption: str) -> Html:
    picture = tag("img", src=source, alt=alt, width="640", height="480", loading="lazy")
    return tag("figure", tag("a", picture, href=source), tag("figcaption", caption))


# --- motion ------------------------------------------------------------------------------------


def _poses(execution: Execution) -> Html:
    target, reached = execution.outcome.target, execution.outcome.pose
    error = target.error(reached, _AXES)
    rows = [
        ("goal", {a: words.number(a.to_report(target[a])) for a in _AXES}),
        ("reached", {a: words.number(a.to_report(reached[a])) for a in _AXES}),
        ("difference", {a: words.number(a.to_report(error[a]), sign=True) for a in _AXES}),
    ]
    owned = OWNED[execution.formation]
    body = [
        tag(
            "tr",
            tag("th", name, scope="row"),
            *(tag("td", cells[a], class_="owned" if a in owned else None) for a in _AXES),
        )
        for name, cells in rows
    ]
    head = ["", *(f"{a} [{a.report_unit.replace('deg', '°')}]" for a in _AXES)]
    return table(head, body, f"Shaded: the axes that {execution.formation} owns.")


def _motions(execution: Execution) -> Html:
    result = execution.outcome
    stop = "reached its goal" if result.stop is Stop.REACHED else "stopped by compression"
    pairs = [
        ("stop", stop),
        ("peak compression", words.millimetres(result.peak_compression_m)),
        ("motions", f"{len(result.motions)}{', after a retreat' if result.step.retreat else ''}"),
    ]
    return facts(pairs)


# --- judgement ---------------------------------------------------------------------------------


def _checks(evidence: Evidence) -> Html:
    return table(
        ["check", "success?", "message"],
        [_check(c) for c in evidence.checks],
        "* added by pliant; the others are the paper's.",
    )


def _check(check: Check) -> Html:
    kind, vote = _VOTES[check.vote]
    return tag(
        "tr",
        tag("th", _CHECKS.get(check.name, check.name), "" if check.paper else " *", scope="row"),
        tag("td", vote, class_=f"vote {kind}"),
        tag("td", check.message),
    )


def _verdict(verdict: Verdict) -> Html:
    pairs = [
        ("verdict", outcome(verdict.success)),
        ("reason", verdict.reason),
        ("conflict", verdict.conflict or "none"),
        ("by", verdict.by),
    ]
    return join(facts(pairs), _exchanges(verdict.exchanges))


def _recovery(execution: Execution) -> Html:
    recovery, admission = execution.recovery, execution.admission
    if recovery is None:
        if execution.verdict.success:
            return Html("")
        return section("Recovery", tag("p", "None was planned."))
    analysis = recovery.analysis
    pairs = [
        ("what happened", analysis.what),
        ("why", analysis.why),
        ("how to recover", analysis.how),
        ("motion", words.goal(analysis.motion) or "none"),
        ("by", recovery.by),
    ]
    admitted = admission.steps if admission is not None else ()
    rows = [
        tag(
            "tr",
            tag("td", words.step(planned)),
            tag("td", words.step(admitted[n]) if n < len(admitted) else "refused"),
        )
        for n, planned in enumerate(recovery.steps)
    ]
    plan = (
        table(["planned", "admitted"], rows, "The plan, and what of it may be done.")
        if rows
        else tag("p", "No steps: stop.")
    )
    refusals = [tag("li", reason) for reason in (admission.refusals if admission else ())]
    refused = join(tag("p", "Refused:"), tag("ul", *refusals)) if refusals else Html("")
    return section("Recovery", facts(pairs), plan, refused, _exchanges(recovery.exchanges))


def _exchanges(exchanges: tuple[Exchange, ...]) -> Html:
    return join(*(_exchange(n, e) for n, e in enumerate(exchanges, start=1)))


def _exchange(number: int, exchange: Exchange) -> Html:
    cost = "" if exchange.cost_usd is None else f", {exchange.cost_usd:.4f} USD"
    used = f"{exchange.model}, {exchange.tokens} tokens, {exchange.latency_s:.1f} s{cost}"
    refused = tag("p", f"Not used: {exchange.refused}") if exchange.refused else Html("")
    return tag(
        "details",
        tag("summary", f"Exchange {number}, {exchange.stage}, with {used}"),
        tag("h5", "Request"),
        tag("pre", exchange.request),
        tag("h5", "Reply"),
        tag("pre", exchange.reply),
        refused,
    )


# --- truth -------------------------------------------------------------------------------------


def _truth(truth: Truth | None) -> Html:
    return truth_box(words.truth(truth)) if truth is not None else Html("")


def truth_box(pairs: list[tuple[str, str]]) -> Html:
    """Facts that only the experiment knows, set apart."""
    title = tag("h4", "Ground truth, not seen by the method")
    return tag("aside", title, facts(pairs), class_="truth")
