"""The tables of an experiment's page: ours beside the paper's, with intervals, each row leading to
its trials."""

from collections.abc import Mapping, Sequence
from operator import itemgetter
from urllib.parse import urlencode

from pliant.experiment.measures import rate as rated
from pliant.experiment.success import TRIAL_KINDS
from pliant.experiment.table_cells import (
    WHO,
    Columns,
    Document,
    interval,
    marks,
    number,
    own_percent,
    peg,
    shown_name,
    their_extra,
    their_success,
    who,
)
from pliant.experiment.tables_text import by_cell, failures, paired, versus
from pliant.formations import RECOVERABLE
from pliant.html import Html, join, tag
from pliant.report import words
from pliant.report.charts import Bar, bars, difference
from pliant.report.parts import table
from pliant.table import Table


def link(shown: object, **wanted: object) -> Html:
    """A link to the list of trials, narrowed to those wanted."""
    return tag("a", str(shown), href=address(**wanted))


def address(**wanted: object) -> str:
    """The address of the list of trials, narrowed to those wanted."""
    return f"#{urlencode({name: str(value) for name, value in wanted.items()})}"


def place(cell: Document) -> dict[str, object]:
    """The values that narrow the list of trials to a cell."""
    return {name: cell[name] for name in ("level", "peg", "condition", "reasoner")}


def table2(cells: Sequence[Document]) -> Html:
    """Table II: success judged (F) and true (G), and average extra executions."""
    columns: Columns = {
        **WHO,
        "n": _counted,
        "failed": _failed,
        "F over G": _f_over_g,
        "F [%]": lambda cell: outcome(cell, "judged"),
        "G [%]": lambda cell: outcome(cell, "inserted"),
    }
    if any(cell.get("own") for cell in cells):
        columns["own [%]"] = lambda cell: own_percent(cell.get("own"))
        columns["G alone [%]"] = lambda cell: rate(cell["own"]["alone"]) if cell["own"] else "–"
    columns |= {
        "paper's F, G": lambda cell: their_success(cell["paper"]),
        "extra fit, align, insertion": lambda cell: ", ".join(
            number(cell["extra"][formation], 2) for formation in RECOVERABLE
        ),
        "paper's": lambda cell: their_extra(cell["paper"]),
    }
    caption = (
        "F: judged inserted. G: truly inserted. n: trials in which the method was measured; faults"
        " are in no rate, and a trial that the cell ended counts as not inserted. Whiskers and"
        " brackets: 95 % Wilson interval. Diamonds: the paper's, whose reasoner is GPT-4o."
    )
    plain = {*WHO, "F over G", "paper's F, G"}
    caption = " ".join([caption, *marks(c.get("own") for c in cells)])
    return table(Table.of(cells, columns), caption, numbers=columns.keys() - plain)


def _counted(cell: Document) -> Html:
    counted = link(cell["n"], **place(cell))
    if not cell["faults"]:
        return counted
    said = "1 fault" if cell["faults"] == 1 else f"{cell['faults']} faults"
    return join(counted, " ", link(said, **place(cell), outcome="faults"))


def _failed(cell: Document) -> Html:
    failed = cell["inserted"]["n"] - cell["inserted"]["successes"]
    shown = link(failed, **place(cell), outcome="failed") if failed else tag("span", "0")
    if not cell["disagreed"]:
        return join(shown, " ")
    disagreed = link(f"{cell['disagreed']} F≠G", **place(cell), outcome="disagreed")
    return join(shown, " ", disagreed, " ")


def _f_over_g(cell: Document) -> Html:
    theirs = cell["paper"] or {}
    shown = [
        _bar(cell["judged"], theirs.get("judged"), "judged"),
        _bar(cell["inserted"], theirs.get("inserted"), "success"),
    ]
    return bars(shown, f"F {outcome(cell, 'judged')}, G {outcome(cell, 'inserted')}")


def table3(transitions: Sequence[Document]) -> Html:
    """Table III: from the failed formation to the first of its plan."""
    if not transitions:
        return tag("p", "No execution was followed by a plan.")
    rows = [
        [
            peg(entry),
            link(shown_name(entry), **{name: entry[name] for name in ("level", "peg", "reasoner")}),
            origin,
            sum(to.values()),
            *_shares(to, (entry["paper"] or {}).get(origin, {})),
        ]
        for entry in transitions
        for origin, to in entry["counts"].items()
    ]
    head = ["peg", "reasoner", "from", "n", *(f"to {f} [%]" for f in RECOVERABLE)]
    caption = "Over all conditions. Diamonds: the paper's, which gives the circle's."
    return table(Table(head, rows), caption, numbers={"n"})


def _shares(to: Mapping[str, int], theirs: Mapping[str, float]) -> list[Html]:
    """The share of the plans that began with each formation, as a bar and in words."""
    cells = []
    for formation in RECOVERABLE:
        found = rated([True] * to[formation] + [False] * (sum(to.values()) - to[formation]))
        paper = theirs.get(formation)
        text = interval(found) + ("" if paper is None else f"; paper {paper:g}")
        drawn = bars([_bar(found, paper, "success")], text)
        cells.append(join(drawn, tag("div", text, class_="number")))
    return cells


def kinds(cells: Sequence[Document]) -> Html:
    """A table of how many trials failed in which way, in the cells where any did."""
    failed, names = failures(cells)
    if not failed:
        return tag("p", "No trial failed.")
    rows = [
        [
            *who(cell),
            cell["n"] + cell["faults"],
            *(_kind(cell, kind, cell["failure_kinds"].get(kind, 0)) for kind in names),
        ]
        for cell in failed
    ]
    meanings = [
        tag("div", tag("dt", spoken), tag("dd", TRIAL_KINDS[kind]))
        for kind, spoken in names.items()
    ]
    caption = "Decided from the truth after each execution. Bars: the share of the cell's trials."
    shown = table(Table([*WHO, "trials", *names.values()], rows), caption, numbers={"trials"})
    return join(shown, tag("dl", *meanings, class_="meanings"))


def _kind(cell: Document, kind: str, count: int) -> Html:
    if not count:
        return tag("span", "–", class_="hint")
    n = cell["n"] + cell["faults"]
    bar = Bar(percent=100 * count / n, kind="failure")
    return join(bars([bar], f"{count} of {n}"), link(count, **place(cell), kind=kind))


def own(cells: Sequence[Document]) -> Html:
    """A table of how many decisions were a model's own, its success without the rules, and what it
    cost."""
    plain: Columns = {
        **WHO,
        "n": itemgetter("n"),
        "G over G alone": lambda cell: bars(
            [_bar(cell["inserted"], None, "success"), _bar(cell["own"]["alone"], None, "judged")],
            f"G {rate(cell['inserted'])}, alone {rate(cell['own']['alone'])}",
        ),
    }
    numbers: Columns = {
        "G [%]": lambda cell: rate(cell["inserted"]),
        "G alone [%]": lambda cell: rate(cell["own"]["alone"]),
        "decisions": lambda cell: cell["own"]["decisions"],
        "own [%]": lambda cell: own_percent(cell["own"]),
        "clamped": lambda cell: cell["own"]["clamped"],
        "by the rules": lambda cell: cell["own"]["fallbacks"],
        "tokens a trial": lambda cell: f"{cell['own']['tokens']:,.0f}",
        "USD a trial": lambda cell: _cost(cell["own"]["cost_usd"]),
    }
    caption = (
        "G alone counts a trial in which a plan was clamped, or the rules stepped in, as failed."
        " Own: the share of the decisions that the model was asked for and that stood."
    )
    caption = " ".join([caption, *marks(c.get("own") for c in cells)])
    return table(Table.of(cells, {**plain, **numbers}), caption, numbers=numbers)


def _cost(usd: float | None) -> str:
    return "not known" if usd is None else f"{usd:.4f}"


def pairs(rows: Sequence[Document]) -> Html:
    """A table of every two reasoners on the same seeds: all cells together, then cell by cell."""
    if not rows:
        return tag("p", "Only one reasoner: nothing to compare.")
    columns: Columns = {
        "first − second": versus,
        "peg": lambda row: peg(row) if row["peg"] else "all",
        "condition": lambda row: row["condition"] or "all",
        "n": itemgetter("n"),
        "": lambda row: difference(row["difference"], row["low"], row["high"], _points(row)),
        "difference [points]": _points,
        "only first": lambda row: _only(row, "first", "second"),
        "only second": lambda row: _only(row, "second", "first"),
        "McNemar p": lambda row: f"{row['p']:.2g}",
    }
    caption = (
        f"{paired(rows)} With its 95 % interval (Newcombe); right of the middle the first is"
        " better. Only: trials that one inserted and the other did not."
    )
    numbers = columns.keys() - {"first − second", "peg", "condition", ""}
    return table(Table.of(by_cell(rows), columns), caption, numbers=numbers)


def _points(row: Document) -> str:
    value, low, high = (words.number(row[n], sign=True) for n in ("difference", "low", "high"))
    return f"{value} [{low}, {high}]"


def _only(row: Document, winner: str, loser: str) -> str:
    """The trials that only one of the two inserted, where the other failed."""
    count = row[f"only_{winner}"]
    if not count:
        return "0"
    where = {name: row[name] for name in ("level", "peg", "condition") if row[name]}
    return link(count, **where, reasoner=row[loser], outcome="failed", against=row[winner])


def faults(cells: Sequence[Document]) -> Html:
    """A table of the trials in which nothing was measured, with what was said of them."""
    rows = [
        [
            *who(cell),
            link(said["n"], **place(cell), outcome="faults"),
            said["text"],
        ]
        for cell in cells
        for said in cell["said"]
    ]
    caption = (
        "Trials in which nothing was measured. The command that made them repeats these and no"
        " others with --again faults."
    )
    return table(Table([*WHO, "trials", "fault"], rows), caption, numbers={"trials"})


def outcome(cell: Document, name: str) -> str:
    """A cell's share, unless nothing but faults came of it."""
    return "faults" if cell["faults"] and not cell["n"] else rate(cell[name])


def rate(found: Document) -> str:
    """A share with its interval: "45.0 [40.2, 49.9]"."""
    return interval(found) if found["n"] else "not known"


def _bar(found: Document, paper: float | None, kind: str) -> Bar:
    return Bar(
        percent=found["percent"], low=found["low"], high=found["high"], paper=paper, kind=kind
    )
