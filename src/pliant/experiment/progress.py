"""The progress of an experiment: a bar and a line per cell on a terminal, a plain line now and then
elsewhere."""

import time
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from pliant.console import Console
from pliant.experiment.cells import Experiment

_PLAIN_EVERY_S = 30.0
_FAULTS_SAID = 20  # different ones; the tables have them all
_CELLS_SHOWN = 24  # more do not fit a screen: then those that are being worked on


class Watcher(Protocol):
    """A watcher of a run, told by the runner as it goes. It is used as a context."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        return

    def known(self, cell: int, inserted: bool | None, fault: str = "") -> None:
        """Note that a trial of that cell was finished before this start; `fault` says what kept it
        from being measured."""
        return

    def finished(self, cell: int, inserted: bool | None, fault: str = "") -> None:
        """Note that a trial of that cell is finished now."""
        return

    def say(self, text: str) -> None:
        """Tell something about the whole run."""
        return


class Silent(Watcher):
    """A watcher that shows nothing."""


@dataclass(kw_only=True)
class _Count:
    done: int = 0
    inserted: int = 0
    faults: int = 0


class Shown:
    """A watcher that shows an experiment's progress on a console."""

    def __init__(self, experiment: Experiment, console: Console) -> None:
        self._experiment = experiment
        self._console = console
        self._counts = [_Count() for _ in experiment.cells]
        self._began = self._said = time.monotonic()
        self._done = self._fresh = 0
        self._faults: set[str] = set()  # said already
        self._bar = Progress(
            TextColumn("trials"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            console=console,
        )
        self._task = self._bar.add_task("trials", total=len(experiment), rate="")
        self._live = Live(
            get_renderable=self._screen, console=console, refresh_per_second=4, transient=True
        )

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._console.is_terminal:
            self._live.stop()
        self._console.print(self._line(), highlight=False)

    def known(self, cell: int, inserted: bool | None, fault: str = "") -> None:
        self._count(cell, inserted, fault)

    def finished(self, cell: int, inserted: bool | None, fault: str = "") -> None:
        if not self._fresh:  # time left is judged by what is finished now
            self._bar.reset(self._task, completed=self._done)
        self._fresh += 1
        self._count(cell, inserted, fault)
        if fault and fault not in self._faults and len(self._faults) < _FAULTS_SAID:
            self._faults.add(fault)
            self.say(f"{', '.join(self._experiment.cells[cell].names)}: {fault}")
        if not self._console.is_terminal and time.monotonic() - self._said > _PLAIN_EVERY_S:
            self._said = time.monotonic()
            self._console.print(self._line(), highlight=False)

    def say(self, text: str) -> None:
        self._console.print(text, highlight=False)

    @property
    def _rate(self) -> float:
        return self._fresh / max(1e-9, time.monotonic() - self._began)

    def _count(self, cell: int, inserted: bool | None, fault: str) -> None:
        self._done += 1
        self._counts[cell].faults += bool(fault)
        self._counts[cell].done += 1
        self._counts[cell].inserted += inserted is True

    def _line(self) -> str:
        inserted, left = sum(c.inserted for c in self._counts), len(self._experiment) - self._done
        faults = sum(c.faults for c in self._counts)
        faulted = f", {faults} {'fault' if faults == 1 else 'faults'}" if faults else ""
        rate = f", {self._rate:.1f}/s" if self._fresh else ""
        until = f", {left / self._rate:.0f} s left" if self._fresh and left else ""
        done = f"{self._done} of {len(self._experiment)} trials, {inserted} inserted"
        return f"{done}{faulted}{rate}{until}"

    def _screen(self) -> Group:
        rate = f"{self._rate:.1f}/s" if self._fresh else ""
        self._bar.update(self._task, completed=self._done, rate=rate)
        table = Table(box=None, pad_edge=False, show_header=False)
        for cell, count in self._cells_shown():
            measured = count.done - count.faults
            success = f"{100 * count.inserted / measured:.0f} % inserted" if measured else ""
            faulted = f"{count.faults} faults" if count.faults else ""
            table.add_row(*cell, f"{count.done}/{self._experiment.trials}", success, faulted)
        return Group(table, self._bar)

    def _cells_shown(self) -> list[tuple[tuple[str, ...], _Count]]:
        rows: list[tuple[tuple[str, ...], _Count]] = [
            (cell.names, count)
            for cell, count in zip(self._experiment.cells, self._counts, strict=True)
        ]
        if len(rows) <= _CELLS_SHOWN:
            return rows
        busy = [r for r in rows if 0 < r[1].done < self._experiment.trials]
        return busy[:_CELLS_SHOWN]
