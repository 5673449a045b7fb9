"""The tables as Markdown, for a terminal, a file or the README."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from pliant.experiment.ladder import VARIES
from pliant.experiment.measures import is_partly, is_undecided, name
from pliant.experiment.success import TRIAL_KINDS
from pliant.formations import RECOVERABLE
from pliant.text import escaped

Document = Mapping[str, Any]
PARTLY = "†"
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
_PAPERS = ("paper's F, G [%]", "paper's fit, align, insertion")
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
        *_table4_section(document.get("placed", [])),
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


def table2(cells: Sequence[Document]) -> str:
    """Table II in the paper's layout, the paper's own figures beside ours."""
    beside = _faults_beside(cells)
    header = ["peg", "condition", "reasoner", "n", *beside, "F [%]", "G [%]", *_own_beside(cells)]
    header += [*(str(f) for f in RECOVERABLE), *_PAPERS]
    rows = [
        [*_who(c), str(c["n"]), *(str(c["faults"]) for _ in beside)]
        + [_outcome(c, "judged"), _outcome(c, "inserted"), *_own(c, cells)]
        + [*_extra(c), *_theirs(c["paper"])]
        for c in cells
    ]
    text = _table(header, rows)
    faults = sum(c["faults"] for c in cells)
    disagreed, n = sum(c["disagreed"] for c in cells), sum(c["n"] for c in cells)
    told = f"Judged ≠ inserted in {disagreed} of {n} trials; faults in {faults}."
    made = dict.fromkeys(c["made_by"] for c in cells if c.get("made_by"))
    told += f" Made by {' and '.join(made)}." if made else ""
    return "\n\n".join([text, told, *marks(r.get("own") for r in cells)])


def _section(
    title: str, table: Callable[[Sequence[Document]], str], document: Document, name: str
) -> list[str]:
    rows = document.get(name, [])
    return [f"## {title}", table(rows)] if rows else []


def ladder(rows: Sequence[Document]) -> str:
    """The ladder's table, a row per level, skill set and reasoner; the paper's criterion or the
    level's own depth."""
    beside = _faults_beside(rows)
    header = ["level", "method", "reasoner", *beside, "inserted [%]", *_own_beside(rows)]
    header += ["judged ≠ inserted [%]"]
    header += ["false accepts [%]", "executions", "motions", "simulated time [s]", "failures"]
    table = _table(
        header,
        [
            [r["level"], r["method"], shown_name(r), *(str(r.get("faults", 0)) for _ in beside)]
            + [_outcome(r, "inserted"), *_own(r, rows), _number(r["wrong"]["percent"], 1)]
            + [_number(r["false_accepts"]["percent"], 1), _number(r["executions"], 1)]
            + [_number(r["moves"], 0), _number(r["simulated_s"], 0)]
            + [", ".join(f"{n} {kind}" for kind, n in r["failure_kinds"].items()) or "–"]
            for r in rows
        ],
    )
    return "\n\n".join([table, *marks(r.get("own") for r in rows)])


def scenarios(rows: Sequence[Document]) -> str:
    """The scenarios' table, a row per scenario, skill set and reasoner: how often it ended as is
    right, and otherwise."""
    beside = _faults_beside(rows)
    header = ["scenario", "reasoner", *beside, "right is to", "ended so [%]"]
    header += ["diagnosis right [%]", *_own_beside(rows), "inserted", "stopped"]
    header += ["ten failures", "cap", "false accepts", "executions", "simulated time [s]"]
    counted = ("inserted", "stopped", "exhausted", "cap", "false_accepts")
    table = _table(
        header,
        [
            [r["scenario"], shown_name(r), *(str(r.get("faults", 0)) for _ in beside)]
            + [_RIGHT[r["right"]], _outcome(r, "rightly"), _outcome(r, "diagnosed")]
            + [*_own(r, rows)]
            + [str(r[name]["successes"]) for name in counted]
            + [_number(r["executions"], 1), _number(r["simulated_s"], 0)]
            for r in rows
        ],
    )
    return "\n\n".join([table, *marks(r.get("own") for r in rows)])


def table4(cells: Sequence[Document]) -> str:
    """Table IV in the paper's layout, the paper's own figures beside ours."""
    header = ["cell", "reasoner", "hole y [mm]", "angle [°]", "n", "F [%]", "G [%]"]
    header += _own_beside(cells)
    header += [*(str(f) for f in RECOVERABLE), "faults", "no label", *_PAPERS]
    rows = []
    for c in cells:
        unlabelled = str(c["n"] - c["inserted"]["n"])
        rows.append(
            [c["cell"], _who(c)[2], f"{c['hole_mm']:g}", f"{c['angle_deg']:g}", str(c["n"])]
            + [_outcome(c, "judged"), _outcome(c, "inserted"), *_own(c, cells), *_extra(c)]
            + [str(c["faults"]), unlabelled, *_theirs(c["paper"])]
        )
    text = _table(header, rows)
    if any(c["cell"] in _SIMULATED for c in cells):
        text += (
            "\n\nIn a simulated cell the trials of a combination are repeats of one trial, in an"
            " emulated one almost so: their intervals tell nothing. The paper's are a real robot's."
        )
    return "\n\n".join([text, *marks(r.get("own") for r in cells)])


def table3(transitions: Sequence[Document], papers_reasoner: str) -> str:
    """Table III per peg and reasoner, with n in each row; the paper's for the circle."""
    rows = []
    for t in transitions:
        for origin, to in t["counts"].items():
            n = sum(to.values())
            shares = [f"{100 * to[f] / n:.1f}" for f in RECOVERABLE]
            rows.append([t["peg"], shown_name(t), origin, *shares, str(n)])
    with_paper = {t["peg"]: t["paper"] for t in transitions if t["paper"] is not None}
    for peg, theirs in with_paper.items():
        for origin, to in theirs.items():
            shares = [f"{to[f]:.1f}" for f in RECOVERABLE]
            rows.append([peg, f"paper: {papers_reasoner}", origin, *shares, "–"])
    header = ["peg", "reasoner", "from", *(f"to {f}" for f in RECOVERABLE), "n"]
    return _table(header, rows) if rows else "No execution was followed by a plan."


def pairs(rows: Sequence[Document]) -> str:
    """A table of differences in success for every two reasoners: all cells together, then cell by
    cell, with what its numbers mean."""
    if not rows:
        return "Only one reasoner."
    header = ["first − second", "peg", "condition", "n", "difference [points]"]
    header += ["only first", "only second", "McNemar p"]
    table = _table(
        header,
        (
            [
                f"{r.get('first_shown', r['first'])} − {r.get('second_shown', r['second'])}",
                r["peg"] or "all",
                r["condition"] or "all",
                str(r["n"]),
                f"{r['difference']:+.1f} [{r['low']:+.1f}, {r['high']:+.1f}]",
                str(r["only_first"]),
                str(r["only_second"]),
                f"{r['p']:.2g}",
            ]
            for r in by_cell(rows)
        ),
    )
    return "\n\n".join([paired(rows), table])


def by_cell(rows: Sequence[Document]) -> list[Document]:
    """The rows of pairs with those of all cells together first, then cell by cell."""
    places = list(dict.fromkeys(_place(r) for r in rows if r["peg"]))
    return sorted(rows, key=lambda r: places.index(_place(r)) if r["peg"] else -1)


def paired(rows: Sequence[Document]) -> str:
    """A paragraph on what the numbers of a table of pairs mean."""
    several = len({_place(r) for r in rows if r["peg"]}) > 1
    return " ".join([PAIRED, POOLED]) if several else PAIRED


def _place(row: Document) -> tuple[Any, ...]:
    return row["level"], row["peg"], row["condition"]


def depth(cells: Sequence[Document]) -> str:
    """A table of the share of trials that ended at least so deep."""
    names = list(dict.fromkeys(d for c in cells for d in c["depth"]))
    header = ["peg", "condition", "reasoner", *(f"≥ {d} mm [%]" for d in names)]
    return _table(header, ([*_who(c), *(_rate(c["depth"][d]) for d in names)] for c in cells))


def grasp_angle(cells: Sequence[Document]) -> str:
    """A table of success by the size of the drawn grasp angle."""
    drawn = [c for c in cells if c["grasp_angle"]]
    if not drawn:
        return "No cell draws the grasp angle."
    names = list(dict.fromkeys(b for c in drawn for b in c["grasp_angle"]))
    names.sort(key=lambda name: float(name.partition("–")[0]))
    header = ["peg", "condition", "reasoner", *(f"{b}° [%]" for b in names)]
    return _table(
        header, ([*_who(c), *(_rate(c["grasp_angle"].get(b)) for b in names)] for c in drawn)
    )


def align(cells: Sequence[Document]) -> str:
    """A table of overshoot cycles, and of false acceptances of Align that end in a compression
    stop."""
    header = ["peg", "condition", "reasoner", "overshoot cycles", "in trials", "accepted"]
    header += ["falsely", "then compression stop"]
    names = ("cycles", "trials_with_cycles", "accepted", "false", "stopped")
    return _table(header, ([*_who(c), *(str(c["align"][n]) for n in names)] for c in cells))


def failure_kinds(cells: Sequence[Document]) -> str:
    """A table of how many trials failed in each way, for the cells that have any."""
    failed = [c for c in cells if c["failure_kinds"]]
    if not failed:
        return "None."
    kinds = [k for k in TRIAL_KINDS if any(k in c["failure_kinds"] for c in failed)]
    header = ["peg", "condition", "reasoner", "n", *(k.replace("_", " ") for k in kinds)]
    rows = (
        [*_who(c), str(c["n"]), *(str(c["failure_kinds"].get(k, 0)) for k in kinds)] for c in failed
    )
    meanings = "\n".join(f"- {k.replace('_', ' ')}: {TRIAL_KINDS[k]}" for k in kinds)
    return f"{_table(header, rows)}\n\n{meanings}"


def own(cells: Sequence[Document]) -> str:
    """A table of how many decisions were the model's own, and how often it inserts without the
    rules."""
    header = ["peg", "condition", "reasoner", "n", "G [%]", "G alone [%]", "decisions", "own [%]"]
    header += ["clamped", "by the rules", "tokens a trial", "USD a trial"]
    rows = []
    for c in cells:
        share = c.get("own")
        if share is not None:
            cost = "–" if share["cost_usd"] is None else f"{share['cost_usd']:.4f}"
            counts = [str(share[n]) for n in ("clamped", "fallbacks")]
            rows.append(
                [*_who(c), str(c["n"]), _rate(c["inserted"]), _rate(share["alone"])]
                + [str(share["decisions"]), f"{share['own_percent']:.1f}", *counts]
                + [f"{share['tokens']:.0f}", cost]
            )
    meaning = (
        "G alone counts a trial in which a plan was clamped or the rules stepped in as failed."
    )
    return "\n\n".join([_table(header, rows), meaning, *marks(r.get("own") for r in cells)])


def _own_beside(rows: Sequence[Document]) -> list[str]:
    """The header cells of a model's own share and of its success alone, where any row is a
    model's."""
    return ["own [%]", "G alone [%]"] if any(row.get("own") for row in rows) else []


def _own(row: Document, rows: Sequence[Document]) -> list[str]:
    """A row's cells under `_own_beside`."""
    share = row.get("own")
    if not _own_beside(rows):
        return []
    return ["–", "–"] if share is None else [f"{share['own_percent']:.1f}", _rate(share["alone"])]


def marks(shares: Iterable[Document | None]) -> list[str]:
    """Explanations of the names of `shown_name`, a line each, where they are not the plain ones."""
    shares = list(shares)
    lines = []
    if any(map(is_partly, shares)):
        lines.append(
            f"{PARTLY} Not every decision was the model's own: own says how many [%], and G"
            " alone is its success where a trial with the rules' help counts as failed."
        )
    if any(map(is_undecided, shares)):
        lines.append(
            "rules (for …): the model that was asked decided nothing, so the row is the rules';"
            " nobody (for …): nor could they. It says nothing of the model."
        )
    return lines


def shown_name(row: Document) -> str:
    """The name of a row's reasoner: marked where only some of the decisions were the model's."""
    model = f" ({row['model']})" if row.get("model") else ""
    share = row.get("own")
    mark = f" {PARTLY}" if is_partly(share) else ""
    return name(row["reasoner"] + model, share) + mark


def _table4_section(placed: Sequence[Document]) -> list[str]:
    if not placed:
        return []
    return ["## Table IV: success by the place of the hole and the grasp angle", table4(placed)]


def _where(cells: Sequence[Document]) -> list[str]:
    """Sentences on where the trials took place, for any cell but the simulated one."""
    kinds = dict.fromkeys(c.get("cell", "sim") for c in cells)
    return [_CELLS[kind] for kind in kinds if kind in _CELLS]


def _extra(cell: Document) -> list[str]:
    return [_number(cell["extra"][f], 2) for f in RECOVERABLE]


def _faults_section(cells: Sequence[Document]) -> list[str]:
    """A section on the trials in which nothing was measured, with what was said; empty where there
    are none."""
    if not _faults_beside(cells):
        return []
    header = ["peg", "condition", "reasoner", "trials", "fault"]
    rows = [
        [*_who(c), str(said["n"]), said["text"].replace("|", "\\|")]
        for c in cells
        for said in c.get("said", ())
    ]
    return [
        "## Faults: trials in which nothing was measured",
        _table(header, rows),
        "The command that made them repeats these and no others with `--again faults`, as long as"
        " your own reasoner's and method's files are as they were.",
    ]


def _faults_beside(rows: Sequence[Document]) -> list[str]:
    """The header cell of a column of faults, where any row has one."""
    return ["faults"] if any(row.get("faults") for row in rows) else []


def _outcome(row: Document, name: str) -> str:
    """A row's rate, unless nothing but faults came of it."""
    return "faults" if row.get("faults") and not row["n"] else _rate(row[name])


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _theirs(paper: Document | None) -> list[str]:
    if paper is None:
        return ["–", "–"]
    success = f"{paper['judged']:g}, {paper['inserted']:g} (n {paper['n']})"
    return [success, ", ".join(f"{v:.1f}" for v in paper["extra"].values()) or "–"]


def _who(cell: Document) -> list[str]:
    level = "" if cell["level"] == "L0" else f" {cell['level']}"
    return [cell["peg"] + level, cell["condition"], shown_name(cell)]


def _rate(rate: Document | None) -> str:
    if rate is None or rate["n"] == 0:
        return "–"
    return f"{rate['percent']:.1f} [{rate['low']:.1f}, {rate['high']:.1f}] of {rate['n']}"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
