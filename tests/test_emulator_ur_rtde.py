"""The unmodified ur_rtde client against the emulator, in processes of their own.

The client's ports are fixed, so one emulator serves all tests, at a loopback address of its own.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from pydantic import TypeAdapter

from pliant.cell import Camera
from pliant.conditions import Setup, condition
from pliant.emulator.client import Admin, started
from pliant.errors import InputError
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.ur5e.protocol import TIME_HEADER

CAMERAS = TypeAdapter(list[Camera])
pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST, OTHER_HOST = "127.0.0.77", "127.0.0.78"
WITHIN_S = 20.0  # on a loaded machine


@pytest.fixture(scope="module")
def emulator() -> Iterator[Admin]:
    with started("--host", HOST) as admin:
        yield admin


@pytest.fixture(scope="module")
def connections(emulator: Admin) -> Iterator[SimpleNamespace]:
    """All of ur_rtde's interfaces."""
    from dashboard_client import DashboardClient
    from rtde_control import RTDEControlInterface
    from rtde_io import RTDEIOInterface
    from rtde_receive import RTDEReceiveInterface

    dashboard = DashboardClient(HOST)
    dashboard.connect()
    arm = SimpleNamespace(
        receive=RTDEReceiveInterface(HOST),
        control=RTDEControlInterface(HOST),
        io=RTDEIOInterface(HOST),
        dashboard=dashboard,
    )
    yield arm
    for interface in (arm.control, arm.receive, arm.io, arm.dashboard):
        interface.disconnect()


@pytest.fixture
def arm(emulator: Admin, connections: SimpleNamespace) -> SimpleNamespace:
    """A fresh trial in real time, the tool's centre point at the wrist's hinge, tared."""
    emulator.ask("pace", mode="real")
    emulator.ask("restore")
    emulator.set_up(Setup(seed=0), "circle")
    control, cell = connections.control, emulator.ask("describe")
    control.reuploadScript()
    until(control.isProgramRunning)
    assert control.setTcp(cell["hinge_on_flange"])
    assert control.setPayload(cell["payload"]["mass_kg"], cell["payload"]["centre_on_flange_m"])
    assert control.zeroFtSensor()
    return connections


def until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + WITHIN_S
    while not condition():
        assert time.monotonic() < give_up, "it never happened"
        time.sleep(0.002)


def aim(arm: SimpleNamespace, dx: float = 0.0, dy: float = 0.0, dz: float = 0.0) -> list[float]:
    """The commanded pose, shifted [m]."""
    x, y, z, *turn = arm.receive.getTargetTCPPose()
    return [x + dx, y + dy, z + dz, *turn]


def begin(arm: SimpleNamespace, pose: list[float], speed: float) -> None:
    """Start a straight move, and see that it has started."""
    before = arm.control.getAsyncOperationProgressEx().operationId()
    assert arm.control.moveL(pose, speed, 0.5, True)
    until(lambda: arm.control.getAsyncOperationProgressEx().operationId() != before)


def finished(arm: SimpleNamespace) -> bool:
    return not arm.control.getAsyncOperationProgressEx().isAsyncOperationRunning()


def test_a_straight_move_reaches_its_pose(arm: SimpleNamespace) -> None:
    pose = aim(arm, dx=0.02, dy=0.03, dz=-0.02)
    assert arm.control.moveL(pose, 0.1, 0.5)
    assert np.linalg.norm(np.subtract(arm.receive.getActualTCPPose(), pose)[:3]) < 1e-3
    assert arm.receive.getRobotMode() == 7
    assert arm.receive.getSafetyMode() == 1


def test_an_asynchronous_move_is_stopped_on_its_way(arm: SimpleNamespace) -> None:
    start = arm.receive.getTargetTCPPose()[1]
    begin(arm, aim(arm, dy=0.1), 0.05)
    until(lambda: arm.receive.getTargetTCPPose()[1] > start + 0.02)
    at = arm.receive.getTargetTCPPose()[1]
    arm.control.stopL(2.0, True)
    until(lambda: finished(arm))
    assert at <= arm.receive.getTargetTCPPose()[1] < start + 0.099


def test_pressing_the_board_raises_the_force_by_the_springs_law(
    arm: SimpleNamespace, emulator: Admin
) -> None:
    assert arm.control.moveL(aim(arm, dy=0.03), 0.1, 0.5)  # beside the hole
    assert abs(arm.receive.getActualTCPForce()[2]) < 1.0
    assert arm.control.moveL(aim(arm, dz=-0.068), 0.02, 0.2)
    until(lambda: arm.control.isSteady())
    force = arm.receive.getActualTCPForce()[2]
    assert force > 3.0
    assert force == pytest.approx(1000.0 * emulator.truth().compression_m, abs=0.5)


def test_a_move_until_contact_ends_at_the_board(arm: SimpleNamespace) -> None:
    assert arm.control.moveL(aim(arm, dy=0.03), 0.1, 0.5)
    assert arm.control.moveUntilContact([0, 0, -0.03, 0, 0, 0])
    assert 10.0 < arm.receive.getActualTCPForce()[2] < 30.0


def test_a_protective_stop_is_seen_and_outlived(arm: SimpleNamespace, emulator: Admin) -> None:
    begin(arm, aim(arm, dy=0.1), 0.02)
    emulator.fault("protective_stop")
    until(arm.receive.isProtectiveStopped)
    assert not arm.control.moveL(aim(arm), 0.1, 0.5)
    with pytest.raises(Exception, match="Cannot unlock protective stop until 5s"):
        arm.dashboard.unlockProtectiveStop()
    emulator.ask("restore")
    assert arm.control.reuploadScript()
    until(arm.control.isProgramRunning)
    assert arm.control.moveL(aim(arm, dy=0.01), 0.1, 0.5)


def test_an_emergency_stop_silences_the_gripper_too(arm: SimpleNamespace, emulator: Admin) -> None:
    emulator.fault("emergency_stop")
    until(arm.receive.isEmergencyStopped)
    assert arm.dashboard.robotmode() == "Robotmode: POWER_OFF"
    assert asked_gripper("GET POS\n") == "POS ?\n"
    emulator.ask("restore")
    assert asked_gripper("GET STA\n") == "STA 3\n"


def asked_gripper(line: str) -> str:
    with socket.create_connection((HOST, 63352), WITHIN_S) as gripper:
        gripper.sendall(line.encode())
        return gripper.recv(100).decode()


def test_a_stalled_controller_stays_connected_and_shows_only_in_its_time_stamp(
    arm: SimpleNamespace, emulator: Admin
) -> None:
    emulator.fault("stall", seconds=2.0)  # after 2.5 s ur_rtde hangs up
    time.sleep(0.3)
    at = arm.receive.getTimestamp()
    time.sleep(0.3)
    assert arm.receive.getTimestamp() == at
    assert arm.receive.isConnected()
    until(lambda: arm.receive.getTimestamp() > at)


def test_the_watchdog_ends_a_silent_clients_program(arm: SimpleNamespace) -> None:
    assert arm.control.setWatchdog(10.0)
    until(lambda: not arm.control.isProgramRunning())
    assert not arm.control.moveL(aim(arm, dy=0.01), 0.1, 0.5)


def test_questions_are_answered_in_the_clients_terms(arm: SimpleNamespace) -> None:
    control, pose = arm.control, aim(arm, dz=-0.01)
    assert control.isPoseWithinSafetyLimits(pose)
    assert not control.isPoseWithinSafetyLimits([2.0, *pose[1:]])
    q = control.getInverseKinematics(pose)
    np.testing.assert_allclose(
        control.getForwardKinematics(q, control.getTCPOffset())[:3], pose[:3], atol=1e-5
    )
    with pytest.raises(ValueError, match="not within"):
        control.moveL(pose, 100.0, 0.5)


def test_the_speed_slider_and_outputs_are_set(arm: SimpleNamespace) -> None:
    assert arm.io.setSpeedSlider(0.25)
    until(lambda: arm.receive.getTargetSpeedFraction() == 0.25)
    assert arm.io.setSpeedSlider(1.0)
    assert arm.io.setStandardDigitalOut(3, True)
    until(lambda: bool(arm.receive.getActualDigitalOutputBits() & 1 << 3))


def test_a_path_is_travelled(arm: SimpleNamespace) -> None:
    first, second = aim(arm, dy=0.02), aim(arm, dy=0.02, dz=-0.01)
    assert arm.control.moveL([[*first, 0.1, 0.5, 0.0], [*second, 0.1, 0.5, 0.0]])
    assert np.linalg.norm(np.subtract(arm.receive.getActualTCPPose(), second)[:3]) < 1e-3


@pytest.mark.parametrize(
    ("begins", "ends"), [("freedriveMode", "endFreedriveMode"), ("teachMode", "endTeachMode")]
)
def test_a_hand_leads_the_arm_in_freedrive(
    arm: SimpleNamespace, emulator: Admin, begins: str, ends: str
) -> None:
    pose = aim(arm, dy=0.02)
    with pytest.raises(InputError, match="not in freedrive"):
        emulator.ask("guide", pose=pose)
    assert getattr(arm.control, begins)()
    assert arm.control.getFreedriveStatus() == 1
    emulator.ask("guide", pose=pose)
    until(lambda: not emulator.ask("state")["moving"])
    assert getattr(arm.control, ends)()
    with pytest.raises(InputError, match="not in freedrive"):
        emulator.ask("guide", pose=pose)
    assert np.linalg.norm(np.subtract(arm.receive.getActualTCPPose(), pose)[:3]) < 1e-3


def test_a_second_control_client_is_refused(arm: SimpleNamespace) -> None:
    from rtde_control import RTDEControlInterface

    with pytest.raises(RuntimeError, match="already in use"):
        RTDEControlInterface(HOST)


def test_lockstep_moves_by_the_ticks_that_are_granted(
    arm: SimpleNamespace, emulator: Admin
) -> None:
    emulator.ask("pace", mode="lockstep")
    start, began = arm.receive.getTargetTCPPose()[1], emulator.grant(1)
    until(lambda: arm.receive.getTimestamp() >= began - 1e-9)
    begin(arm, aim(arm, dy=0.02), 0.05)  # answered without a tick
    time.sleep(0.2)
    assert arm.receive.getTimestamp() == pytest.approx(began)
    assert arm.receive.getTargetTCPPose()[1] == start
    ticks = 0
    while not finished(arm):
        now = emulator.grant(5)
        until(lambda now=now: arm.receive.getTimestamp() >= now - 1e-9)  # type: ignore[misc]
        ticks += 5
    assert ticks * 0.002 == pytest.approx(0.02 / 0.05 + 0.05 / 0.5, abs=0.03)
    assert arm.receive.getTargetTCPPose()[1] == pytest.approx(start + 0.02, abs=1e-6)


def test_a_trial_begins_as_the_simulated_cell_prepares_it(
    arm: SimpleNamespace, emulator: Admin
) -> None:
    emulator.ask("pace", mode="lockstep")
    emulator.ask("setup", peg="square", condition="all", seed=5)
    cell, setup = SimCell(), condition("all").draw(5)
    robot = cell.prepare(load_task("square"), setup)
    theirs, ours = emulator.truth(), cell.truth()
    np.testing.assert_allclose(theirs.tip, ours.tip, atol=1e-9)
    assert theirs.hole_y == ours.hole_y
    picture, time_s = frame("side.png")
    assert time_s == pytest.approx(emulator.ask("state")["time_s"])
    expected = robot.observe().views["side"]
    assert np.mean(np.abs(picture.astype(int) - expected.image)) < 0.5
    (side, *_) = CAMERAS.validate_json(
        urllib.request.urlopen(f"http://{HOST}:30101/cameras.json").read()
    )
    np.testing.assert_allclose(side.position, expected.camera.position, atol=1e-6)
    assert side.focal_px == pytest.approx(expected.camera.focal_px)


def frame(name: str) -> tuple[np.ndarray, float]:
    """A picture (height, width, 3), RGB, and the controller's time [s] that it shows."""
    with urllib.request.urlopen(f"http://{HOST}:30101/{name}", timeout=WITHIN_S) as answer:
        data = np.frombuffer(answer.read(), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert image is not None
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB), float(answer.headers[TIME_HEADER])


def test_camera_faults_show_as_they_do_on_a_network(arm: SimpleNamespace, emulator: Admin) -> None:
    _, before = frame("side.jpg")
    emulator.fault("camera", state="frozen")
    assert frame("side.jpg")[1] == before
    emulator.fault("camera", state="error")
    with pytest.raises(urllib.error.HTTPError, match="503"):
        frame("side.jpg")
    emulator.fault("camera", state="dead")
    with pytest.raises(OSError, match="closed connection"):
        frame("side.jpg")
    emulator.ask("restore")
    assert frame("side.jpg")[1] > before


def test_a_stream_of_frames_can_be_followed(arm: SimpleNamespace) -> None:
    stream = cv2.VideoCapture(f"http://{HOST}:30101/side.mjpg")
    assert stream.read()[1].shape == (480, 640, 3)
    assert stream.read()[0]
    stream.release()


def test_a_connection_cut_at_its_time_is_noticed_and_can_be_made_anew(tmp_path: Path) -> None:
    """At an emulator of its own: ur_rtde's control interface crashes some time after a cut."""
    from rtde_receive import RTDEReceiveInterface

    plan = tmp_path / "faults.yaml"
    plan.write_text("- {at_s: 0.5, kind: drop_rtde}\n", encoding="utf-8")
    with started("--host", OTHER_HOST, "--mode", "lockstep", "--faults", str(plan)) as emulator:
        receive = RTDEReceiveInterface(OTHER_HOST, 500.0, ["timestamp"])
        emulator.grant(249)
        time.sleep(0.1)
        assert receive.isConnected()
        emulator.grant(1)
        until(lambda: not receive.isConnected())
        receive.disconnect()
        again = RTDEReceiveInterface(OTHER_HOST, 500.0, ["timestamp"])
        at = emulator.grant(5)
        until(lambda: again.getTimestamp() == at)
        again.disconnect()


def test_the_trajectory_can_be_drawn_again(emulator: Admin, tmp_path: Path) -> None:
    from pliant.sim.replay import load

    emulator.ask("trajectory", folder=str(tmp_path))
    assert len(load(tmp_path).time_s) >= 1


def test_a_request_that_cannot_be_used_says_why(emulator: Admin) -> None:
    for request, complaint in (
        ({"do": "dance"}, "dance"),
        ({"do": "grant", "ticks": 0}, "greater than 0"),
        ({"do": "setup", "condition": "windy"}, "windy"),
        ({"do": "setup", "hole_y": 1.0}, "hole_y"),
        ({"do": "fault", "fault": {"kind": "flood"}}, "flood"),
    ):
        with pytest.raises(InputError, match=complaint):
            emulator.ask(**request)


def test_a_taken_port_is_one_line(emulator: Admin) -> None:
    with (
        pytest.raises(InputError, match=r"port 30004 on 127\.0\.0\.77 cannot be opened"),
        started("--host", HOST),
    ):
        raise AssertionError("it started")


def test_an_emulator_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    """Its parent is killed, and so cannot say goodbye."""
    code = (
        "import json, time\n"
        "from pliant.emulator.client import started\n"
        f"with started('--host', '{OTHER_HOST}') as admin:\n"
        "    print(json.dumps(admin.ask('state')), flush=True)\n"
        "    time.sleep(600)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, encoding="utf-8"
    )
    assert parent.stdout is not None
    assert json.loads(parent.stdout.readline())["program"] == "STOPPED"
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()

    def is_gone() -> bool:
        try:
            Admin(OTHER_HOST).close()
        except InputError:
            return True
        return False

    until(is_gone)


def test_the_documented_example_touches_the_board() -> None:
    text = (Path(__file__).parent.parent / "docs" / "emulator.md").read_text(encoding="utf-8")
    code = text.split("```python\n", 1)[1].split("```", 1)[0].replace("127.0.0.1", OTHER_HOST)
    with started("--host", OTHER_HOST):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("touched the board with")
