"""The tables of an experiment's page: ours beside the paper's, with intervals, each row leading to
its trials."""

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import urlencode

from pliant.experiment.statistics import wilson
from pliant.experiment.success import TRIAL_KINDS
from pliant.experiment.tables_text import by_cell, marks, paired, shown_name
from pliant.formations import RECOVERABLE
from pliant.report import words
from pliant.report.charts import Bar, bars, difference
from pliant.report.html import Html, join, tag
from pliant.report.parts import table

Document = Mapping[str, Any]
_OWN = ("own [%]", "G alone [%]")


def link(shown: str, **wanted: object) -> Html:
    """A link to the list of trials, narrowed to those wanted."""
    return tag("a", shown, href=address(**wanted))


def address(**wanted: object) -> str:
    """The address of the list of trials, narrowed to those wanted."""
    return f"#{urlencode({name: str(value) for name, value in wanted.items()})}"


def place(cell: Document) -> dict[str, object]:
    """The values that narrow the list of trials to a cell."""
    return {name: cell[name] for name in ("level", "peg", "condition", "reasoner")}


def table2(cells: Sequence[Document]) -> Html:
    """Table II: success judged (F) and true (G), and average extra executions."""
    head = ["peg", "condition", "reasoner", "n", "failed", "F over G", "F [%]", "G [%]"]
    has_model = any(cell.get("own") for cell in cells)
    head += [*(_OWN if has_model else ()), "paper's F, G", "extra fit, align, insertion", "paper's"]
    caption = (
        "F: judged inserted. G: truly inserted. n: trials in which the method was measured; faults"
        " are in no rate, and a trial that the cell ended counts as not inserted. Whiskers and"
        " brackets: 95 % Wilson interval. Diamonds: the paper's, whose reasoner is GPT-4o."
    )
    rows = [_table2_row(cell, has_model=has_model) for cell in cells]
    return table(head, rows, " ".join([caption, *marks(c.get("own") for c in cells)]))


def _table2_row(cell: Document, *, has_model: bool) -> Html:
    judged, true, theirs = cell["judged"], cell["inserted"], cell["paper"]
    shown = bars(
        [
            _bar(judged, theirs and theirs["judged"], "judged"),
            _bar(true, theirs and theirs["inserted"], "success"),
        ],
        f"F {outcome(cell, 'judged')}, G {outcome(cell, 'inserted')}",
    )
    averages = [cell["extra"][f] for f in RECOVERABLE]
    extra = ", ".join("–" if a is None else f"{a:.2f}" for a in averages)
    papers_extra = ", ".join(f"{v:.1f}" for v in theirs["extra"].values()) if theirs else ""
    failed = true["n"] - true["successes"]
    failures = (
        [link(str(failed), **place(cell), outcome="failed")] if failed else [tag("span", "0")]
    )
    if cell["disagreed"]:
        failures.append(link(f"{cell['disagreed']} F≠G", **place(cell), outcome="disagreed"))
    counted = link(str(cell["n"]), **place(cell))
    if cell["faults"]:
        words = "1 fault" if cell["faults"] == 1 else f"{cell['faults']} faults"
        counted = join(counted, " ", link(words, **place(cell), outcome="faults"))
    return tag(
        "tr",
        *(tag("td", text) for text in who(cell)),
        tag("td", counted, class_="number"),
        tag("td", _spaced(failures), class_="number"),
        tag("td", shown),
        tag("td", outcome(cell, "judged"), class_="number"),
        tag("td", outcome(cell, "inserted"), class_="number"),
        *(tag("td", text, class_="number") for text in _own(cell) if has_model),
        tag("td", f"{theirs['judged']:g}, {theirs['inserted']:g}" if theirs else "–"),
        tag("td", extra, class_="number"),
        tag("td", papers_extra or "–", class_="number"),
    )


def _own(cell: Document) -> tuple[str, str]:
    """A cell's texts for the columns `_OWN`."""
    share = cell.get("own")
    return ("–", "–") if share is None else (f"{share['own_percent']:.1f}", rate(share["alone"]))


def table3(transitions: Sequence[Document]) -> Html:
    """Table III: from the failed formation to the first of its plan."""
    if not transitions:
        return tag("p", "No execution was followed by a plan.")
    rows = [
        _table3_row(entry, origin, to)
        for entry in transitions
        for origin, to in entry["counts"].items()
    ]
    head = ["peg", "reasoner", "from", "n", *(f"to {f} [%]" for f in RECOVERABLE)]
    caption = "Over all conditions. Diamonds: the paper's, which gives the circle's."
    return table(head, rows, caption)


def _table3_row(entry: Document, origin: str, to: Mapping[str, int]) -> Html:
    n = sum(to.values())
    theirs = (entry["paper"] or {}).get(origin, {})
    cells = []
    for formation in RECOVERABLE:
        interval = wilson(to[formation], n)
        percent, paper = 100 * to[formation] / n, theirs.get(formation)
        beside = "" if paper is None else f"; paper {paper:g}"
        text = f"{percent:.1f} [{100 * interval.low:.1f}, {100 * interval.high:.1f}]{beside}"
        bar = Bar(percent=percent, low=100 * interval.low, high=100 * interval.high, paper=paper)
        cells.append(tag("td", bars([bar], text), tag("div", text, class_="number")))
    narrowed = {name: entry[name] for name in ("level", "peg", "reasoner")}
    return tag(
        "tr",
        tag("td", _peg(entry)),
        tag("td", link(shown_name(entry), **narrowed)),
        tag("td", origin),
        tag("td", str(n), class_="number"),
        *cells,
    )


def kinds(cells: Sequence[Document]) -> Html:
    """A table of how many trials failed in which way, in the cells where any did."""
    failed = [cell for cell in cells if cell["failure_kinds"]]
    if not failed:
        return tag("p", "No trial failed.")
    names = [kind for kind in TRIAL_KINDS if any(kind in cell["failure_kinds"] for cell in failed)]
    rows = []
    for cell in failed:
        counts = [
            tag("td", _kind(cell, kind, cell["failure_kinds"].get(kind, 0))) for kind in names
        ]
        n = tag("td", str(cell["n"] + cell["faults"]), class_="number")
        rows.append(tag("tr", *(tag("td", text) for text in who(cell)), n, *counts))
    meanings = [
        tag("div", tag("dt", _spoken(kind)), tag("dd", TRIAL_KINDS[kind])) for kind in names
    ]
    head = ["peg", "condition", "reasoner", "trials", *map(_spoken, names)]
    caption = "Decided from the truth after each execution. Bars: the share of the cell's trials."
    return join(table(head, rows, caption), tag("dl", *meanings, class_="meanings"))


def _kind(cell: Document, kind: str, count: int) -> Html:
    if not count:
        return tag("span", "–", class_="hint")
    n = cell["n"] + cell["faults"]
    described = f"{count} of {n}"
    bar = Bar(percent=100 * count / n, kind="failure")
    return join(bars([bar], described), link(str(count), **place(cell), kind=kind))


def own(cells: Sequence[Document]) -> Html:
    """A table of how many decisions were a model's own, its success without the rules, and what it
    cost."""
    head = ["peg", "condition", "reasoner", "n", "G over G alone", "G [%]", "G alone [%]"]
    head += ["decisions", "own [%]", "clamped", "by the rules", "tokens a trial", "USD a trial"]
    rows = []
    for cell in cells:
        share, true = cell["own"], cell["inserted"]
        alone = share["alone"]
        described = f"G {rate(true)}, alone {rate(alone)}"
        cost = "not known" if share["cost_usd"] is None else f"{share['cost_usd']:.4f}"
        texts = [rate(true), rate(alone), f"{share['decisions']}", f"{share['own_percent']:.1f}"]
        texts += [f"{share['clamped']}", f"{share['fallbacks']}", f"{share['tokens']:,.0f}", cost]
        chart = bars([_bar(true, None, "success"), _bar(alone, None, "judged")], described)
        rows.append(
            tag(
                "tr",
                *(tag("td", text) for text in (*who(cell), str(cell["n"]))),
                tag("td", chart),
                *(tag("td", text, class_="number") for text in texts),
            )
        )
    caption = (
        "G alone counts a trial in which a plan was clamped, or the rules stepped in, as failed."
        " Own: the share of the decisions that the model was asked for and that stood."
    )
    return table(head, rows, " ".join([caption, *marks(c.get("own") for c in cells)]))


def pairs(rows: Sequence[Document]) -> Html:
    """A table of every two reasoners on the same seeds: all cells together, then cell by cell."""
    if not rows:
        return tag("p", "Only one reasoner: nothing to compare.")
    head = ["first − second", "peg", "condition", "n", "", "difference [points]"]
    head += ["only first", "only second", "McNemar p"]
    caption = (
        f"{paired(rows)} With its 95 % interval (Newcombe); right of the middle the first is"
        " better. Only: trials that one inserted and the other did not."
    )
    return table(head, [_pair(row) for row in by_cell(rows)], caption)


def _pair(row: Document) -> Html:
    where = {name: row[name] for name in ("level", "peg", "condition") if row[name]}
    text = f"{_signed(row['difference'])} [{_signed(row['low'])}, {_signed(row['high'])}]"
    chart = difference(row["difference"], row["low"], row["high"], text)

    def only(count: int, winner: str, loser: str) -> Html:
        if not count:
            return tag("td", "0", class_="number")
        shown = link(str(count), **where, reasoner=loser, outcome="failed", against=winner)
        return tag("td", shown, class_="number")

    return tag(
        "tr",
        tag(
            "td",
            f"{row.get('first_shown', row['first'])} − {row.get('second_shown', row['second'])}",
        ),
        tag("td", _peg(row) if row["peg"] else "all"),
        tag("td", row["condition"] or "all"),
        tag("td", str(row["n"]), class_="number"),
        tag("td", chart),
        tag("td", text, class_="number"),
        only(row["only_first"], row["first"], row["second"]),
        only(row["only_second"], row["second"], row["first"]),
        tag("td", f"{row['p']:.2g}", class_="number"),
    )


def faults(cells: Sequence[Document]) -> Html:
    """A table of the trials in which nothing was measured, with what was said of them."""
    rows = [
        tag(
            "tr",
            *(tag("td", text) for text in who(cell)),
            tag("td", link(str(said["n"]), **place(cell), outcome="faults"), class_="number"),
            tag("td", said["text"]),
        )
        for cell in cells
        for said in cell["said"]
    ]
    caption = (
        "Trials in which nothing was measured. The command that made them repeats these and no"
        " others with --again faults."
    )
    return table(["peg", "condition", "reasoner", "trials", "fault"], rows, caption)


def outcome(cell: Document, name: str) -> str:
    """A cell's share, unless nothing but faults came of it."""
    return "faults" if cell["faults"] and not cell["n"] else rate(cell[name])


def rate(found: Document) -> str:
    """A share with its interval: "45.0 [40.2, 49.9]"."""
    if not found["n"]:
        return "not known"
    return f"{found['percent']:.1f} [{found['low']:.1f}, {found['high']:.1f}]"


def who(cell: Document) -> list[str]:
    """A cell's peg, condition and reasoner."""
    return [_peg(cell), cell["condition"], shown_name(cell)]


def _peg(cell: Document) -> str:
    return cell["peg"] if cell["level"] == "L0" else f"{cell['peg']} {cell['level']}"


def _bar(found: Document, paper: float | None, kind: str) -> Bar:
    return Bar(
        percent=found["percent"], low=found["low"], high=found["high"], paper=paper, kind=kind
    )


def _spaced(parts: Sequence[Html]) -> Html:
    return join(*(piece for part in parts for piece in (part, " ")))


def _spoken(kind: str) -> str:
    return kind.replace("_", " ")


def _signed(value: float) -> str:
    return words.number(value, sign=True)
