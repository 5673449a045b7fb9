"""The paper's tables and pliant's own, from the Parquet files of a finished run and nothing else.

`build` gives them as a JSON-able dict, `markdown` as text; `write` puts both beside the data.
"""

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

from pliant import files, folders, store
from pliant.experiment import faults, ladder, measures, paper, results
from pliant.experiment.measures import Row
from pliant.experiment.tables_text import markdown
from pliant.formations import RECOVERABLE
from pliant.records import SCHEMA

MARKDOWN_FILE, JSON_FILE = "tables.md", "tables.json"
Document = dict[str, Any]
_Key = tuple[str, str, str, str]  # level, peg, condition, reasoner


def write(folder: Path) -> Document:
    """Build the tables of a finished run and write tables.md and tables.json beside its data.

    Raises:
        InputError: the Parquet files are missing or broken, or the folder cannot be written.
    """
    document = build(folder)
    keep(folder, document)
    return document


def keep(folder: Path, document: Document) -> None:
    """Write a finished run's tables beside its data.

    Raises:
        InputError: the folder cannot be written, or holds a link.
    """
    folders.refuse_links(folder, but=(store.TRIALS,))
    files.write_json(folder / JSON_FILE, document)
    files.write_bytes(folder / MARKDOWN_FILE, markdown(document).encode())


def build(folder: Path, part: Container[str] | None = None) -> Document:
    """All tables of a finished run, as JSON values; percentages from 0 to 100. With a `part`, of
    these trials only, by their trial_id.

    Raises:
        InputError: the Parquet files are missing or broken.
    """
    cells: dict[_Key, _Cell] = {}
    owner: dict[str, _Cell] = {}
    for trial in results.read_trials(folder).drop_columns(["wall_s"]).to_pylist():
        if part is not None and trial["trial_id"] not in part:
            continue
        key = measures.names(trial)
        cell = cells.setdefault(key, _Cell(key=key))
        if faults.is_fault(trial):
            cell.faulted.append(trial)
        else:
            cell.trials.append(trial)
            owner[trial["trial_id"]] = cell
    for executions in results.each_trials_executions(folder):
        if (measured := owner.get(executions[0]["trial_id"])) is not None:
            measured.add(executions)
    made_by = store.made_in(folder)
    ordered = _in_the_papers_order(cells.values())
    trials = [trial for cell in ordered for trial in (*cell.trials, *cell.faulted)]
    return {
        "schema": SCHEMA,
        "paper": {"source": paper.source(), "reasoner": paper.REASONER},
        "cells": [{**_cell(cell), "made_by": made_by} for cell in ordered],
        "placed": _table4(ordered),
        "transitions": _transitions(ordered),
        "pairs": _pairs(ordered, list(dict.fromkeys(key[3] for key in cells))),
        "ladder": ladder.rows(trials),
        "scenarios": ladder.scenarios(trials),
    }


def timing(folder: Path) -> dict[str, float]:
    """The number of trials, and the simulated and wall time [s] summed over all: it differs from
    run to run, and is kept out of the tables.

    Raises:
        InputError: as `build`.
    """
    rows = results.read_trials(folder).select(["simulated_s", "wall_s"]).to_pylist()
    return {
        "trials": len(rows),
        "simulated_s": sum(r["simulated_s"] for r in rows),
        "wall_s": sum(r["wall_s"] for r in rows),
    }


@dataclass(kw_only=True)
class _Cell:
    """One cell's rows: trials whole, those in which nothing was measured apart; executions already
    counted."""

    key: _Key
    trials: list[Row] = field(default_factory=list)
    faulted: list[Row] = field(default_factory=list)
    transitions: dict[str, Counter[str]] = field(default_factory=dict)
    align: Counter[str] = field(default_factory=Counter)

    def add(self, executions: Sequence[Row]) -> None:
        """Count one trial's executions."""
        for origin, to in measures.transitions(executions).items():
            self.transitions.setdefault(origin, Counter()).update(to)
        self.align.update(measures.false_alignments(executions))
        cycles = measures.overshoot_cycles(executions)
        self.align.update(cycles=cycles, trials_with_cycles=int(cycles > 0))


def _cell(cell: _Cell) -> Document:
    level, peg, condition, reasoner = cell.key
    trials, every = cell.trials, [*cell.trials, *cell.faulted]
    return {
        "cell": every[0]["cell"],
        "level": level,
        "peg": peg,
        "condition": condition,
        "reasoner": reasoner,
        "model": next((t["model"] for t in every if t["model"] is not None), None),
        "n": len(trials),
        "judged": measures.rate(t["judged"] for t in trials),
        "inserted": measures.rate(measures.inserted(t) for t in trials),
        "disagreed": sum(measures.inserted(t) not in (None, t["judged"]) for t in trials),
        "faults": len(cell.faulted),
        "said": faults.by_text(cell.faulted),
        "extra": measures.extra_executions(trials),
        "paper": _papers(level, peg, condition, reasoner),
        "depth": measures.depths(trials),
        "grasp_angle": measures.by_grasp_angle(trials),
        "align": {
            name: cell.align[name]
            for name in ("cycles", "trials_with_cycles", "accepted", "false", "stopped")
        },
        "failure_kinds": measures.kinds(every),
        "own": measures.model_share(trials),
    }


def _papers(level: str, peg: str, condition: str, reasoner: str) -> Document | None:
    found = paper.table2(peg, condition, reasoner) if level == "L0" else None
    return _beside(found, paper.BASELINE if reasoner == paper.BASELINE else paper.REASONER)


def _beside(found: paper.PaperCell | None, reasoner: str) -> Document | None:
    if found is None:
        return None
    return {
        "reasoner": reasoner,
        "n": found.trials,
        "judged": found.judged_percent,
        "inserted": found.inserted_percent,
        "extra": dict(found.extra),
    }


def _table4(cells: Sequence[_Cell]) -> list[Document]:
    """The cells of Table IV, with one of the paper's combinations of hole and grasp angle for its
    round peg. Empty where only the nominal one is there, which Table II has as well."""
    rows = []
    for cell in cells:
        level, peg, _, reasoner = cell.key
        placed = measures.placed([*cell.trials, *cell.faulted])
        if (level, peg) != ("L0", "circle") or placed is None:
            continue
        theirs = paper.table4(*placed)
        if theirs is not None:
            beside = None if reasoner == paper.BASELINE else _beside(theirs, paper.REASONER)
            rows.append({**_cell(cell), "hole_mm": placed[0], "angle_deg": placed[1]})
            rows[-1]["paper"] = beside
    return rows if any(row["hole_mm"] or row["angle_deg"] for row in rows) else []


def _transitions(cells: Sequence[_Cell]) -> list[Document]:
    """Table III per level, peg and reasoner, over all conditions."""
    sums: dict[tuple[str, str, str], dict[str, Counter[str]]] = {}
    trials: dict[tuple[str, str, str], list[Row]] = {}
    for cell in cells:
        level, peg, _, reasoner = cell.key
        total = sums.setdefault((level, peg, reasoner), {})
        trials.setdefault((level, peg, reasoner), []).extend(cell.trials)
        for origin, to in cell.transitions.items():
            total.setdefault(origin, Counter()).update(to)
    return [
        {
            "level": level,
            "peg": peg,
            "reasoner": reasoner,
            "counts": {o: {f: to[f] for f in map(str, RECOVERABLE)} for o, to in total.items()},
            "paper": paper.table3(peg) if level == "L0" else None,
            "own": measures.model_share(trials[level, peg, reasoner]),
        }
        for (level, peg, reasoner), total in sums.items()
        if total
    ]


def _pairs(cells: Sequence[_Cell], listed: Sequence[str]) -> list[Document]:
    """Comparisons of every two reasoners on the trials that both have: in each cell, and in all
    together. From the one that is listed later the earlier one is subtracted."""
    outcomes: dict[str, dict[tuple[str, str, str], dict[int, bool]]] = {}
    for cell in cells:
        level, peg, condition, reasoner = cell.key
        known = {t["seed"]: measures.inserted(t) for t in cell.trials}
        outcomes.setdefault(reasoner, {})[level, peg, condition] = {
            seed: result for seed, result in known.items() if result is not None
        }
    rows: list[Document] = []
    shares = {
        reasoner: measures.model_share([t for c in cells if c.key[3] == reasoner for t in c.trials])
        for reasoner in outcomes
    }
    for second, first in combinations(listed, 2):
        shared = [place for place in outcomes[first] if place in outcomes[second]]
        names = {"first": first, "second": second}
        names |= {f"{nth}_shown": measures.name(who, shares[who]) for nth, who in names.items()}
        for place in shared:
            found = measures.compare(outcomes[first][place], outcomes[second][place])
            if found is not None:
                level, peg, condition = place
                where = {"level": level, "peg": peg, "condition": condition}
                rows.append({**names, **where, **found})
        pooled = measures.compare(
            *(
                {(place, s): ok for place in shared for s, ok in outcomes[who][place].items()}
                for who in (first, second)
            )
        )
        if pooled is not None:
            rows.append({**names, "level": None, "peg": None, "condition": None, **pooled})
    return rows


def _in_the_papers_order(cells: Iterable[_Cell]) -> list[_Cell]:
    """The cells in the paper's order: the baseline first, then reasoner by reasoner, each peg by
    peg, as they came."""
    given = list(cells)
    levels, pegs, conditions, reasoners = (
        list(dict.fromkeys(cell.key[i] for cell in given)) for i in range(4)
    )
    return sorted(
        given,
        key=lambda c: (
            levels.index(c.key[0]),
            c.key[3] != paper.BASELINE,
            reasoners.index(c.key[3]),
            pegs.index(c.key[1]),
            conditions.index(c.key[2]),
        ),
    )
