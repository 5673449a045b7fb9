"""Every fault ends what is under way, quickly, with the arm at rest, and nothing moves it again."""

import time
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest
from ur5e_emulated import cell_at, fault_on_the_way

from pliant.emulator.client import Admin, started
from pliant.errors import RobotFault
from pliant.formations import Formation
from pliant.task import Setup, load_task
from pliant.teaching import shipped
from pliant.ur5e.cell import UrCell
from pliant.ur5e.robot import UrRobot

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST = "127.0.0.81"
SEEN_WITHIN_S = 1.5  # the longest that anything may hang, on a loaded machine
GOALS = shipped().goals
FAULTS = {  # what happens, and what the trial ends with
    "protective_stop": {},
    "emergency_stop": {},
    "power_off": {},
    "stall": {"seconds": 3.0},
    "drop_rtde": {},
    "gripper_lost": {},
}
ENDS = {"stall": "stalled", "drop_rtde": "connection", "gripper_lost": "gripper"}


@pytest.fixture(scope="module")
def emulator() -> Iterator[Admin]:
    with started("--host", HOST, "--mode", "lockstep") as admin:
        yield admin


@pytest.fixture(scope="module")
def cells(emulator: Admin) -> Iterator[UrCell]:
    with UrCell(cell_at(HOST)) as cell:
        yield cell


@pytest.fixture
def cell(emulator: Admin, cells: UrCell) -> UrCell:
    """A person has seen to the last fault."""
    emulator.ask("restore")
    return cells


def prepared(cell: UrCell) -> UrRobot:
    return cell.prepare(load_task("circle"), Setup(seed=0))


def go(robot: UrRobot, formation: Formation) -> None:
    speed = 0.05 if formation is Formation.APPROACH else 0.02
    robot.move_to(GOALS.target(formation), speed_m_s=speed, stop_at_compression_m=0.02)


def pose_of(emulator: Admin) -> np.ndarray:
    return np.array(emulator.ask("state")["tool_pose"])


def assert_at_rest(emulator: Admin) -> None:
    """Within a tenth of a second, and for good."""
    emulator.grant(50)
    at = pose_of(emulator)
    emulator.grant(500)
    assert np.linalg.norm((pose_of(emulator) - at)[:3]) < 2e-4
    assert emulator.ask("state")["program"] == "STOPPED"


@pytest.mark.parametrize("formation", list(Formation))
@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_fault_during_a_motion_halts_the_arm_and_is_named(
    cell: UrCell, emulator: Admin, fault: str, formation: Formation
) -> None:
    robot = prepared(cell)
    for earlier in list(Formation)[: formation.order]:
        go(robot, earlier)
    with fault_on_the_way(HOST, fault, **FAULTS[fault]) as happened:
        with pytest.raises(RobotFault) as caught:
            go(robot, formation)
        seen = time.monotonic()
    assert caught.value.kind == ENDS.get(fault, fault)
    assert seen - happened[0] < SEEN_WITHIN_S
    assert_at_rest(emulator)
    began = time.monotonic()
    for call in (lambda: go(robot, formation), robot.observe, lambda: robot.settle(1.0)):
        with pytest.raises(RobotFault) as again:
            call()
        assert again.value.kind == caught.value.kind
    robot.halt()
    assert time.monotonic() - began < SEEN_WITHIN_S
    assert_at_rest(emulator)


@pytest.mark.parametrize("state", ["frozen", "error", "dead"])
def test_no_new_picture_is_a_fault_with_the_arm_at_rest(
    cell: UrCell, emulator: Admin, state: str
) -> None:
    robot = prepared(cell)
    robot.observe()
    emulator.fault("camera", state=state)
    go(robot, Formation.APPROACH)
    began = time.monotonic()
    with pytest.raises(RobotFault) as caught:
        robot.observe()
    assert caught.value.kind == "camera"
    assert time.monotonic() - began < 2.0 + SEEN_WITHIN_S
    with pytest.raises(RobotFault, match="camera"):
        go(robot, Formation.CONTACT)
    at = pose_of(emulator)
    emulator.grant(100)
    assert np.linalg.norm((pose_of(emulator) - at)[:3]) < 2e-4
