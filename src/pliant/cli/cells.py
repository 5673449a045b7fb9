"""The option `--cell`: which cell a command uses."""

from pathlib import Path

from pliant.experiment.where import Where


def where(cell: str) -> Where:
    """The cell that `--cell` names: sim, or the path of a cell's file.

    Raises:
        InputError: the file cannot be used.
    """
    chosen = Where(file=None if cell == "sim" else Path(cell))
    _ = chosen.configuration  # refuses before anything else is done
    return chosen
