"""The UR5e's robot, through the unmodified ur_rtde and the emulator, keeps the same contract as the
simulated one."""

from collections.abc import Iterator
from importlib.util import find_spec

import pytest
from robot_contract import BESIDE, HOME, TASK, RobotContract, distance, move
from ur5e_emulated import cell_at

from pliant.cell import Stop
from pliant.conditions import Setup
from pliant.emulator.client import Admin, started
from pliant.errors import InputError
from pliant.ur5e.cell import UrCell

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST = "127.0.0.82"


@pytest.fixture(scope="module")
def emulator() -> Iterator[Admin]:
    with started("--host", HOST, "--mode", "lockstep") as admin:
        yield admin


@pytest.fixture(scope="module")
def cell(emulator: Admin) -> Iterator[UrCell]:
    with UrCell(cell_at(HOST)) as cell:
        yield cell


class TestUrRobot(RobotContract):
    """As it is."""


def test_a_hand_leads_the_arm_in_freedrive_until_the_next_motion(
    cell: UrCell, emulator: Admin
) -> None:
    robot = cell.prepare(TASK, Setup(seed=0))
    base = cell.configuration.task_frame.transform[:3, 3]
    aside = BESIDE.position() + base
    with pytest.raises(InputError, match="not in freedrive"):
        emulator.ask("guide", pose=[*aside, 0.0, 0.0, 0.0])
    robot.freedrive(True)
    emulator.ask("guide", pose=[*aside, 0.0, 0.0, 0.0])
    robot.settle(2.0)
    assert distance(robot.observe(cameras=()).pose, BESIDE) < 0.001
    assert move(robot, HOME) is Stop.REACHED
    with pytest.raises(InputError, match="not in freedrive"):
        emulator.ask("guide", pose=[*aside, 0.0, 0.0, 0.0])


def test_a_first_run_at_a_tenth_of_the_speed_is_ten_times_as_slow(
    emulator: Admin, cell: UrCell
) -> None:
    cell.close()  # one client moves the arm at a time
    configuration = cell_at(HOST)
    arm = configuration.arm.model_copy(update={"speed_fraction": 0.1})
    with UrCell(configuration.model_copy(update={"arm": arm})) as slow:
        robot = slow.prepare(TASK, Setup(seed=0))
        motion = robot.move_to(BESIDE, speed_m_s=0.05, stop_at_compression_m=0.02)
    assert motion.stop is Stop.REACHED
    assert motion.ended_s - motion.started_s > 0.9 * distance(HOME, BESIDE) / 0.005
