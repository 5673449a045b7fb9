"""The benchmark's tables as Markdown."""

from collections.abc import Callable
from typing import Any

from pliant.experiment.bench.blind import Pictures
from pliant.experiment.measures import is_undecided
from pliant.experiment.table_cells import (
    NONE,
    Document,
    interval,
    marked,
    marked_name,
    own_percent,
    rate,
)
from pliant.table import Table
from pliant.text import escaped, rounded

_Row = tuple[str, Document]
"""A reasoner's name as it is shown, and its scores of all cases."""
_Columns = dict[str, Callable[[_Row], object]]
_NAME: _Columns = {"reasoner": lambda row: row[0]}


def markdown(document: Document) -> str:
    """All tables of a document of `run`, as Markdown."""
    document = escaped(document)
    n, of = document["cases"]["n"], document["cases"]["of"]
    part = "" if n == of else f", the first {n}"
    shown = document["cases"].get("pictures", Pictures.OWN)  # of before there were others
    part += "" if shown == Pictures.OWN else f", with {shown} pictures, which is not seeing"
    sections = [
        f"Case set {document['cases']['hash']}, {of} cases{part}. Percentages and distances"
        " stand with their 95 % intervals, which the JSON has for every group, too.",
        "## Judging",
        judging(document),
        "## Planning, after true failures",
        planning(document),
        "## Stopping",
        stopping(document),
        "## What it cost",
        spending(document),
        "## By kind of case",
        grouped(document, "kind"),
        "## By formation",
        grouped(document, "formation"),
    ]
    return "\n\n".join(sections) + "\n"


def judging(document: Document) -> str:
    """A table of how reasoners judge."""
    return _table(
        document,
        {
            "n": lambda row: row[1]["n"],
            **_own_beside(document),
            "balanced accuracy [%]": lambda row: _or_none(row[1]["balanced_accuracy"], interval),
            "false accepts [%]": _rate("false_accepts"),
            "false rejects [%]": _rate("false_rejects"),
        },
    )


def planning(document: Document) -> str:
    """A table of what reasoners plan after true failures."""
    return _table(
        document,
        {
            **_own_beside(document),
            "valid [%]": _rate("plan_valid"),
            "resumes right [%]": _rate("start_right"),
            "retreat right [%]": _rate("retreat_right"),
            "direction right [%]": _rate("direction_right"),
            "reaches at once [%]": _rate("reaches"),
            "toward the goal [mm], median; mean": lambda row: _or_none(
                row[1]["toward_mm"], _toward
            ),
        },
    )


def stopping(document: Document) -> str:
    """A table of how often reasoners stop, for those that were asked where it is right to stop."""
    columns: _Columns = {
        **_NAME,
        "stops where no motion helps [%]": _rate("stops"),
        "stops where going on is right [%]": _rate("stops_needlessly"),
    }
    asked = [row for row in _rows(document) if row[1].get("stops", {}).get("n")]
    return Table.of(asked, columns).markdown()


def spending(document: Document) -> str:
    """A table of what the reasoners' models cost."""
    columns: _Columns = {
        **_NAME,
        "own decisions [%]": lambda row: own_percent(_share(row[1])),
        "requests": lambda row: row[1]["requests"],
        "tokens per case": lambda row: _tokens(row[1]),
        "US cents per case": lambda row: _or_none(
            row[1]["cost_usd"], lambda usd: f"{100 * usd / row[1]['n']:.2f}"
        ),
        "wait per decision p50, p95 [s]": lambda row: _or_none(
            row[1]["latency_s"], lambda s: f"{s['p50']:.1f}, {s['p95']:.1f}"
        ),
    }
    return Table.of(_rows(document), columns).markdown()


def grouped(document: Document, by: str) -> str:
    """A table of the scores that tell groups apart, as counts; the JSON has their intervals."""
    scores = {
        "false accepts": "false_accepts",
        "false rejects": "false_rejects",
        "resumes right": "start_right",
        "direction right": "direction_right",
        "reaches at once": "reaches",
    }
    rows = [
        [
            *(_name(name, s["all"]), group, g["n"]),
            _or_none(g["balanced_accuracy"], lambda score: f"{score['percent']:.1f}"),
            *(_of(g[score]) for score in scores.values()),
        ]
        for name, s in document["reasoners"].items()
        for group, g in sorted(s[f"by_{by}"].items())
    ]
    return Table(["reasoner", by, "n", "balanced accuracy [%]", *scores], rows).markdown()


def undecided(document: Document) -> list[str]:
    """The reasoners whose model was asked, and decided nothing."""
    return [n for n, s in document["reasoners"].items() if is_undecided(_share(s["all"]))]


def _rows(document: Document) -> list[_Row]:
    return [(_name(name, s["all"]), s["all"]) for name, s in document["reasoners"].items()]


def _table(document: Document, columns: _Columns) -> str:
    """A table with a row per reasoner, and the meaning of their names where they are not the plain
    ones."""
    rows = _rows(document)
    shares = [{"own": _share(scores)} for _, scores in rows]
    return marked(Table.of(rows, {**_NAME, **columns}), shares)


def _share(scores: Document) -> Document | None:
    """A model's share of the decisions, as the tables of trials have it; None: none was asked, or
    it was counted in another way: scores of before had no count of those that nobody made."""
    if not scores["requests"] or "fallbacks" not in scores:
        return None
    cut = {name: scores[name] for name in ("clamped", "fallbacks")}
    return {"own_percent": scores["own"]["percent"], **cut}


def _name(reasoner: str, scores: Document) -> str:
    """The name of a row: not the model's where it decided nothing, and marked where it did not
    decide all."""
    return marked_name(reasoner, _share(scores))


def _own_beside(document: Document) -> _Columns:
    """A column of a model's own decisions, where any row is a model's."""
    has_any = any(_share(scores) for _, scores in _rows(document))
    return {"own [%]": lambda row: own_percent(_share(row[1]))} if has_any else {}


def _rate(score: str) -> Callable[[_Row], str]:
    return lambda row: rate(row[1][score])


def _or_none(score: Any, shown: Callable[[Any], str]) -> str:
    return NONE if score is None else shown(score)


def _of(found: Document) -> str:
    return f"{found['successes']} of {found['n']}" if found["n"] else NONE


def _tokens(scores: Document) -> str:
    tokens = (scores["input_tokens"] + scores["output_tokens"]) / scores["n"]
    return f"{tokens:.0f}" if scores["requests"] else NONE


def _toward(score: Document) -> str:
    ends = [
        [rounded(s[n], 1) for n in ("value", "low", "high")]
        for s in (score["median"], score["mean"])
    ]
    return "; ".join(f"{value:.1f} [{low:.1f}, {high:.1f}]" for value, low, high in ends)
