"""The Robotiq 2F-85 through its URCap's socket: `SET` and `GET` of its variables, one line each.

Our own: the published clients wait without a time-out, or speak another link.
"""

import socket
import time
from collections.abc import Callable

from pliant.errors import RobotFault
from pliant.ur5e import configuration as c
from pliant.ur5e.protocol import Object

_ACTIVE = 3
_POLL_S = 0.05  # while the arm works
_MOVE_S = 5.0  # for the fingers' whole way
_ACTIVATION_S = 10.0


class GripperClient:
    """One connection to the gripper. `poll` never waits; the other calls wait for an answer, with a
    time-out. While the fingers move, `idle` passes the time [s]: whoever owns an arm watches it
    meanwhile.

    Raises:
        RobotFault: "gripper": it does not answer, or what it says is not what it must say.
    """

    def __init__(
        self,
        settings: c.GripperSettings,
        address: str,
        patience_s: float,
        idle: Callable[[float], None] = time.sleep,
    ) -> None:
        self._settings, self._patience_s, self._idle = settings, patience_s, idle
        try:
            self._socket = socket.create_connection((address, settings.port), patience_s)
        except OSError as error:
            raise RobotFault(
                "gripper", f"the gripper does not answer at {address}:{settings.port}: {error}"
            ) from error
        self._heard = b""
        self._holds = False
        self._asked_s = time.monotonic()
        self._is_asked = False

    # --- with the arm at rest --------------------------------------------------------------------

    def watch(self, holds: bool) -> None:
        """Say whether from now on the peg must be in the fingers, and stay there."""
        self._holds = False
        if not holds:
            return
        self._check_active()
        if (felt := self.get("OBJ")) != Object.CLOSING:
            raise RobotFault("gripper", f"the gripper does not hold a peg (OBJ {felt})")
        self._holds = True

    def close_on_peg(self) -> None:
        """Close until the peg stops the fingers."""
        self._move(self._settings.closed_at)

    def release(self) -> None:
        self._holds = False
        self._move(self._settings.open_at)

    def activate(self) -> None:
        """Activate the gripper, once after power-up. It moves the fingers fully: never with a peg
        in them."""
        if self.get("STA") == _ACTIVE:
            return
        self._set("ACT 0")
        self._set("ACT 1")
        self._until(lambda: self.get("STA") == _ACTIVE, _ACTIVATION_S, "is not activated")

    def get(self, name: str) -> int | None:
        """The value of a variable; None: the gripper is not powered, as under an emergency stop."""
        self._finish_poll()
        self._send(f"GET {name}\n")
        return self._value(self._line(), name)

    # --- while the arm works ---------------------------------------------------------------------

    def poll(self) -> None:
        """Ask now and then whether the peg is still there, and hear the answer; does not wait."""
        now = time.monotonic()
        if not self._is_asked and now - self._asked_s >= _POLL_S:
            self._send("GET OBJ\n")
            self._is_asked, self._asked_s = True, now
        if self._is_asked and (line := self._line_if_any()) is not None:
            self._is_asked = False
            felt = self._value(line, "OBJ")
            if self._holds and felt is not None and felt != Object.CLOSING:
                raise RobotFault("gripper", f"the gripper lost the peg (OBJ {felt})")
        if self._is_asked and now - self._asked_s > self._patience_s:
            raise RobotFault(
                "gripper", f"the gripper has not answered for {now - self._asked_s:.1f} s"
            )

    def disconnect(self) -> None:
        self._socket.close()

    # --- the wire --------------------------------------------------------------------------------

    def _check_active(self) -> None:
        if self.get("STA") != _ACTIVE:
            raise RobotFault("gripper", "the gripper is not activated: activate it without a peg")

    def _move(self, position: int) -> None:
        self._check_active()
        settings = self._settings
        self._set(f"POS {position} SPE {settings.speed} FOR {settings.force} GTO 1")
        self._idle(_POLL_S)  # OBJ speaks of the last motion until this one has begun
        self._until(lambda: self.get("OBJ") != Object.MOVING, _MOVE_S, "does not come to rest")

    def _until(self, condition: Callable[[], bool], seconds: float, complaint: str) -> None:
        give_up = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > give_up:
                raise RobotFault("gripper", f"the gripper {complaint}")
            self._idle(_POLL_S)

    def _set(self, pairs: str) -> None:
        self._finish_poll()
        self._send(f"SET {pairs}\n")
        answer = self._receive()  # without a newline
        if answer != b"ack":
            raise RobotFault("gripper", f"the gripper refuses 'SET {pairs}': {answer!r}")

    def _finish_poll(self) -> None:
        if self._is_asked:
            self._line()
            self._is_asked = False

    def _send(self, text: str) -> None:
        try:
            self._socket.settimeout(self._patience_s)
            self._socket.sendall(text.encode())
        except OSError as error:
            raise RobotFault("gripper", f"the gripper's connection is lost: {error}") from error

    def _receive(self) -> bytes:
        try:
            self._socket.settimeout(self._patience_s)  # a poll leaves it without one
            part = self._socket.recv(256)
        except TimeoutError as error:
            raise RobotFault("gripper", "the gripper does not answer") from error
        except OSError as error:
            raise RobotFault("gripper", f"the gripper's connection is lost: {error}") from error
        if not part:
            raise RobotFault("gripper", "the gripper has closed the connection")
        return part

    def _line(self) -> str:
        while b"\n" not in self._heard:
            self._heard += self._receive()
        return self._take()

    def _line_if_any(self) -> str | None:
        self._socket.setblocking(False)
        try:
            while part := self._socket.recv(256):
                self._heard += part
            raise RobotFault("gripper", "the gripper has closed the connection")
        except BlockingIOError:
            return self._take() if b"\n" in self._heard else None
        except OSError as error:
            raise RobotFault("gripper", f"the gripper's connection is lost: {error}") from error

    def _take(self) -> str:
        line, _, self._heard = self._heard.partition(b"\n")
        return line.decode("ascii", "replace").strip()

    @staticmethod
    def _value(line: str, name: str) -> int | None:
        said, _, value = line.partition(" ")
        if said != name or not (value.isdigit() or value == "?"):
            raise RobotFault("gripper", f"the gripper answered '{line}' to 'GET {name}'")
        return None if value == "?" else int(value)
