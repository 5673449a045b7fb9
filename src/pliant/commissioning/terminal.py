"""Single keys from a terminal, which is put back as it was whatever happens."""

import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from pliant.commissioning.keys import split
from pliant.errors import InputError

_WHOLE_S = 0.05  # for the rest of an escape sequence
_OFF = b"\x00"


class Keys:
    """The keys that a person presses at the terminal. A terminal that has gone away presses q."""

    def __init__(self, file: int) -> None:
        self._file = file
        self._rest = b""
        self._is_interrupted = False

    def wait(self, seconds: float) -> list[str]:
        """The keys pressed until now; if none, those pressed first within `seconds`.

        Raises:
            KeyboardInterrupt: also when it was raised before, where somebody's code lost it.
        """
        if self._is_interrupted:
            raise KeyboardInterrupt
        if not self._is_ready(seconds):
            return []
        found: list[str] = []
        while self._is_ready(_WHOLE_S if self._rest else 0.0):
            try:
                data = os.read(self._file, 1024)
            except OSError:
                data = b""
            if not data:
                return [*found, "q"]
            pressed, self._rest = split(self._rest + data)
            found += pressed
        self._rest = b""
        return found

    def interrupt(self, _number: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self._is_interrupted = True
        raise KeyboardInterrupt

    def _is_ready(self, seconds: float) -> bool:
        return bool(select.select([self._file], [], [], seconds)[0])


def check_terminal() -> None:
    """Check that there is a terminal. Raises InputError when standard input or output is not
    one."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError("keys are read from a terminal, and this is none: use ssh -t, and no pipe")


@contextmanager
def single_keys() -> Iterator[Keys]:
    """Keys one by one and unseen, as long as this context lasts. Ctrl-C, a hangup and a request to
    end raise KeyboardInterrupt, so that whatever moves is halted on the way out; Ctrl-Z, which
    would leave it unattended, does nothing.

    Raises:
        InputError: standard input or output is not a terminal.
    """
    check_terminal()
    file = sys.stdin.fileno()
    before = termios.tcgetattr(file)
    keys = Keys(file)
    signals = (signal.SIGINT, signal.SIGHUP, signal.SIGTERM)
    handlers = {number: signal.signal(number, keys.interrupt) for number in signals}
    try:
        tty.setcbreak(file)
        attributes: list[Any] = termios.tcgetattr(file)
        attributes[6][termios.VSUSP] = _OFF
        termios.tcsetattr(file, termios.TCSANOW, attributes)
        yield keys
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        with suppress(termios.error):  # it has gone away
            termios.tcsetattr(file, termios.TCSAFLUSH, before)
