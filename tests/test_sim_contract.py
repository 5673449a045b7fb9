"""The simulated robot keeps the contract that all robots do; as a stream of set points, the part of
it that is about the wrist's limit."""

from typing import cast

import pytest
from robot_contract import TASK, LimitContract, RobotContract, distance, move

from pliant.cell import Robot, Stop
from pliant.conditions import Setup
from pliant.errors import RobotFault
from pliant.pose import Axis, Pose
from pliant.sim.cell import SimCell, SimRobot
from pliant.sim.stream import Streamed

PERIOD_S, PIECE_M = 0.020, 0.0005


@pytest.fixture(scope="module")
def cell() -> SimCell:
    return SimCell()


class TestSimRobot(RobotContract):
    """As it is."""


class TestStreamed(LimitContract):
    """Each way in many pieces, of which any but the last may be ended."""

    @pytest.fixture
    def robot(self, cell: SimCell) -> Robot:
        return Streamed(cell.prepare(TASK, Setup(seed=0)), PERIOD_S)

    def press(self, robot: Robot) -> None:
        streamed = cast(Streamed, robot)
        at = streamed.observe(cameras=()).pose
        self.go(robot, at.updated({Axis.Y: 0.03}))
        self.go(robot, at.updated({Axis.Y: 0.03, Axis.Z: TASK.tip_below_hinge + 0.012}))
        super().press(robot)

    def go(self, robot: Robot, pose: Pose) -> Stop:
        at = robot.observe(cameras=()).pose
        pieces = max(1, round(distance(at, pose) / PIECE_M))
        for k in range(1, pieces + 1):
            between = {a: at[a] + k / pieces * (pose[a] - at[a]) for a in Axis}
            if move(robot, at.updated(between), 0.02) is Stop.COMPRESSION:
                return Stop.COMPRESSION
        return Stop.REACHED


def test_a_peg_that_is_held_fast_stretches_the_wrist_to_its_limit_and_no_further() -> None:
    cell = SimCell()
    robot = cell.prepare(TASK, Setup(seed=0))
    held_at = before = cell.truth().tip[2]

    def hold() -> None:
        """As a hole does that has closed around the peg."""
        nonlocal before
        z = cell.truth().tip[2]
        force = 1000.0 * (held_at - z) - 2000.0 * (z - before)
        robot.data.xfrc_applied[robot.peg_body, 2], before = force, z

    robot.watch(hold)
    at = robot.pose()
    up = at.updated({Axis.Z: at.z + 0.06})
    assert move(robot, up, 0.02) is Stop.COMPRESSION
    for _ in range(5):
        assert move(robot, up, 0.02) is Stop.COMPRESSION
        robot.settle(0.3)
        assert -0.022 < cell.truth().compression_m < -0.018
    assert move(robot, at, 0.02) is Stop.REACHED
    assert isinstance(robot, SimRobot)


def test_a_hand_that_something_holds_back_is_not_where_it_was_sent() -> None:
    robot = SimCell().prepare(TASK, Setup(seed=0))
    began = robot.pose()

    def hold() -> None:
        """As a wall does that the gripper meets."""
        past = robot.pose().y - (began.y + 0.01)
        wrist = robot.model.site_bodyid[robot.model.site("hinge").id]
        robot.data.xfrc_applied[wrist, 1] = -20000.0 * max(0.0, past)

    robot.watch(hold)
    with pytest.raises(RobotFault, match=r"mm and .* deg from its goal") as fault:
        move(robot, began.updated({Axis.Y: began.y + 0.05}), 0.02)
    assert fault.value.kind == "not_reached"
