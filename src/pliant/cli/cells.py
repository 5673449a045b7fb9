"""The option `--cell`: which cell a command uses."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pliant.cell import Workcell
from pliant.experiment.where import Where
from pliant.paths import located

if TYPE_CHECKING:
    from pliant.ur5e.cell import Operator


def where(cell: str) -> Where:
    """The cell that `--cell` names: sim, or the path of a cell's file.

    Raises:
        InputError: the file cannot be used.
    """
    chosen = Where(file=None if cell == "sim" else located(cell))
    _ = chosen.configuration  # refuses before anything else is done
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
