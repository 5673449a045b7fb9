"""The UR5e's robot, through the unmodified ur_rtde and the emulator, keeps the same contract as the
simulated one."""

from collections.abc import Iterator
from importlib.util import find_spec

import pytest
from robot_contract import RobotContract
from ur5e_emulated import cell_at

from pliant.emulator.client import started
from pliant.ur5e.cell import UrCell

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST = "127.0.0.82"


@pytest.fixture(scope="module")
def cell() -> Iterator[UrCell]:
    with started("--host", HOST, "--mode", "lockstep"), UrCell(cell_at(HOST)) as cell:
        yield cell


class TestUrRobot(RobotContract):
    """As it is."""
