"""The pace of the driver's loop from one look at the arm to the next: with the wall's clock, or
with an emulated controller in lockstep, whose ticks it grants itself. The loop is the same in
both."""

import json
import socket
import time
from collections.abc import Callable
from typing import Any, Protocol

from pliant import tokens
from pliant.errors import InputError
from pliant.ur5e.configuration import Configuration

LOOK_S = 0.002  # the controller's cycle
_LOOPBACK_ANSWER_S = 60.0  # a peg's first model takes the emulator a second or two
_FRESH_S = 1e-6  # [s] of rounding in a time stamp
_SPIN_S = 0.0002


class Stalled(Exception):
    """Raised when the controller does not go on."""


class Pace(Protocol):
    """A pace, whose `look` returns when it is time to look again.

    Raises:
        Stalled: that time does not come.
    """

    is_lockstep: bool

    def look(self) -> None: ...


class RealTime:
    """The pace of the wall's clock: a look every 2 ms; late is late, nothing is made up for."""

    is_lockstep = False

    def look(self) -> None:
        time.sleep(LOOK_S)


class Lockstep:
    """The pace of lockstep: grants an emulated controller its ticks, and waits until the client's
    data are of then."""

    is_lockstep = True

    def __init__(self, admin: "AdminPort", stamp: Callable[[], float], ticks: int) -> None:
        """Pace a driver; `stamp` is the latest time stamp [s] that the client has received."""
        self._admin, self._stamp, self._ticks = admin, stamp, ticks

    def look(self) -> None:
        give_up = time.monotonic() + self._admin.patience_s
        try:
            now = self._admin.ask("grant", ticks=self._ticks)["time_s"]
        except TimeoutError as error:
            raise Stalled from error
        while self._stamp() < now - _FRESH_S:
            if time.monotonic() > give_up:
                raise Stalled
            time.sleep(_SPIN_S)


class AdminPort:
    """The admin port of an emulated cell: one JSON object per line, both ways.

    Raises:
        InputError: nobody answers there.
    """

    def __init__(self, address: str, port: int, patience_s: float = _LOOPBACK_ANSWER_S) -> None:
        self.patience_s = patience_s
        try:
            self._socket = socket.create_connection((address, port), patience_s)
        except OSError as error:
            raise InputError(
                f"no emulated cell answers at {address}:{port} ({error}): start one with"
                " 'python -m pliant.emulator', or leave 'emulator' out of the cell's file"
            ) from error
        self._token = tokens.known(address, port)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("rb")

    def ask(self, do: str, **fields: object) -> dict[str, Any]:
        """Send one request and return its answer.

        Raises:
            InputError: the emulator refuses.
            OSError: it is gone, or (TimeoutError) does not answer in time.
        """
        self._socket.sendall(
            json.dumps({"do": do, "token": self._token, **fields}).encode() + b"\n"
        )
        line = self._lines.readline()
        if not line:
            raise ConnectionResetError("the emulator has ended")
        answer: dict[str, Any] = json.loads(line)
        if not answer.pop("ok"):
            raise InputError(f"the emulator refuses '{do}': {answer['error']}")
        return answer

    def close(self) -> None:
        self._lines.close()
        self._socket.close()


def pace_of(configuration: Configuration, stamp: Callable[[], float]) -> Pace:
    """The cell's pace.

    Raises:
        InputError: the cell is said to be emulated, and nobody answers at its admin port.
        OSError: the emulator does not answer.
    """
    emulator = configuration.emulator
    if emulator is None:
        return RealTime()
    patience_s = configuration.patience.stamp_ms * 1e-3
    admin = AdminPort(configuration.arm.address, emulator.admin_port, patience_s)
    if admin.ask("describe")["mode"] != "lockstep":
        admin.close()
        return RealTime()
    return Lockstep(admin, stamp, emulator.ticks_per_look)
