"""The experiment's side of an emulator in another process: start it, and talk to its admin port."""

import json
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import Any, Self

from pliant import tokens
from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.errors import InputError

_TIMEOUT_S = 60.0  # a peg's first model takes a second; a long grant its time
_STOP_S = 10.0
_COMMAND = "python -m pliant.emulator"
_ERROR = "pliant.emulator: "
_READY = r"ready: .* admin (\S+):(\d+);"


class Admin:
    """A connection to the admin port. Its requests are the ones of docs/emulator.md.

    Raises:
        InputError: nobody answers there.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 30100) -> None:
        try:
            self._socket = socket.create_connection((host, port), _TIMEOUT_S)
        except OSError as error:
            raise InputError(
                f"no emulator answers at {host}:{port} ({error.strerror}): start one with"
                f" '{_COMMAND}'"
            ) from error
        self._token = tokens.known(host, port)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("rb")

    def ask(self, do: str, **fields: object) -> dict[str, Any]:
        """Send one request and return its answer.

        Raises:
            InputError: the emulator refuses, or is gone.
        """
        try:
            self._socket.sendall(
                json.dumps({"do": do, "token": self._token, **fields}).encode() + b"\n"
            )
            line = self._lines.readline()
        except OSError as error:
            raise InputError(f"the emulator does not answer: {error}") from error
        if not line:
            raise InputError("the emulator has ended")
        answer: dict[str, Any] = json.loads(line)
        if not answer.pop("ok"):
            raise InputError(f"the emulator refuses '{do}': {answer['error']}")
        return answer

    def set_up(self, setup: Setup, peg: str | None = None) -> None:
        """Begin a trial: hole, friction and grasp as in `setup`, the arm at home."""
        self.ask("setup", peg=peg, seed=setup.seed, **setup.disturbed())

    def truth(self) -> Truth:
        """Ground truth now."""
        fields = self.ask("truth")["truth"]
        return Truth(**{**fields, "tip": tuple(fields["tip"])})

    def grant(self, ticks: int) -> float:
        """Let a controller in lockstep go on by `ticks`, and return its time stamp [s] when it
        has."""
        return float(self.ask("grant", ticks=ticks)["time_s"])

    def fault(self, kind: str, **fields: object) -> None:
        """Let a fault happen now."""
        self.ask("fault", fault={"kind": kind, **fields})

    def close(self) -> None:
        self._lines.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def started(*arguments: str) -> Iterator[Admin]:
    """Start an emulator in a process of its own, which ends with this context or with this process.

    `arguments` are those of `python -m pliant.emulator`. The ports are fixed, the address is not:
    with `--host 127.0.0.2` a second one runs beside the first (on Linux).

    Raises:
        InputError: it did not start; the message is its own.
    """
    command = [sys.executable, "-m", "pliant.emulator", "--with-parent"]
    with TemporaryFile("w+", encoding="utf-8", errors="replace") as log:
        process = subprocess.Popen(
            [*command, *arguments],
            stdout=subprocess.PIPE,
            stderr=log,
            encoding="utf-8",
            errors="replace",  # it says its words as its terminal would have them
            start_new_session=True,  # Ctrl-C is for the client, which then ends it
        )
        assert process.stdout is not None
        try:
            ready = re.match(_READY, process.stdout.readline())
            if ready is None:
                process.wait(_STOP_S)
                log.seek(0)
                said = [line for line in log.read().splitlines() if line.startswith(_ERROR)]
                problem = said[-1].removeprefix(_ERROR) if said else f"see '{_COMMAND} --help'"
                raise InputError(f"the emulator did not start: {problem}")
            with Admin(ready[1], int(ready[2])) as admin:
                yield admin
        finally:
            process.terminate()
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()
