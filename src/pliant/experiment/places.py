"""Where each finished trial's line stands in the journal."""

from array import array
from collections.abc import Iterator
from pathlib import Path

from pliant.errors import InputError
from pliant.experiment import growth, journal, one
from pliant.experiment.cells import Experiment
from pliant.experiment.one import Spec


class Places:
    """The places of the trials' lines in the journal, in canonical order, by cell and seed, of all
    that the folder holds; -1: not finished. It takes eight bytes a trial."""

    def __init__(self, experiment: Experiment, document: growth.Document) -> None:
        self._cells: dict[str, tuple[int, range]] = {}  # where each one's trials begin; its seeds
        total = 0
        for cell in document["cells"]:
            seeds = growth.seeds(document, cell)
            self._cells[one.trial_id(growth.names(cell), 0).rpartition("-")[0]] = total, seeds
            total += len(seeds)
        self.offsets = array("q", [-1]) * total
        self._asked = {
            cell.trial_id.rpartition("-")[0]: i for i, cell in enumerate(experiment.cells)
        }
        self._seeds = range(experiment.first_seed, experiment.first_seed + experiment.trials)
        self._wanted = len(experiment)
        self.done = 0
        """Finished trials of those that are asked for."""

    @property
    def missing(self) -> int:
        return self._wanted - self.done

    @property
    def finished(self) -> list[int]:
        """The places of all finished trials' lines."""
        return [offset for offset in self.offsets if offset >= 0]

    def missing_of(self, experiment: Experiment) -> Iterator[Spec]:
        """The trials of the experiment that are not finished, in canonical order."""
        for spec in experiment.specs():
            base, seeds = self._cells[spec.trial_id.rpartition("-")[0]]
            if self.offsets[base + seeds.index(spec.seed)] < 0:
                yield spec

    def put(self, name: str, offset: int, path: Path) -> int | None:
        """Note the place of a trial's line; return the trial's cell, None where this call does not
        ask for the trial.

        Raises:
            InputError: the trial is not of what the folder holds, or was there before.
        """
        cell, index = self._index(name, path)
        if self.offsets[index] >= 0:
            raise InputError(
                f"journal '{path}' holds trial '{name}' twice: delete one of its lines"
            )
        self.offsets[index] = offset
        self.done += cell is not None
        return cell

    def forget(self, name: str, path: Path) -> None:
        """Take a trial as not finished, so that it is performed again."""
        cell, index = self._index(name, path)
        self.offsets[index] = -1
        self.done -= cell is not None

    def find_again(self, path: Path) -> None:
        """Find the places of the finished trials' lines in the journal again."""
        for entry in journal.scan(path):
            index = self._index(entry.trial_id, path)[1]
            if self.offsets[index] >= 0:
                self.offsets[index] = entry.offset

    def _index(self, name: str, path: Path) -> tuple[int | None, int]:
        """A trial's cell, where it is asked for, and its place in canonical order."""
        prefix, _, seed = name.rpartition("-")
        base, seeds = self._cells.get(prefix, (0, range(0)))
        number = int(seed) if seed.isdecimal() else -1
        if number not in seeds:
            raise InputError(
                f"journal '{path}' holds trial '{name}', which is not of this experiment: choose"
                " another folder"
            )
        cell = self._asked.get(prefix) if number in self._seeds else None
        return cell, base + seeds.index(number)
