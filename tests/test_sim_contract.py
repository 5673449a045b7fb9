"""The simulated robot keeps the contract that all robots do."""

import pytest
from robot_contract import RobotContract

from pliant.sim.cell import SimCell


@pytest.fixture(scope="module")
def cell() -> SimCell:
    return SimCell()


class TestSimRobot(RobotContract):
    """As it is."""
