"""The client's end of an emulated cell's admin port: one JSON object per line, both ways."""

import json
import socket
from typing import Any

from pliant import tokens
from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.errors import InputError

EMULATOR = "python -m pliant.emulator"
ANSWER_S = 60.0  # a peg's first model takes the emulator a second or two; a long grant its time


class EmulatorEnded(ConnectionResetError):
    """Raised when the emulator has closed the connection."""


class AdminConnection:
    """A connection to the admin port. Its requests are the ones of docs/emulator.md.

    Raises:
        OSError: nobody answers there.
    """

    def __init__(self, address: str, port: int, patience_s: float) -> None:
        self._socket = socket.create_connection((address, port), patience_s)
        self._token = tokens.known(address, port)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("rb")

    def ask(self, do: str, **fields: object) -> dict[str, Any]:
        """Send one request and return its answer.

        Raises:
            InputError: the emulator refuses.
            OSError: it is gone, or (TimeoutError) does not answer in time.
        """
        request = {"do": do, "token": self._token, **fields}
        self._socket.sendall(json.dumps(request).encode() + b"\n")
        line = self._lines.readline()
        if not line:
            raise EmulatorEnded("the emulator has ended")
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

    def close(self) -> None:
        self._lines.close()
        self._socket.close()


class AdminPort(AdminConnection):
    """The admin port of a cell whose file says that it is emulated.

    Raises:
        InputError: nobody answers there.
    """

    def __init__(self, address: str, port: int, patience_s: float = ANSWER_S) -> None:
        self.patience_s = patience_s
        try:
            super().__init__(address, port, patience_s)
        except OSError as error:
            raise InputError(
                f"no emulated cell answers at {address}:{port} ({error}): start one with"
                f" '{EMULATOR}', or leave 'emulator' out of the cell's file"
            ) from error
