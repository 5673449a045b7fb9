"""An experiment as one static page: the tables beside the paper's, where and how it fails, who is
better, and every trial to be found, failures first."""

import math
import re
from collections.abc import Collection, Sequence

from pliant.experiment.measures import Row, inserted
from pliant.experiment.measures import rate as rated
from pliant.html import Html, join, tag
from pliant.report import overview_tables as tables
from pliant.report import words
from pliant.report.charts import Bar, Bin, histogram
from pliant.report.document import document
from pliant.report.overview_data import data, heading, in_report, quantities, varying
from pliant.report.parts import chapter, facts, notice
from pliant.report.summary import Summary

_BINS = 8


def render(summary: Summary, title: str, pages: Collection[str]) -> str:
    """The text of an experiment's page. `pages` has the id of each trial that has a page, in its
    own folder."""
    made = summary.tables
    asked = [cell for cell in made["cells"] if cell.get("own")]
    faulted = [cell for cell in made["cells"] if cell["faults"]]
    chapters = [
        *(
            [("faults", "Faults: trials in which nothing was measured", tables.faults(faulted))]
            if faulted
            else []
        ),
        ("table2", "Table II: success, and average extra executions", tables.table2(made["cells"])),
        (
            "table3",
            "Table III: from the failed formation to the first of its plan",
            tables.table3(made["transitions"]),
        ),
        ("where", "Where it fails", _where(summary.trials)),
        ("kinds", "Kinds of failure", tables.kinds(made["cells"])),
        ("pairs", "Reasoner against reasoner, on the same seeds", tables.pairs(made["pairs"])),
        *([("model", "The model's own share, and its cost", tables.own(asked))] if asked else []),
        ("trials", "Trials", _trials()),
    ]
    contents = (tag("li", tag("a", _short(title), href=f"#{name}")) for name, title, _ in chapters)
    return document(
        title,
        _headline(summary, title),
        tag("nav", tag("ul", *contents), aria_label="On this page", class_="contents"),
        *(chapter(title, name, content) for name, title, content in chapters),
        script="overview.js",
        style="overview.css",
        data=data(summary, pages),
    )


def _short(title: str) -> str:
    return re.split("[:,]", title)[0]


def _headline(summary: Summary, title: str) -> Html:
    run, cells = summary.run, summary.tables["cells"]
    reasoners = dict.fromkeys(cell["reasoner"] for cell in cells)
    models = dict.fromkeys(cell["model"] for cell in cells if cell["model"])
    n, planned = len(summary.trials), summary.planned
    commit = f"{(run.get('commit') or 'not known')[:12]}{', changed' if run.get('dirty') else ''}"
    versions = run.get("versions") or {}
    pairs = [
        ("trials", f"{n} of {planned}" if n < planned else str(n)),
        ("cells", str(len(cells))),
        ("reasoners", ", ".join(reasoners)),
        *([("models", ", ".join(models))] if models else []),
        ("judged ≠ inserted", str(sum(cell["disagreed"] for cell in cells))),
        ("faults", str(sum(cell["faults"] for cell in cells))),
        ("robot time", f"{words.number(sum(t['simulated_s'] for t in summary.trials) / 3600)} h"),
        ("started", str(run.get("started", "not known"))),
        ("commit", commit),
        ("pliant, mujoco", f"{versions.get('pliant')}, {versions.get('mujoco')}"),
    ]
    unfinished = (
        notice(
            f"Not finished: {n} of {planned} trials are shown. While it is served (--watch or"
            " --serve) this page loads itself again; else `pliant view` again shows more."
        )
        if n < planned
        else Html("")
    )
    return tag("header", tag("h1", title), unfinished, facts(pairs), class_="headline")


# --- where it fails ----------------------------------------------------------------------------


def _where(trials: Sequence[Row]) -> Html:
    """Histograms of success against each drawn quantity, reasoner by reasoner, over the cells that
    draw it."""
    rows = []
    for reasoner in dict.fromkeys(t["reasoner"] for t in trials):
        own = [t for t in trials if t["reasoner"] == reasoner]
        panels = [_panel(own, reasoner, column) for column in varying(own)]
        shown = [panel for panel in panels if panel]
        if shown:
            rows.append(join(tag("h3", reasoner), tag("div", *shown, class_="panels")))
    if not rows:
        return tag("p", "No drawn quantity differs between the trials.")
    hint = (
        "Share of trials inserted (G), with 95 % intervals, over all cells that draw the quantity;"
        " below each, a stroke per failed trial. A column leads to its trials."
    )
    return join(tag("p", hint, class_="hint"), *rows)


def _panel(trials: Sequence[Row], reasoner: str, column: str) -> Html:
    """One quantity's histogram; empty where no cell draws it."""
    axis = quantities()[column]
    cells: dict[tuple[str, str, str], list[tuple[float, bool | None]]] = {}
    for trial in trials:
        cell = (trial["level"], trial["peg"], trial["condition"])
        value = in_report(axis, trial[column])
        cells.setdefault(cell, []).append((value, inserted(trial)))
    drawn = [
        point
        for points in cells.values()
        if len({value for value, _ in points}) > 1
        for point in points
    ]
    if len({value for value, _ in drawn}) < 2:
        return Html("")
    edges = _edges([value for value, _ in drawn])
    bins = []
    for n in range(len(edges) - 1):
        begin, end, last = edges[n], edges[n + 1], n == len(edges) - 2
        held = [ok for value, ok in drawn if begin <= value < end or (last and value == end)]
        found = rated(held)
        share = f"{tables.rate(found)} % of {found['n']} inserted" if found["n"] else "no trial"
        bins.append(
            Bin(
                begin=begin,
                end=end,
                bar=Bar(percent=found["percent"], low=found["low"], high=found["high"]),
                link=tables.address(
                    reasoner=reasoner, drawn=column, least=f"{begin:g}", most=f"{end:g}"
                ),
                described=f"{begin:g} to {end:g}: {share}",
            )
        )
    failures = [value for value, ok in drawn if ok is False]
    label = heading(column)
    return histogram(bins, failures, label, f"{reasoner}: inserted [%] over {label}")


def _edges(values: Sequence[float]) -> list[float]:
    """Edges of bins of equal width on round numbers."""
    low, high = min(values), max(values)
    raw = (high - low) / _BINS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1, 2, 2.5, 5, 10) if power * m >= raw * 0.999)
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [round(n * step, 9) for n in range(first, last + 1)]


def _trials() -> Html:
    """The place of the list of trials, which the page's script fills."""
    return tag("div", tag("noscript", "The list of trials needs JavaScript."), id="list")
