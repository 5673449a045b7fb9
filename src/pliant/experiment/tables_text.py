"""The tables as Markdown, for a terminal, a file or the README."""

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter

from pliant.experiment.ladder import VARIES
from pliant.experiment.success import TRIAL_KINDS
from pliant.experiment.table_cells import (
    NONE,
    WHO,
    Columns,
    Document,
    fault_columns,
    marked,
    number,
    outcome,
    own_columns,
    own_percent,
    rate,
    shown_name,
    their_extra,
    their_success,
    who,
)
from pliant.formations import RECOVERABLE
from pliant.table import Table
from pliant.text import escaped

PAIRED = (
    "The difference in G, on the trials that both reasoners have: it is positive where the one"
    " named first inserts more. That is the one which the experiment lists later."
)
"""A sentence on what the table of pairs shows."""
POOLED = (
    "The rows of all pool pegs and conditions, which share their seeds: their trials are not"
    " independent of each other, so that the interval is rather too narrow, and p too small."
)
"""A sentence on the rows that pool several cells, where a table has such."""

_RIGHT = {
    "insert": "insert",
    "stop": "stop",
    "either": "insert or stop",
    VARIES: "by trial",
}
_SIMULATED = ("sim", "emulator")
_CELLS = {
    "emulator": "**Emulated: no robot.** A simulated cell behind the UR5e's own software.",
    "ur5e": "Made with a UR5e; G is what its operator saw.",
}


def markdown(document: Document) -> str:
    """All tables of `tables.build`, under headings."""
    document = escaped(document)
    cells, paper = document["cells"], document["paper"]
    sections = [
        "# Tables",
        f"Paper: {paper['source']}, whose reasoner is {paper['reasoner']}; each row of ours says"
        " which reasoner made it. Percentages stand with their n and 95 % Wilson interval. F is"
        " judged inserted, G truly inserted. n counts the trials in which the method was measured:"
        " faults are counted beside it and are in no rate. A trial that the cell ended, as by a"
        " protective stop, counts as not inserted.",
        *_faults_section(cells),
        *_where(cells),
        *_section("The ladder: all pegs of a level together", ladder, document, "ladder"),
        *_section("Scenarios: what was right, and how it ended", scenarios, document, "scenarios"),
        "## Table II: success, and average extra executions",
        table2(cells),
        "## Table III: from the failed formation to the first of its plan [%]",
        table3(document["transitions"], paper["reasoner"]),
        *_section(
            "Table IV: success by the place of the hole and the grasp angle",
            table4,
            document,
            "placed",
        ),
        "## Reasoner against reasoner, on the same seeds",
        pairs(document["pairs"]),
        "## Depth reached",
        depth(cells),
        "## Success against the grasp angle's size",
        grasp_angle(cells),
        "## Align: corrections that overshoot, and false acceptances",
        align(cells),
        "## Failures by kind, from the truth",
        failure_kinds(cells),
    ]
    if any(c.get("own") for c in cells):
        sections += ["## The model's own share", own(cells)]
    return "\n\n".join(sections) + "\n"


def _section(
    title: str, table: Callable[[Sequence[Document]], str], document: Document, name: str
) -> list[str]:
    rows = document.get(name, [])
    return [f"## {title}", table(rows)] if rows else []


def table2(cells: Sequence[Document]) -> str:
    """Table II in the paper's layout, the paper's own figures beside ours."""
    faults = sum(c["faults"] for c in cells)
    disagreed, n = sum(c["disagreed"] for c in cells), sum(c["n"] for c in cells)
    told = f"Judged ≠ inserted in {disagreed} of {n} trials; faults in {faults}."
    made = dict.fromkeys(c["made_by"] for c in cells if c.get("made_by"))
    told += f" Made by {' and '.join(made)}." if made else ""
    return marked(success(cells), cells, told)


def success(cells: Sequence[Document]) -> Table:
    """Table II, without what is said below it."""
    return Table.of(
        cells,
        {
            **WHO,
            "n": itemgetter("n"),
            **fault_columns(cells),
            **_JUDGED_AND_TRUE,
            **own_columns(cells),
            **_EXTRA,
            **_THEIRS,
        },
    )


def ladder(rows: Sequence[Document]) -> str:
    """The ladder's table, a row per level, skill set and reasoner; the paper's criterion or the
    level's own depth."""
    columns: Columns = {
        "level": itemgetter("level"),
        "method": itemgetter("method"),
        "reasoner": shown_name,
        **fault_columns(rows),
        "inserted [%]": lambda r: outcome(r, "inserted"),
        **own_columns(rows),
        "judged ≠ inserted [%]": lambda r: number(r["wrong"]["percent"], 1),
        "false accepts [%]": lambda r: number(r["false_accepts"]["percent"], 1),
        "executions": lambda r: number(r["executions"], 1),
        "motions": lambda r: number(r["moves"], 0),
        "simulated time [s]": lambda r: number(r["simulated_s"], 0),
        "failures": lambda r: ", ".join(f"{n} {k}" for k, n in r["failure_kinds"].items()) or NONE,
    }
    return marked(Table.of(rows, columns), rows)


def scenarios(rows: Sequence[Document]) -> str:
    """The scenarios' table, a row per scenario, skill set and reasoner: how often it ended as is
    right, and otherwise."""
    columns: Columns = {
        "scenario": itemgetter("scenario"),
        "reasoner": shown_name,
        **fault_columns(rows),
        "right is to": lambda r: _RIGHT[r["right"]],
        "ended so [%]": lambda r: outcome(r, "rightly"),
        "diagnosis right [%]": lambda r: outcome(r, "diagnosed"),
        **own_columns(rows),
        "inserted": lambda r: r["inserted"]["successes"],
        "stopped": lambda r: r["stopped"]["successes"],
        "ten failures": lambda r: r["exhausted"]["successes"],
        "cap": lambda r: r["cap"]["successes"],
        "false accepts": lambda r: r["false_accepts"]["successes"],
        "executions": lambda r: number(r["executions"], 1),
        "simulated time [s]": lambda r: number(r["simulated_s"], 0),
    }
    return marked(Table.of(rows, columns), rows)


def table4(cells: Sequence[Document]) -> str:
    """Table IV in the paper's layout, the paper's own figures beside ours."""
    columns: Columns = {
        "cell": itemgetter("cell"),
        "reasoner": shown_name,
        "hole y [mm]": lambda c: f"{c['hole_mm']:g}",
        "angle [°]": lambda c: f"{c['angle_deg']:g}",
        "n": itemgetter("n"),
        **_JUDGED_AND_TRUE,
        **own_columns(cells),
        **_EXTRA,
        "faults": itemgetter("faults"),
        "no label": lambda c: c["n"] - c["inserted"]["n"],
        **_THEIRS,
    }
    repeated = (
        "In a simulated cell the trials of a combination are repeats of one trial, in an"
        " emulated one almost so: their intervals tell nothing. The paper's are a real robot's."
    )
    told = [repeated] if any(c["cell"] in _SIMULATED for c in cells) else []
    return marked(Table.of(cells, columns), cells, *told)


def table3(transitions: Sequence[Document], papers_reasoner: str) -> str:
    """Table III per peg and reasoner, with n in each row; the paper's for the circle."""
    rows = []
    for t in transitions:
        for origin, to in t["counts"].items():
            n = sum(to.values())
            shares = [f"{100 * to[f] / n:.1f}" for f in RECOVERABLE]
            rows.append([t["peg"], shown_name(t), origin, *shares, n])
    with_paper = {t["peg"]: t["paper"] for t in transitions if t["paper"] is not None}
    for peg, theirs in with_paper.items():
        for origin, to in theirs.items():
            shares = [f"{to[f]:.1f}" for f in RECOVERABLE]
            rows.append([peg, f"paper: {papers_reasoner}", origin, *shares, NONE])
    head = ["peg", "reasoner", "from", *(f"to {f}" for f in RECOVERABLE), "n"]
    return Table(head, rows).markdown() if rows else "No execution was followed by a plan."


def pairs(rows: Sequence[Document]) -> str:
    """A table of differences in success for every two reasoners: all cells together, then cell by
    cell, with what its numbers mean."""
    if not rows:
        return "Only one reasoner."
    columns: Columns = {
        "first − second": versus,
        "peg": lambda r: r["peg"] or "all",
        "condition": lambda r: r["condition"] or "all",
        "n": itemgetter("n"),
        "difference [points]": lambda r: (
            f"{r['difference']:+.1f} [{r['low']:+.1f}, {r['high']:+.1f}]"
        ),
        "only first": itemgetter("only_first"),
        "only second": itemgetter("only_second"),
        "McNemar p": lambda r: f"{r['p']:.2g}",
    }
    return "\n\n".join([paired(rows), Table.of(by_cell(rows), columns).markdown()])


def versus(row: Document) -> str:
    """The two reasoners of a row of pairs."""
    return f"{row.get('first_shown', row['first'])} − {row.get('second_shown', row['second'])}"


def by_cell(rows: Sequence[Document]) -> list[Document]:
    """The rows of pairs with those of all cells together first, then cell by cell."""
    places = list(dict.fromkeys(_place(r) for r in rows if r["peg"]))
    return sorted(rows, key=lambda r: places.index(_place(r)) if r["peg"] else -1)


def paired(rows: Sequence[Document]) -> str:
    """A paragraph on what the numbers of a table of pairs mean."""
    several = len({_place(r) for r in rows if r["peg"]}) > 1
    return " ".join([PAIRED, POOLED]) if several else PAIRED


_place = itemgetter("level", "peg", "condition")


def depth(cells: Sequence[Document]) -> str:
    """A table of the share of trials that ended at least so deep."""
    names = list(dict.fromkeys(d for c in cells for d in c["depth"]))
    return _shares(cells, "depth", {d: f"≥ {d} mm [%]" for d in names})


def grasp_angle(cells: Sequence[Document]) -> str:
    """A table of success by the size of the drawn grasp angle."""
    drawn = [c for c in cells if c["grasp_angle"]]
    if not drawn:
        return "No cell draws the grasp angle."
    names = list(dict.fromkeys(b for c in drawn for b in c["grasp_angle"]))
    names.sort(key=lambda name: float(name.partition("–")[0]))
    return _shares(drawn, "grasp_angle", {b: f"{b}° [%]" for b in names})


def _shares(cells: Sequence[Document], what: str, names: Mapping[str, str]) -> str:
    """A table of the rates that each cell holds of something, under these names."""
    rows = [[*who(c), *(rate(c[what].get(part)) for part in names)] for c in cells]
    return Table([*WHO, *names.values()], rows).markdown()


def align(cells: Sequence[Document]) -> str:
    """A table of overshoot cycles, and of false acceptances of Align that end in a compression
    stop."""
    columns: Columns = {
        **WHO,
        "overshoot cycles": lambda c: c["align"]["cycles"],
        "in trials": lambda c: c["align"]["trials_with_cycles"],
        "accepted": lambda c: c["align"]["accepted"],
        "falsely": lambda c: c["align"]["false"],
        "then compression stop": lambda c: c["align"]["stopped"],
    }
    return Table.of(cells, columns).markdown()


def failure_kinds(cells: Sequence[Document]) -> str:
    """A table of how many trials failed in each way, for the cells that have any."""
    failed, kinds = failures(cells)
    if not failed:
        return "None."
    rows = [[*who(c), c["n"], *(c["failure_kinds"].get(k, 0) for k in kinds)] for c in failed]
    meanings = "\n".join(f"- {spoken}: {TRIAL_KINDS[kind]}" for kind, spoken in kinds.items())
    return f"{Table([*WHO, 'n', *kinds.values()], rows).markdown()}\n\n{meanings}"


def failures(cells: Sequence[Document]) -> tuple[list[Document], dict[str, str]]:
    """The cells in which any trial failed, and the kinds of failure in them, each in words."""
    failed = [c for c in cells if c["failure_kinds"]]
    kinds = [k for k in TRIAL_KINDS if any(k in c["failure_kinds"] for c in failed)]
    return failed, {kind: kind.replace("_", " ") for kind in kinds}


def own(cells: Sequence[Document]) -> str:
    """A table of how many decisions were the model's own, and how often it inserts without the
    rules."""
    columns: Columns = {
        **WHO,
        "n": itemgetter("n"),
        "G [%]": lambda c: rate(c["inserted"]),
        "G alone [%]": lambda c: rate(c["own"]["alone"]),
        "decisions": lambda c: c["own"]["decisions"],
        "own [%]": lambda c: own_percent(c["own"]),
        "clamped": lambda c: c["own"]["clamped"],
        "by the rules": lambda c: c["own"]["fallbacks"],
        "tokens a trial": lambda c: f"{c['own']['tokens']:.0f}",
        "USD a trial": lambda c: number(c["own"]["cost_usd"], 4),
    }
    meaning = (
        "G alone counts a trial in which a plan was clamped or the rules stepped in as failed."
    )
    return marked(Table.of([c for c in cells if c.get("own")], columns), cells, meaning)


def _faults_section(cells: Sequence[Document]) -> list[str]:
    """A section on the trials in which nothing was measured, with what was said; empty where there
    are none."""
    if not fault_columns(cells):
        return []
    rows = [
        [*who(c), said["n"], said["text"].replace("|", "\\|")]
        for c in cells
        for said in c.get("said", ())
    ]
    return [
        "## Faults: trials in which nothing was measured",
        Table([*WHO, "trials", "fault"], rows).markdown(),
        "The command that made them repeats these and no others with `--again faults`, as long as"
        " your own reasoner's and method's files are as they were.",
    ]


def _where(cells: Sequence[Document]) -> list[str]:
    """Sentences on where the trials took place, for any cell but the simulated one."""
    kinds = dict.fromkeys(c.get("cell", "sim") for c in cells)
    return [_CELLS[kind] for kind in kinds if kind in _CELLS]


def _extra(formation: str) -> Callable[[Document], str]:
    return lambda cell: number(cell["extra"][formation], 2)


_JUDGED_AND_TRUE: Columns = {
    "F [%]": lambda cell: outcome(cell, "judged"),
    "G [%]": lambda cell: outcome(cell, "inserted"),
}
_EXTRA: Columns = {str(formation): _extra(formation) for formation in RECOVERABLE}
_THEIRS: Columns = {
    "paper's F, G [%]": lambda cell: their_success(cell["paper"], with_n=True),
    "paper's fit, align, insertion": lambda cell: their_extra(cell["paper"]),
}
