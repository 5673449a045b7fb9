"""The terminal, which obeys what it is sent: all lines and tables for it go through here, and text
is shown as text.

Names, reasons and errors come from files and models. A character in them that would clear the
screen, set the window's title or go back in a line is replaced by a sign for it.
"""

import sys
from collections.abc import Callable, Iterable
from typing import Any

import rich.console
from rich.segment import Segment

from pliant.text import in_a_line, visible

Told = Callable[[int, int], None]
"""What is told how many of how many steps are done."""


def untold(done: int, of: int) -> None:
    """Take no notice of steps done."""


class Console(rich.console.Console):
    """Rich's console. Whatever is rendered, however it is nested, its text is made visible; its own
    codes, for colours and for the cursor, are sent. Text in brackets is text, too: markup is obeyed
    only where `markup=True` says so."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, **options)

    def render(
        self, renderable: Any, options: rich.console.ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else visible(text), style, control)


class Lasting(Console):
    """A console that goes quiet where it can no longer be written to, as where a pipe is closed or
    a disk is full: what cannot be shown must not cost what is being done."""

    trouble: OSError | None = None

    def print(self, *objects: Any, **options: Any) -> None:
        try:
            super().print(*objects, **options)
        except OSError as error:
            self._fall_quiet(error)

    def on_broken_pipe(self) -> None:
        self._fall_quiet(BrokenPipeError())

    def check(self) -> None:
        """Raise OSError if something could not be shown."""
        if self.trouble is not None:
            raise self.trouble

    def _fall_quiet(self, error: OSError) -> None:
        self.quiet, self.trouble = True, error


def say(text: str) -> None:
    """Print a text to stdout. It may be several lines, such as a table in Markdown."""
    print(visible(text), flush=True)


def complain(text: str) -> None:
    """Print one line to stderr."""
    print(in_a_line(text), file=sys.stderr, flush=True)
