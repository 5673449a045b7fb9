"""What every cell's robot must do: the same tests for the simulated one and the UR5e's."""

import numpy as np
import pytest

from pliant.cell import Robot, Stop, Workcell
from pliant.conditions import Setup
from pliant.errors import RobotFault
from pliant.formations import Formation
from pliant.pose import Axis, Pose
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.measure import measure
from pliant.wrist import LIMIT_M as WRIST_LIMIT_M
from pliant.wrist import OVER_M

TASK = load_task("circle")
HOME = Pose(z=TASK.tip_below_hinge + 0.06)
BESIDE = HOME.updated({Axis.Y: 0.03})  # of the hole
PRESSED = BESIDE.updated({Axis.Z: TASK.tip_below_hinge - 0.015})
CRUSHED = BESIDE.updated({Axis.Z: TASK.tip_below_hinge - 0.050})  # by far too deep
LIMIT_M = 0.008


def distance(a: Pose, b: Pose) -> float:
    return float(np.linalg.norm(a.position() - b.position()))


def move(robot: Robot, pose: Pose, speed_m_s: float = 0.05, limit_m: float = 0.02) -> Stop:
    return robot.move_to(pose, speed_m_s=speed_m_s, stop_at_compression_m=limit_m).stop


class LimitContract:
    """The limit of the wrist. Subclasses give the fixtures `cell` and `robot`."""

    def go(self, robot: Robot, pose: Pose) -> Stop:
        return move(robot, pose, 0.02)

    def press(self, robot: Robot) -> None:
        """Until the wrist's limit ends it."""
        move(robot, BESIDE.updated({Axis.Z: TASK.tip_below_hinge + 0.012}))
        assert self.go(robot, CRUSHED) is Stop.COMPRESSION

    def test_a_wrist_past_its_limit_is_pressed_no_further_however_often_it_is_asked(
        self, robot: Robot, cell: Workcell
    ) -> None:
        self.press(robot)
        aside = CRUSHED.updated({Axis.Y: 0.035})
        turned = CRUSHED.updated({Axis.ROLL: 0.05})
        for pose in (CRUSHED, aside, turned, CRUSHED) * 3:
            assert self.go(robot, pose) is Stop.COMPRESSION
            assert cell.truth().compression_m < WRIST_LIMIT_M + 0.001

    def test_a_wrist_past_its_limit_may_press_again_once_it_was_relieved(
        self, robot: Robot, cell: Workcell
    ) -> None:
        self.press(robot)
        at = robot.observe(cameras=()).pose
        assert self.go(robot, at.updated({Axis.Z: at.z + 0.006})) is Stop.REACHED
        assert cell.truth().compression_m < WRIST_LIMIT_M - 0.004
        assert self.go(robot, at.updated({Axis.Z: at.z + 0.002})) is Stop.REACHED
        assert self.go(robot, CRUSHED) is Stop.COMPRESSION
        assert cell.truth().compression_m < WRIST_LIMIT_M + OVER_M


class RobotContract(LimitContract):
    """All of it. Subclasses give the fixture `cell`."""

    @pytest.fixture
    def robot(self, cell: Workcell) -> Robot:
        return cell.prepare(TASK, Setup(seed=0))

    def test_a_trial_begins_at_home_at_rest_with_nothing_pressed(self, robot: Robot) -> None:
        at = robot.observe(cameras=())
        assert distance(at.pose, HOME) < 0.001
        assert abs(at.compression_m) < 0.0002
        assert at.views == {}
        assert robot.clock() < 0.05

    def test_a_motion_goes_straight_to_its_pose_no_faster_than_asked(self, robot: Robot) -> None:
        goal = BESIDE.updated({Axis.Z: BESIDE.z - 0.02, Axis.ROLL: 0.1})
        began = robot.clock()
        motion = robot.move_to(goal, speed_m_s=0.05, stop_at_compression_m=0.02)
        assert motion.stop is Stop.REACHED
        assert distance(motion.ended, goal) < 0.001
        assert motion.ended.roll == pytest.approx(0.1, abs=0.005)
        assert motion.started_s == pytest.approx(began, abs=0.02)
        assert motion.ended_s - motion.started_s >= distance(HOME, goal) / 0.05
        assert motion.ended_s == pytest.approx(robot.clock(), abs=0.02)
        positions = motion.trace.pose[:, :3]
        along = (goal.position() - HOME.position()) / distance(HOME, goal)
        offsets = positions - positions[0]
        off_line = offsets - np.outer(offsets @ along, along)
        assert np.abs(off_line).max() < 0.001
        assert np.all(np.diff(motion.trace.time_s) > 0)
        assert np.all(np.diff(motion.trace.time_s) < 0.06)

    def test_pressing_past_the_limit_ends_a_motion_where_it_is(
        self, robot: Robot, cell: Workcell
    ) -> None:
        move(robot, BESIDE)
        robot.settle(1.0)
        motion = robot.move_to(PRESSED, speed_m_s=0.02, stop_at_compression_m=LIMIT_M)
        assert motion.stop is Stop.COMPRESSION
        assert motion.peak_compression_m == pytest.approx(LIMIT_M, abs=0.001)
        assert motion.ended.z > PRESSED.z + 0.003
        robot.settle(0.6)
        pressed_m = robot.observe(cameras=()).compression_m
        assert pressed_m == pytest.approx(cell.truth().compression_m, abs=0.0003)
        assert pressed_m < LIMIT_M + 0.001
        assert distance(robot.observe(cameras=()).pose, motion.ended) < 0.0005

    def test_a_straight_press_tells_how_the_wrists_sensor_answers(self, robot: Robot) -> None:
        move(robot, BESIDE)
        robot.settle(1.0)
        free = robot.move_to(
            BESIDE.updated({Axis.Z: BESIDE.z - 0.02}), speed_m_s=0.02, stop_at_compression_m=0.02
        )
        assert free.answer is None
        press = robot.move_to(PRESSED, speed_m_s=0.02, stop_at_compression_m=LIMIT_M)
        assert press.answer is not None
        assert press.answer.is_within(2.0)
        assert press.answer.slope == pytest.approx(1.0, abs=0.1)
        up = robot.move_to(BESIDE, speed_m_s=0.02, stop_at_compression_m=0.02)
        assert up.answer is None

    def test_a_wrist_at_its_limit_is_relieved_but_not_pressed_on(
        self, robot: Robot, cell: Workcell
    ) -> None:
        move(robot, BESIDE)
        move(robot, PRESSED, 0.02, LIMIT_M)
        assert move(robot, PRESSED, 0.02, LIMIT_M / 2) is Stop.COMPRESSION
        assert cell.truth().compression_m < LIMIT_M + 0.001
        assert move(robot, BESIDE, 0.02, LIMIT_M / 2) is Stop.REACHED
        robot.settle(1.0)
        assert abs(robot.observe(cameras=()).compression_m) < 0.0003

    def test_compression_counts_from_free_hang_at_any_lean(
        self, robot: Robot, cell: Workcell
    ) -> None:
        move(robot, HOME.updated({Axis.ROLL: 0.17}))
        robot.settle(1.5)
        leaning_m = robot.observe(cameras=()).compression_m
        assert leaning_m == pytest.approx(cell.truth().compression_m, abs=0.0001)
        assert leaning_m > 0.00008  # the tool's weight presses less on the wrist
        robot.tare()
        assert abs(robot.observe(cameras=()).compression_m) < 0.0001

    def test_a_wrist_that_is_pressed_is_not_tared(self, robot: Robot, cell: Workcell) -> None:
        move(robot, BESIDE)
        move(robot, PRESSED, 0.02, LIMIT_M)
        with pytest.raises(
            RobotFault, match=r"pressed by [789]\.\d mm, and does not hang"
        ) as fault:
            robot.tare()
        assert fault.value.kind == "loaded"
        assert cell.truth().compression_m < LIMIT_M + 0.001

    def test_waiting_passes_time_on_the_robots_clock_and_moves_nothing(self, robot: Robot) -> None:
        began, at = robot.clock(), robot.observe(cameras=()).pose
        robot.settle(0.7)
        assert robot.clock() - began == pytest.approx(0.7, abs=0.03)
        assert distance(robot.observe(cameras=()).pose, at) < 0.0003

    def test_a_picture_is_taken_after_the_motion_and_shows_where_the_peg_is(
        self, robot: Robot
    ) -> None:
        goals = shipped().goals
        motion = robot.move_to(
            goals.target(Formation.APPROACH), speed_m_s=0.05, stop_at_compression_m=0.02
        )
        robot.settle(1.5)
        at = robot.observe()
        view = at.views["side"]
        assert view.time_s >= at.time_s - 1e-4 >= motion.ended_s
        scene = measure(view, TASK)
        assert scene.problems == ()
        assert scene.peg is not None
        taught = shipped().scenes[Formation.APPROACH].peg
        assert taught is not None
        assert scene.peg.tip_y.value == pytest.approx(taught.tip_y.value, abs=0.001)

    def test_a_robot_left_stays_where_it_is(self, robot: Robot) -> None:
        with robot:
            move(robot, BESIDE)
        at = robot.observe(cameras=()).pose
        robot.settle(0.5)
        assert distance(robot.observe(cameras=()).pose, at) < 0.0005

    def test_a_robot_that_was_halted_goes_on_when_told(self, robot: Robot) -> None:
        move(robot, BESIDE)
        robot.halt()
        robot.halt()
        assert move(robot, HOME) is Stop.REACHED
