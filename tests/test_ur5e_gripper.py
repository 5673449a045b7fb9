"""The gripper's socket: against the emulated gripper, and against one that misbehaves."""

import socketserver
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from pliant.emulator.gripper import EmulatedGripper as Emulated
from pliant.errors import RobotFault
from pliant.ur5e import configuration as c
from pliant.ur5e.gripper import GripperClient

PATIENCE_S = 0.3


class Server(socketserver.ThreadingTCPServer):
    """Answers lines by what `answer` says; None: not at all. Time passes for the gripper with every
    line."""

    daemon_threads = True
    allow_reuse_address = True
    emulated: Emulated
    answer: Callable[[str], str | None]

    def hear(self, line: str) -> str | None:
        self.emulated.step(0.1)
        return self.emulated.answer(line)


class Handler(socketserver.StreamRequestHandler):
    server: Server

    def handle(self) -> None:
        for line in self.rfile:
            answer = self.server.answer(line.decode().strip())
            if answer is not None:
                self.wfile.write(answer.encode())


@pytest.fixture
def server() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as server:
        server.emulated, server.answer = Emulated(), server.hear
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def gripper(server: Server) -> Iterator[GripperClient]:
    gripper = GripperClient(
        c.GripperSettings(port=server.server_address[1]), "127.0.0.1", PATIENCE_S
    )
    yield gripper
    gripper.disconnect()


def polled(gripper: GripperClient, seconds: float = 5.0) -> None:
    """Poll as the driver does, until something happens."""
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        gripper.poll()
        time.sleep(0.002)


def test_a_peg_that_is_held_is_watched_without_waiting(gripper: GripperClient) -> None:
    gripper.watch(True)
    polled(gripper, 0.3)


def test_a_lost_peg_is_a_fault(gripper: GripperClient, server: Server) -> None:
    gripper.watch(True)
    server.emulated.lose()
    with pytest.raises(RobotFault, match="lost the peg") as caught:
        polled(gripper)
    assert caught.value.kind == "gripper"
    gripper.watch(False)  # a person takes it out
    polled(gripper, 0.2)


def test_no_peg_and_no_activation_are_found_before_a_trial(
    gripper: GripperClient, server: Server
) -> None:
    server.emulated.lose()
    with pytest.raises(RobotFault, match="does not hold a peg"):
        gripper.watch(True)
    server.emulated.answer("SET ACT 0")
    with pytest.raises(RobotFault, match="not activated"):
        gripper.watch(True)


def test_fingers_open_close_and_are_activated_once(gripper: GripperClient, server: Server) -> None:
    gripper.release()
    assert gripper.get("POS") == 0
    gripper.close_on_peg()
    assert gripper.get("POS") == 255  # the peg has fallen
    gripper.activate()  # it is: with a peg in the fingers this must not move them
    server.emulated.answer("SET ACT 0")
    gripper.activate()
    assert gripper.get("STA") == 3


def test_an_unpowered_gripper_is_not_a_lost_peg(gripper: GripperClient, server: Server) -> None:
    gripper.watch(True)
    server.emulated.readable = False  # under an emergency stop, which the arm reports
    polled(gripper, 0.3)
    assert gripper.get("POS") is None


@pytest.mark.parametrize(
    ("answer", "words"), [(None, "has not answered"), ("nonsense\n", "answered 'nonsense'")]
)
def test_a_gripper_that_is_silent_or_talks_nonsense_is_a_fault_in_time(
    gripper: GripperClient, server: Server, answer: str | None, words: str
) -> None:
    gripper.watch(True)
    server.answer = lambda line: answer
    with pytest.raises(RobotFault, match=words) as caught:
        polled(gripper)
    assert caught.value.kind == "gripper"


def test_a_refused_command_is_a_fault(gripper: GripperClient, server: Server) -> None:
    server.answer = lambda line: "STA 3\n" if line == "GET STA" else "nack"
    with pytest.raises(RobotFault, match="refuses 'SET POS 0"):
        gripper.release()


def test_nobody_there_is_a_fault() -> None:
    with pytest.raises(RobotFault, match="does not answer") as caught:
        GripperClient(c.GripperSettings(port=1), "127.0.0.1", PATIENCE_S)
    assert caught.value.kind == "gripper"
