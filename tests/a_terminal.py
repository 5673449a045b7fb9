"""A program in a terminal of its own, whose keys are pressed and whose screen is read."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

_PATIENCE_S = 120.0  # on a loaded machine
_OWN_TERMINAL = (
    "import fcntl, os, signal, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0);"
    " signal.signal(signal.SIGINT, signal.SIG_DFL);"  # which a background job ignores
    " os.execv(sys.argv[1], sys.argv[1:])"
)
_CONTROL = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|[@-Z\\-_])")
_HOME = "\x1b[H"


class Terminal:
    """80 columns by 24 rows. The program is the one that Ctrl-C interrupts."""

    def __init__(self, command: Sequence[str | Path]) -> None:
        self._master, self._slave = pty.openpty()
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.before: list[Any] = termios.tcgetattr(self._slave)
        self._heard = ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", _OWN_TERMINAL, *map(str, command)],
            stdin=self._slave,
            stdout=self._slave,
            stderr=self._slave,
            start_new_session=True,
            env={
                **os.environ,
                "TERM": "xterm-256color",
                "COLORTERM": "truecolor",
                "PYTHONFAULTHANDLER": "1",
            },
        )

    def press(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def until(self, pattern: str) -> str:
        """Wait until the screen shows a pattern; the screen."""
        give_up = time.monotonic() + _PATIENCE_S
        while not re.search(pattern, self.screen):
            assert time.monotonic() < give_up, f"no '{pattern}' on the screen:\n{self.screen}"
            self._hear(0.1)
        return self.screen

    @property
    def screen(self) -> str:
        """What was written since the cursor was last put home."""
        return _CONTROL.sub("", self._heard.rpartition(_HOME)[2])

    def ended(self) -> tuple[int, str]:
        """The program's exit status and its last words."""
        give_up = time.monotonic() + _PATIENCE_S
        while self.process.poll() is None:
            if time.monotonic() > give_up:
                self.process.send_signal(signal.SIGABRT)  # it says where it is
                self._hear(1.0)
                raise AssertionError(f"it does not end:\n{self.screen}")
            self._hear(0.1)
        self._hear(0.0)
        return self.process.returncode, _CONTROL.sub("", self._heard)[-400:]

    @property
    def attributes(self) -> list[Any]:
        return termios.tcgetattr(self._slave)

    def _hear(self, seconds: float) -> None:
        while select.select([self._master], [], [], seconds)[0]:
            self._heard += os.read(self._master, 65536).decode(errors="replace")
            seconds = 0.0

    def hang_up(self) -> None:
        """The connection is gone; the program has to end by itself."""
        os.close(self._master)
        self._master = -1
        self.process.wait(_PATIENCE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.process.kill()
        self.process.wait()
        if self._master >= 0:
            os.close(self._master)
        os.close(self._slave)
