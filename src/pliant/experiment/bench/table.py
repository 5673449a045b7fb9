"""The benchmark's tables as Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from pliant.experiment.measures import is_partly, is_undecided
from pliant.experiment.measures import name as shown
from pliant.experiment.tables_text import PARTLY, marks
from pliant.text import escaped

Document = Mapping[str, Any]
_NONE = "–"


def markdown(document: Document) -> str:
    """All tables of a document of `run`, as Markdown."""
    document = escaped(document)
    n, of = document["cases"]["n"], document["cases"]["of"]
    part = "" if n == of else f", the first {n}"
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
    beside = _own_beside(document)
    rows = [
        [
            _name(name, s),
            str(s["all"]["n"]),
            *(_own(s) for _ in beside),
            _accuracy(s["all"]["balanced_accuracy"], interval=True),
            _rate(s["all"]["false_accepts"]),
            _rate(s["all"]["false_rejects"]),
        ]
        for name, s in document["reasoners"].items()
    ]
    header = ["reasoner", "n", *beside, "balanced accuracy [%]", "false accepts [%]"]
    return _marked(document, _table([*header, "false rejects [%]"], rows))


def planning(document: Document) -> str:
    beside = _own_beside(document)
    names = ("plan_valid", "start_right", "retreat_right", "direction_right", "reaches")
    rows = [
        [_name(name, s), *(_own(s) for _ in beside)]
        + [*(_rate(s["all"][score]) for score in names), _toward(s["all"]["toward_mm"])]
        for name, s in document["reasoners"].items()
    ]
    header = ["reasoner", *beside, "valid [%]", "resumes right [%]", "retreat right [%]"]
    header += ["direction right [%]", "reaches at once [%]", "toward the goal [mm], median; mean"]
    return _marked(document, _table(header, rows))


def stopping(document: Document) -> str:
    """A table of how often reasoners stop, for those that were asked where it is right to stop."""
    rows = [
        [_name(name, s), _rate(s["all"]["stops"]), _rate(s["all"]["stops_needlessly"])]
        for name, s in document["reasoners"].items()
        if s["all"].get("stops", {}).get("n")
    ]
    header = ["reasoner", "stops where no motion helps [%]", "stops where going on is right [%]"]
    return _table(header, rows)


def spending(document: Document) -> str:
    rows = []
    for name, of_name in document["reasoners"].items():
        s = of_name["all"]
        tokens = (s["input_tokens"] + s["output_tokens"]) / s["n"]
        cost, latency = s["cost_usd"], s["latency_s"]
        rows.append(
            [
                _name(name, of_name),
                _own(of_name),
                str(s["requests"]),
                f"{tokens:.0f}" if s["requests"] else _NONE,
                _NONE if cost is None else f"{100 * cost / s['n']:.2f}",
                _NONE if latency is None else f"{latency['p50']:.1f}, {latency['p95']:.1f}",
            ]
        )
    header = ["reasoner", "own decisions [%]", "requests", "tokens per case"]
    header += ["US cents per case", "wait per decision p50, p95 [s]"]
    return _table(header, rows)


def grouped(document: Document, by: str) -> str:
    """A table of the scores that tell groups apart, as counts; the JSON has their intervals."""
    rows = []
    for name, s in document["reasoners"].items():
        for group, g in sorted(s[f"by_{by}"].items()):
            scores = ("false_accepts", "false_rejects", "start_right", "direction_right", "reaches")
            rates = [_of(g[score]) for score in scores]
            accuracy = _accuracy(g["balanced_accuracy"], interval=False)
            rows.append([_name(name, s), group, str(g["n"]), accuracy, *rates])
    header = ["reasoner", by, "n", "balanced accuracy [%]", "false accepts", "false rejects"]
    return _table(header + ["resumes right", "direction right", "reaches at once"], rows)


def undecided(document: Document) -> list[str]:
    """The reasoners whose model was asked, and decided nothing."""
    return [name for name, s in document["reasoners"].items() if is_undecided(_share(s))]


def _share(scores: Document) -> Document | None:
    """A model's share of the decisions, as the tables of trials have it; None: none was asked, or
    it was counted in another way: scores of before had no count of those that nobody made."""
    s = scores["all"]
    if not s["requests"] or "fallbacks" not in s:
        return None
    cut = {name: s[name] for name in ("clamped", "fallbacks")}
    return {"own_percent": s["own"]["percent"], **cut}


def _name(reasoner: str, scores: Document) -> str:
    """The name of a row: not the model's where it decided nothing, and marked where it did not
    decide all."""
    share = _share(scores)
    return shown(reasoner, share) + (f" {PARTLY}" if is_partly(share) else "")


def _own_beside(document: Document) -> list[str]:
    """The header cell of a column of a model's own decisions, where any row is a model's."""
    return ["own [%]"] if any(map(_share, document["reasoners"].values())) else []


def _own(scores: Document) -> str:
    share = _share(scores)
    return _NONE if share is None else f"{share['own_percent']:.1f}"


def _marked(document: Document, table: str) -> str:
    """A table, with the meaning of its names below it where they are not the plain ones."""
    return "\n\n".join([table, *marks(map(_share, document["reasoners"].values()))])


def _accuracy(score: Document | None, *, interval: bool) -> str:
    if score is None:
        return _NONE
    text = f"{score['percent']:.1f}"
    return f"{text} [{score['low']:.1f}, {score['high']:.1f}]" if interval else text


def _rate(rate: Document) -> str:
    if rate["percent"] is None:
        return _NONE
    return f"{rate['percent']:.1f} [{rate['low']:.1f}, {rate['high']:.1f}] of {rate['n']}"


def _of(rate: Document) -> str:
    return f"{rate['successes']} of {rate['n']}" if rate["n"] else _NONE


def _toward(score: Document | None) -> str:
    if score is None:
        return _NONE
    median, mean = (
        f"{_mm(s['value'])} [{_mm(s['low'])}, {_mm(s['high'])}]"
        for s in (score["median"], score["mean"])
    )
    return f"{median}; {mean}"


def _mm(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}"  # no -0.0


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
