"""How far something is that takes longer than a few seconds, and how long it will take."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pliant.console import Console

_FIRST_S, _EVERY_S = 5.0, 30.0  # of the plain lines


@contextmanager
def counted(what: str) -> Iterator["Steps"]:
    """Show on standard error how many steps are done, until all are: a bar with the time left on a
    terminal, and elsewhere a plain line after five seconds and then every half minute."""
    steps = Steps(what)
    with steps.bar:
        yield steps


class Steps:
    """A display of steps done (`counted`)."""

    def __init__(self, what: str) -> None:
        self._console = Console(stderr=True)
        self.bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._task, self._what = self.bar.add_task(what, total=None), what
        self._began, self._next = time.monotonic(), _FIRST_S

    def tell(self, done: int, of: int, what: str | None = None) -> None:
        """Show that so many of so many steps are done; `what` is done next, where it changes."""
        self._what = what or self._what
        self.bar.update(self._task, completed=done, total=of, description=self._what)
        passed = time.monotonic() - self._began
        if not self._console.is_terminal and passed > self._next and done:
            self._next = passed + _EVERY_S
            left = f", {passed / done * (of - done):.0f} s left" if done < of else ""
            self._console.print(f"{self._what}: {done} of {of}{left}", highlight=False)
