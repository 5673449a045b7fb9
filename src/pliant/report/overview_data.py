"""The list of an experiment's trials as the page's script reads it: compact columns, and for each
cell the command that shows one of its trials."""

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import Any
from urllib.parse import quote

from pliant.conditions import CONDITIONS
from pliant.errors import InputError
from pliant.experiment import faults
from pliant.experiment.columns import TRIALS
from pliant.experiment.measures import Row, inserted, names
from pliant.experiment.success import TRIAL_KINDS
from pliant.levels import FIELDS, shipped_levels
from pliant.pose import Axis
from pliant.report import words
from pliant.report.summary import Names, Summary
from pliant.report.trial import PAGE
from pliant.store import TRIALS as FOLDER
from pliant.task import load_task, shipped_pegs
from pliant.text import rounded, visible

_NAMES = ("level", "peg", "condition", "reasoner")
_DRAWN = "drawn_"
_ASKED = {"decisions": 0, "fallbacks": 0, "clamped": 0, "tokens": 0, "cost_usd": 6, "latency_s": 1}
"""The columns about a model, shown where one was asked, and their digits."""

_PEG_FILE = "PEG.yaml"
"""A stand-in in a command for a peg file of the user's own, whose path the results do not hold."""


def quantities() -> dict[str, Axis | None]:
    """Every quantity that can be drawn, as its column names it, and the axis whose unit it has."""
    units = {"m": Axis.Y, "rad": Axis.ROLL}
    return {c.name: units.get(c.unit) for c in TRIALS if c.name.startswith(_DRAWN)}


def in_report(axis: Axis | None, value: float) -> float:
    """A drawn value in the unit in which it is shown, as exactly as the list of trials holds it."""
    return rounded(value if axis is None else axis.to_report(value), 3)


def varying(trials: Sequence[Row]) -> dict[str, Axis | None]:
    """The drawn quantities that differ between the trials; a run from before a quantity existed has
    none of it."""
    return {
        name: axis
        for name, axis in quantities().items()
        if len({trial.get(name) for trial in trials}) > 1
    }


def heading(column: str) -> str:
    """A drawn quantity's name with its unit."""
    name = column.removeprefix(_DRAWN)
    return f"{words.drawn(name, 0.0)[0]} [{words.drawn_unit(name)}]"


def data(summary: Summary, pages: Collection[str]) -> dict[str, Any]:
    """The data that the page's script reads. `pages` has the id of each trial with a page."""
    trials = summary.trials
    cells = list(dict.fromkeys(map(names, trials)))
    place = {of: n for n, of in enumerate(cells)}
    models = {names(t): t["model"] for t in trials}
    ends = list(dict.fromkeys(map(faults.told, trials)))
    places = {text: n for n, text in enumerate(ends)}
    kinds = list(TRIAL_KINDS)
    columns: dict[str, Sequence[Any]] = {
        "cell": [place[names(t)] for t in trials],
        "seed": [t["seed"] for t in trials],
        "judged": [int(t["judged"]) for t in trials],
        "inserted": [_truth(t) for t in trials],
        "depth": [_rounded(t["depth_m"], 1, 1e3) for t in trials],
        "fault": [int(faults.is_fault(t)) for t in trials],
        "end": [places[faults.told(t)] for t in trials],
        "kind": [_place(kinds, t["failure_kind"]) for t in trials],
        "executions": [t["executions"] for t in trials],
        **{
            name: [_rounded(in_report(axis, t[name])) for t in trials]
            for name, axis in varying(trials).items()
        },
    }
    if any(t.get("decisions") for t in trials):
        for name, digits in _ASKED.items():
            columns[name] = [_rounded(t[name], digits) for t in trials]
    return {
        "cells": [
            {
                **dict(zip(_NAMES, map(visible, of), strict=True)),
                "model": visible(models[of] or ""),
                "command": visible(command(of, summary.cells.get(of))),
            }
            for of in cells
        ],
        "ends": [visible(end) for end in ends],
        "kinds": [kind.replace("_", " ") for kind in kinds],
        "kindNames": kinds,
        "quantities": {name: heading(name) for name in varying(trials)},
        "columns": columns,
        "pages": {
            n: f"{FOLDER}/{quote(t['trial_id'])}/{PAGE}"
            for n, t in enumerate(trials)
            if t["trial_id"] in pages
        },
    }


def command(of: Names, cell: Mapping[str, Any] | None) -> str:
    """A command that runs and shows one trial of a cell, with SEED for its seed. `cell` is its
    configuration."""
    level, peg, condition, reasoner = of
    settings = (cell or {}).get("vlm")
    options = ["--peg", _peg(peg, level, cell), *_condition(condition, cell)]
    if settings:
        options += ["--reasoner", "vlm", "--model", str(settings.get("model"))]
        if settings.get("base_url"):
            options += ["--base-url", str(settings["base_url"])]
    else:
        options += ["--reasoner", reasoner]
    if level != "L0":
        options += ["--level", level]
    rung, method = shipped_levels().get(level), (cell or {}).get("method")
    if rung is not None and method not in (None, rung.method):
        options += ["--method", str(method)]
    return f"pliant run {shlex.join(options)} --seed SEED"


def _peg(peg: str, level: str, cell: Mapping[str, Any] | None) -> str:
    """The peg's name in a command: the shipped one's, unless the cell's peg only has the same
    name."""
    if peg not in shipped_pegs():
        return _PEG_FILE
    try:
        shipped = asdict(load_task(peg, level))
    except InputError:
        return peg  # a level that this pliant does not know
    same = cell is None or _listed(shipped["peg"]) == _listed(cell["task"]["peg"])
    return peg if same else _PEG_FILE


def _condition(condition: str, cell: Mapping[str, Any] | None) -> list[str]:
    if condition in CONDITIONS or cell is None:
        return ["--condition", condition]
    ranges = cell["condition"].get("ranges", {})
    level = shipped_levels().get(cell["level"])
    if level is not None:  # draws its own
        ranges = {q: r for q, r in ranges.items() if list(level.ranges.get(q, ())) != list(r)}
    options = ["--condition", "none"]
    for field, (quantity, axis) in FIELDS.items():
        if quantity in ranges:
            given = [v if axis is None else axis.to_report(v) for v in ranges[quantity]]
            options += [f"--{field.replace('_', '-')}", *(f"{v:.12g}" for v in given)]
    return options


def _listed(peg: Mapping[str, Any]) -> dict[str, Any]:
    """A peg as it is after JSON, which has no tuples."""
    return {**peg, "outline": [list(corner) for corner in peg["outline"]]}


def _truth(trial: Row) -> int | None:
    known = inserted(trial)
    return None if known is None else int(known)


def _place(names: Sequence[str], name: str | None) -> int:
    return -1 if name is None else names.index(name)


def _rounded(value: float | None, digits: int = 3, factor: float = 1.0) -> float | None:
    """A value rounded to be short in JSON: a whole number without its point."""
    if value is None:
        return None
    rounded = round(value * factor, digits)
    return int(rounded) if rounded == int(rounded) else rounded
