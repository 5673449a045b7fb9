"""One execution as a card of the page: where it was sent and came to, what was seen, how it was
judged, what was planned next, and apart from it all, the truth."""

from collections.abc import Sequence
from dataclasses import dataclass

from pliant.cell import Stop, Truth
from pliant.formations import OWNED
from pliant.html import Html, join, tag
from pliant.pose import Axis
from pliant.records import Aborted, Check, Evidence, Execution, Verdict
from pliant.repeats import repeats
from pliant.report import words
from pliant.report.parts import badge, facts, notice, outcome, scrolled, section, truth_box
from pliant.report.plan import probes, recovery
from pliant.report.transcript import transcript
from pliant.store import Pictures

_AXES = (Axis.Y, Axis.Z, Axis.ROLL, Axis.X, Axis.PITCH, Axis.YAW)  # in the plane first
_CHECKS = {"table_i": "Table I", "goal_picture": "goal picture"}
_OPEN = 12  # executions, of which all cards are unfolded
_VOTES = {True: ("yes", "✓ yes"), False: ("no", "✗ no"), None: ("none", "– not made")}


@dataclass(frozen=True, kw_only=True)
class Media:
    """An execution's files, relative to the page, and whether there is a video of it."""

    snapshot: str
    overlay: str
    goal: str | None
    filmed: bool


def card(
    executions: Sequence[Execution],
    index: int,
    truth: Truth | None,
    media: Media,
    pictures: Pictures,
) -> Html:
    """The card of execution `index`, of a trial whose pictures lie in `pictures`. Of a long trial
    only the last is unfolded."""
    execution = executions[index]
    name, number = str(execution.formation).capitalize(), execution.index + 1
    repeat = repeats(executions[: index + 1])[-1]
    return tag(
        "article",
        tag(
            "header",
            tag("h3", f"{number} · {name}", id=f"title-{number}"),
            badge(outcome(execution.verdict.success), execution.verdict.success),
            _instead(execution),
            _video_button(execution.index) if media.filmed else Html(""),
        ),
        Html("") if repeat is None else notice(str(repeat).capitalize()),
        tag(
            "details",
            tag("summary", execution.verdict.reason or "no reason given"),
            _pictures(execution, media),
            tag(
                "div",
                section("Goal and terminal pose", _poses(execution), _motions(execution)),
                section("Checks", _checks(execution.evidence)),
                section("Verdict", _verdict(execution.verdict, pictures)),
                probes(execution.probes, pictures),
                recovery(executions, index, pictures),
                class_="parts",
            ),
            _truth(truth),
            open=len(executions) <= _OPEN or number == len(executions),
        ),
        id=f"execution-{number}",
        class_=f"card {outcome(execution.verdict.success)}",
        aria_labelledby=f"title-{number}",
    )


def _instead(execution: Execution) -> Html:
    """A badge beside the outcome that says what the rules decided in a model's place; empty:
    nothing."""
    recovery = execution.recovery
    decisions = {"judged": execution.verdict.fallback, "planned": recovery and recovery.fallback}
    done = " and ".join(what for what, why in decisions.items() if why)
    return tag("span", f"{done} by the rules", class_="badge failure") if done else Html("")


def aborted(begun: Aborted, number: int, why: str) -> Html:
    """The card of the execution that a fault ended before it was judged: it is not counted."""
    name = str(begun.step.formation).capitalize()
    peak = max((motion.peak_compression_m for motion in begun.motions), default=None)
    pairs = [
        ("step", words.step(begun.step)),
        ("when it ended", "the arm stood still" if begun.under_way is None else "on its way"),
        *([] if begun.under_way is None else [("to", words.pose(begun.under_way))]),
        ("motions done", str(len(begun.motions))),
        *([] if peak is None else [("peak compression", words.millimetres(peak))]),
    ]
    return tag(
        "article",
        tag(
            "header",
            tag("h3", f"{number} · {name}, not finished", id="title-aborted"),
            badge("not judged", success=False),
        ),
        tag("div", section("Begun", notice(why), facts(pairs)), class_="parts"),
        id="aborted",
        class_="card failure",
        aria_labelledby="title-aborted",
    )


def _video_button(index: int) -> Html:
    return tag(
        "button",
        "▶ in the video",
        type="button",
        data_execution=str(index),
        aria_label=f"Show execution {index + 1} in the video",
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
    motions = execution.outcome.motions
    commanded = motions[-1].commanded if motions else target
    error = target.error(reached, _AXES)
    rows = [
        ("goal", {a: words.number(a.to_report(target[a])) for a in _AXES}),
        ("commanded", {a: words.number(a.to_report(commanded[a])) for a in _AXES}),
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
    caption = (
        f"Shaded: the axes that {execution.formation} owns. Commanded: the last motion's end, after"
        " the envelope."
    )
    return scrolled(head, body, caption)


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
    return scrolled(
        ["check", "success?", "message"],
        [_check(c) for c in evidence.checks],
        "* added by pliant. What each check asks: Words on this page, at the top.",
    )


def _check(check: Check) -> Html:
    kind, vote = _VOTES[check.vote]
    return tag(
        "tr",
        tag("th", _CHECKS.get(check.name, check.name), "" if check.paper else " *", scope="row"),
        tag("td", vote, class_=f"vote {kind}"),
        tag("td", check.message),
    )


def _verdict(verdict: Verdict, pictures: Pictures) -> Html:
    fallback = Html("")
    if verdict.fallback:
        fallback = notice(f"The rules judged in the model's place: {verdict.fallback}")
    pairs = [
        ("verdict", outcome(verdict.success)),
        ("reason", verdict.reason),
        ("votes", ", ".join(_vote(*vote) for vote in verdict.votes.items()) or "none"),
        ("conflict", _named(verdict.conflict or "none")),
        ("by", verdict.by),
    ]
    return join(fallback, facts(pairs), transcript(verdict.exchanges, pictures))


def _named(conflict: str) -> str:
    for name, shown in _CHECKS.items():
        conflict = conflict.replace(name, shown)
    return conflict


def _vote(source: str, vote: bool | None) -> str:
    return f"{_CHECKS.get(source, source)} {_VOTES[vote][1]}"


# --- truth -------------------------------------------------------------------------------------


def _truth(truth: Truth | None) -> Html:
    return truth_box(words.truth(truth)) if truth is not None else Html("")
