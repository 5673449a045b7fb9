"""A trial as one static page: it needs no network and opens from a folder."""

from collections.abc import Sequence
from importlib.resources import files

from pliant.records import Trial
from pliant.report import words
from pliant.report.card import Media, badge, card, facts, outcome, truth_box
from pliant.report.html import Html, join, tag


def render(trial: Trial, media: Sequence[Media], *, video: str | None) -> str:
    """The page's text. `media` holds each execution's files, `video` the video's, relative to
    where the page will be."""
    title = (
        f"{trial.task.peg.name.capitalize()} peg, condition {trial.condition}, seed {trial.seed}"
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", f"{title} · pliant"),
        tag("style", _own("page.css")),
    )
    body = tag(
        "body",
        tag(
            "main",
            _headline(trial, title),
            _strip(trial, media),
            _video(video),
            _executions(trial, media),
        ),
        tag("script", _own("page.js")),
    )
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _own(name: str) -> Html:
    return Html((files("pliant.report") / name).read_text())


def _headline(trial: Trial, title: str) -> Html:
    reasoner = trial.reasoner if trial.model is None else f"{trial.reasoner} ({trial.model})"
    pairs = [
        ("judged inserted", words.yes_no(trial.judged)),
        ("inserted (truth)", words.yes_no(trial.inserted)),
        ("end reason", trial.end_reason),
        ("reasoner", reasoner),
        ("executions", str(len(trial.executions))),
        ("simulated time", f"{words.number(trial.simulated_s)} s"),
        ("task level", trial.task.level),
        ("trial", trial.trial_id),
    ]
    drawn = [words.drawn(name, value) for name, value in trial.drawn.items()]
    return tag(
        "header",
        tag("div", tag("h1", title), badge(words.end(trial), trial.judged), class_="title"),
        facts(pairs),
        truth_box(drawn) if drawn else Html(""),
        class_="headline",
    )


def _strip(trial: Trial, media: Sequence[Media]) -> Html:
    if not trial.executions:
        return tag("p", "No skill was executed.")
    snapshots = []
    for execution, file in zip(trial.executions, media, strict=True):
        name, success = str(execution.formation).capitalize(), execution.verdict.success
        number = execution.index + 1
        alt = f"The peg and the hole after execution {number}, {name}: {outcome(success)}"
        sign = tag("span", "✓" if success else "✗", aria_hidden="true")
        caption = tag("span", sign, f" {name}", class_=f"name {outcome(success)}")
        picture = tag("img", src=file.snapshot, alt=alt, width="640", height="480")
        link = tag("a", caption, picture, href=f"#execution-{number}")
        snapshots.append(tag("li", link))
    return tag(
        "section",
        tag("h2", "Snapshots", id="snapshots"),
        tag("ol", *snapshots, class_="strip"),
        aria_labelledby="snapshots",
    )


def _video(source: str | None) -> Html:
    if source is None:
        return Html("")
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
    title = tag("h2", "Video", id="video")
    return tag("section", title, player, aria_labelledby="video")


def _executions(trial: Trial, media: Sequence[Media]) -> Html:
    truths = [*trial.truths, *[None] * len(trial.executions)]
    cards = [card(e, truths[n], media[n]) for n, e in enumerate(trial.executions)]
    return tag("section", tag("h2", "Executions", id="executions"), join(*cards))
