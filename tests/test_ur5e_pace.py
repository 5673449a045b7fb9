"""Lockstep grants an emulated controller its ticks, and says so when they do not come."""

import json
import socket
import threading
from collections.abc import Iterator

import pytest

from pliant.errors import InputError
from pliant.ur5e.admin_port import AdminPort
from pliant.ur5e.pace import Lockstep, Stalled


class Emulator:
    """Answers grants as long as it is told to; the client's data follow when `sends`."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self.time_s, self.sent_s = 0.0, 0.0
        self.answers = self.sends = True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        connection, _ = self._listening.accept()
        with connection, connection.makefile("rb") as lines:
            for line in lines:
                request = json.loads(line)
                if request["do"] != "grant":
                    connection.sendall(b'{"ok": false, "error": "only grants"}\n')
                elif self.answers:
                    self.time_s += request["ticks"] * 0.002
                    if self.sends:
                        self.sent_s = self.time_s
                    answer = {"ok": True, "time_s": self.time_s}
                    connection.sendall(json.dumps(answer).encode() + b"\n")

    def close(self) -> None:
        self._listening.close()
        self._thread.join()


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    emulator = Emulator()
    yield emulator
    emulator.close()


@pytest.fixture
def admin(emulator: Emulator) -> Iterator[AdminPort]:
    admin = AdminPort("127.0.0.1", emulator.port, 0.3)
    yield admin
    admin.close()


def test_a_look_lets_the_controller_go_on_by_its_ticks(
    emulator: Emulator, admin: AdminPort
) -> None:
    pace = Lockstep(admin, lambda: emulator.sent_s, 5)
    pace.look()
    pace.look()
    assert emulator.time_s == pytest.approx(0.020)


def test_ticks_that_do_not_come_are_a_stall(emulator: Emulator, admin: AdminPort) -> None:
    emulator.answers = False
    with pytest.raises(Stalled):
        Lockstep(admin, lambda: emulator.sent_s, 5).look()


def test_data_that_do_not_come_are_a_stall(emulator: Emulator, admin: AdminPort) -> None:
    emulator.sends = False
    with pytest.raises(Stalled):
        Lockstep(admin, lambda: emulator.sent_s, 5).look()


def test_a_refusal_and_nobody_there_are_the_users_errors(admin: AdminPort) -> None:
    with pytest.raises(InputError, match="refuses 'dance': only grants"):
        admin.ask("dance")
    with pytest.raises(InputError, match="no emulated cell answers at"):
        AdminPort("127.0.0.1", 1)
