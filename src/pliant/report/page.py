"""A trial as one static page: it needs no network and opens from a folder."""

from collections.abc import Mapping, Sequence

from pliant.conditions import NOMINAL, PAPER_RANGES
from pliant.experiment.faults import is_unmeasured
from pliant.experiment.rows import decided, exchanges, trial_row
from pliant.html import Html, join, tag
from pliant.records import Trial
from pliant.repeats import of_which
from pliant.report import timeline, words
from pliant.report.card import Media, aborted, card
from pliant.report.document import document
from pliant.report.legend import legend
from pliant.report.parts import badge, chapter, facts, notice, outcome, truth_box
from pliant.report.video import Span
from pliant.store import Pictures


def render(
    trial: Trial,
    media: Sequence[Media],
    pictures: Pictures,
    *,
    video: str | None = None,
    spans: Sequence[Span] | None = None,
    library: str,
    home: str | None = None,
    stamp: str = "",
    own_ranges: Mapping[str, tuple[float, float]] | None = None,
) -> str:
    """The text of a trial's page. `media` holds each execution's files; `video` is the video's, in
    which each execution has its span; `library` and `home` are the ways to the library's folder and
    to the experiment's page. All are relative to where the page will be. `own_ranges` are those
    that were given in place of the condition's."""
    ranges = ", ".join(words.drawn_range(*one) for one in (own_ranges or {}).items())
    title = (
        f"{trial.task.peg.name.capitalize()} peg, {trial.level}, condition {trial.condition}"
        f"{f' ({ranges})' if ranges else ''}, seed {trial.seed}: {trial.reasoner}, {trial.method}"
    )
    return document(
        title,
        tag("nav", tag("a", "← the experiment", href=home), aria_label="Up") if home else Html(""),
        _headline(trial, title),
        legend(trial),
        _strip(trial, media),
        *_timeline(trial, video, spans),
        _executions(trial, media, pictures),
        script="trial.js",
        style="trial.css",
        data=timeline.data(trial, spans),
        stamp=stamp,
        library=library,
    )


def _believed(trial: Trial) -> list[tuple[str, str]]:
    """What the signs said to be so in the end, where something was not as the task says."""
    believed = trial.diagnosis
    if believed is None or believed.is_as_told:
        return []
    return [("believed to be so", str(believed))]


def _ended(trial: Trial) -> str:
    said = words.end(trial)
    return said if said.startswith(trial.end_reason) else f"{trial.end_reason}: {said}"


def _headline(trial: Trial, title: str) -> Html:
    reasoner = trial.reasoner if trial.model is None else f"{trial.reasoner} ({trial.model})"
    measured = not is_unmeasured(trial.end_reason)
    pairs = [
        ("judged inserted", words.yes_no(trial.judged if measured else None)),
        ("inserted (truth)", words.yes_no(trial.inserted if measured else None)),
        ("end reason", _ended(trial)),
        *_believed(trial),
        ("reasoner", reasoner),
        ("executions", f"{len(trial.executions)}{of_which(trial.executions)}"),
        ("simulated time", f"{words.number(trial.simulated_s)} s"),
        ("method", trial.method),
        ("level", trial.level),
        ("trial", trial.trial_id),
        *_model_calls(trial),
    ]
    drawn = [
        words.drawn(name, value)
        for name, value in trial.drawn.items()
        if name in PAPER_RANGES or value != NOMINAL[name]
    ]
    return tag(
        "header",
        tag("div", tag("h1", title), badge(words.end(trial), trial.judged), class_="title"),
        _not_its_own(trial),
        facts(pairs),
        truth_box(drawn) if drawn else Html(""),
        class_="headline",
    )


def _not_its_own(trial: Trial) -> Html:
    """A notice of how much of a trial was not decided by the model that was asked, plainly and
    first; empty: all was its own."""
    row = trial_row(trial)
    if row["own"] == row["decisions"]:
        return Html("")
    return notice(f"{decided(row).capitalize()}.")


def _model_calls(trial: Trial) -> list[tuple[str, str]]:
    """Facts about the model's calls: their number and cost, and how often the rules answered in its
    place."""
    row = trial_row(trial)
    if not row["decisions"]:
        return []
    calls = [call for execution in trial.executions for call in exchanges(execution)]
    cost = row["cost_usd"]
    return [
        ("model calls", f"{len(calls)}, {sum(bool(x.refused) for x in calls)} not used"),
        ("tokens", f"{row['tokens']:,}"),
        ("waited for the model", f"{words.number(row['latency_s'])} s"),
        ("cost", "not known" if cost is None else f"{cost:.4f} USD"),
        ("decided by the model", f"{row['own']} of {row['decisions']}"),
        ("decided by the rules instead", f"{row['fallbacks']} of {row['decisions']}"),
        ("plans clamped", str(row["clamped"])),
    ]


def _strip(trial: Trial, media: Sequence[Media]) -> Html:
    if not trial.executions:
        begun = trial.aborted is not None
        return tag("p", "No skill ended." if begun else "No skill was executed.")
    snapshots = []
    for execution, file in zip(trial.executions, media, strict=True):
        name, success = str(execution.formation).capitalize(), execution.verdict.success
        number = execution.index + 1
        alt = f"The peg and the hole after execution {number}, {name}: {outcome(success)}"
        sign = tag("span", "✓" if success else "✗", aria_hidden="true")
        caption = tag("span", sign, f" {number} {name}", class_=f"name {outcome(success)}")
        picture = tag("img", src=file.snapshot, alt=alt, width="640", height="480")
        link = tag("a", caption, picture, href=f"#execution-{number}")
        snapshots.append(tag("li", link))
    label = "Snapshots in the order of time"
    strip = tag("ol", *snapshots, class_="strip", aria_label=label)
    return chapter("Snapshots", "snapshots", strip)


def _timeline(trial: Trial, video: str | None, spans: Sequence[Span] | None) -> list[Html]:
    if not trial.executions:
        return [] if video is None else [chapter("Video", "video", _player(video))]
    shown = [] if video is None else [_player(video)]
    return [
        chapter("Timeline", "timeline", *shown, timeline.bar(trial, spans)),
        chapter("Measured by the robot", "measured", timeline.plots(trial)),
    ]


def _player(source: str) -> Html:
    player = tag(
        "video",
        tag("a", "The video", href=source),
        src=source,
        controls=True,
        muted=True,
        playsinline=True,
        preload="metadata",
        aria_label="The whole trial from the side and from afar",
    )
    return tag("div", player, class_="player")


def _executions(trial: Trial, media: Sequence[Media], pictures: Pictures) -> Html:
    truths = [*trial.truths, *[None] * len(trial.executions)]
    cards = [
        card(trial.executions, n, truths[n], media[n], pictures)
        for n in range(len(trial.executions))
    ]
    if trial.aborted is not None:
        cards.append(aborted(trial.aborted, len(trial.executions) + 1, words.end(trial)))
    return chapter("Executions", "executions", join(*cards))
