"""The option `--cell`: which cell a command uses, and trials in one that a file describes."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pliant.cell import Workcell
from pliant.errors import InputError
from pliant.experiment.attended import Attended
from pliant.experiment.cells import Experiment
from pliant.experiment.where import Where
from pliant.own import located_own, own_file
from pliant.paths import located

if TYPE_CHECKING:
    from pliant.ur5e.cell import Operator


def where(cell: str) -> Where:
    """The cell that `--cell` names: sim, or the path of a cell's file.

    Raises:
        InputError: the file cannot be used, or it is a cell of the user's own.
    """
    if own_file(cell) is not None:
        raise InputError(
            f"--cell {cell}: a cell of your own is for run and experiment; give sim, or the path of"
            " a cell's file (.yaml)"
        )
    chosen = Where(file=None if cell == "sim" else located(cell))
    _ = chosen.configuration  # refuses before anything else is done
    return chosen


def where_trials_are(cell: str) -> Where:
    """The cell that `--cell` names for trials: as `where`, or `file.py:Class`.

    Raises:
        InputError: the file or the class cannot be used.
    """
    if own_file(cell) is None:
        return where(cell)
    chosen = Where(own=located_own(cell))
    _ = chosen.kind  # refuses before anything else is done
    return chosen


@contextmanager
def opened(chosen: Where, operator: "Operator | None" = None) -> Iterator[Workcell]:
    """The chosen cell, which is disconnected at the end of this context."""
    workcell = chosen.open(operator)
    try:
        yield workcell
    finally:
        close = getattr(workcell, "close", None)
        if close is not None:
            close()


@contextmanager
def attended(experiment: Experiment, *, one_trial: bool = False) -> Iterator[Attended]:
    """The experiment's cell, connected until the end of this context; a real one with the person at
    this terminal.

    Raises:
        InputError: the cell cannot be used, or nobody is at the terminal of a real one.
    """
    from pliant.commissioning.attending import Attending

    needs_person = experiment.where.kind == "ur5e"
    if needs_person and not sys.stdin.isatty():
        raise InputError("a real cell needs a person who places things: run this in a terminal")
    person = Attending(one_trial=one_trial) if needs_person else None
    with opened(experiment.where, person) as cell:
        yield Attended(cell, experiment, person)
