"""What the hand of the guided skills does, motion by motion, against a wrist as a script has it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import pytest
from stand_ins import ScriptedRobot, scene_of

from pliant.belief import Belief
from pliant.cell import Observation
from pliant.formations import Formation
from pliant.methods.guided.hand import WORKED, Hand, Manner
from pliant.methods.guided.skills import GuidedSkills
from pliant.pose import Axis, Pose
from pliant.records import Look
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.scene import Measured

TASK = load_task("square", "L1")
TEACHING = shipped().for_task(TASK)
HANGS = Pose(z=0.22)
SURE = Measured(value=0.0, sd=0.0002)
BELIEF = Belief(hole_y=SURE, surface_z=SURE)


@dataclass(kw_only=True)
class SprungRobot(ScriptedRobot):
    """A robot whose wrist is compressed [m] as a script says of its pose."""

    springs: Callable[[Pose], float]

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        return replace(super().observe(cameras), compression_m=self.springs(self.pose))

    def moved(self, axis: Axis) -> list[float]:
        """How far each motion went along an axis [m, rad], without those that did not."""
        ways = [b[axis] - a[axis] for a, b in zip([HANGS, *self.poses], self.poses, strict=False)]
        return [way for way in ways if abs(way) > 1e-9]


def hand_of(robot: SprungRobot) -> Hand:
    def look(cameras: Sequence[str] = ("side",)) -> Look:
        return Look(observation=robot.observe(cameras), scene=scene_of())

    step = TEACHING.goals.step(Formation.FIT)
    return Hand(Manner(), TASK, TEACHING, robot, look, step, BELIEF)


def standing_below(z: float) -> Callable[[Pose], float]:
    """The wrist of a peg that stands on something: pressed by what the hand is below `z` [m]."""
    return lambda pose: max(0.0, z - pose.z)


@pytest.mark.parametrize("pressed", [0.0012, 0.003, WORKED])
def test_a_load_is_what_the_wrist_reads_whether_it_was_more_or_less(pressed: float) -> None:
    for start in (0.0, 0.005, 0.012):
        robot = SprungRobot(pose=HANGS, springs=standing_below(HANGS.z + start))
        hand_of(robot).load(pressed)
        assert robot.springs(robot.pose) == pytest.approx(pressed, abs=0.0003)


def test_a_load_that_is_there_moves_nothing() -> None:
    robot = SprungRobot(pose=HANGS, springs=lambda pose: 0.0031)
    hand_of(robot).load(0.003)
    assert robot.poses == []


def test_a_load_that_does_not_come_is_given_up_after_four_short_motions() -> None:
    robot = SprungRobot(pose=HANGS, springs=lambda pose: 0.0)
    hand_of(robot).load(0.02)
    assert robot.moved(Axis.Z) == pytest.approx([-0.008] * 4)


def test_a_free_peg_is_lifted_straight_up_in_short_steps() -> None:
    robot = SprungRobot(pose=HANGS, springs=lambda pose: 0.0)
    hand_of(robot).lift(0.245)
    assert robot.pose == HANGS.updated({Axis.Z: 0.245})
    assert robot.moved(Axis.Z) == pytest.approx([0.01, 0.01, 0.005])


def test_a_peg_that_holds_on_is_shaken_and_pulled_no_further_until_it_lets_go() -> None:
    def springs(pose: Pose) -> float:
        sides = {math.copysign(1.0, p.yaw) for p in robot.poses if abs(p.yaw) > 0.01}
        return 0.0 if len(sides) == 2 else HANGS.z - pose.z

    robot = SprungRobot(pose=HANGS, springs=springs)
    hand_of(robot).lift(0.25)
    first_turn = next(i for i, pose in enumerate(robot.poses) if pose.yaw)
    assert robot.poses[first_turn].z == pytest.approx(HANGS.z + 0.01)
    assert robot.pose.z == pytest.approx(0.25)
    assert (robot.pose.x, robot.pose.y, robot.pose.roll, robot.pose.yaw) == pytest.approx((0,) * 4)


def test_easing_stays_where_the_wrist_springs_back_and_presses_again() -> None:
    free_at = HANGS.y - 0.001

    def springs(pose: Pose) -> float:
        held = max(0.0, HANGS.z + WORKED - pose.z)
        return held if pose.y > free_at + 1e-6 else max(0.0, held - 0.004)

    robot = SprungRobot(pose=HANGS, springs=springs)
    hand_of(robot).ease(0.001)
    assert robot.pose.y == pytest.approx(free_at)
    assert robot.pose.x == pytest.approx(HANGS.x)
    assert robot.springs(robot.pose) == pytest.approx(WORKED, abs=0.0003)


def test_easing_that_helps_nowhere_ends_where_it_began() -> None:
    robot = SprungRobot(pose=HANGS, springs=lambda pose: WORKED)
    hand_of(robot).ease(0.001)
    assert robot.moved(Axis.Y) == pytest.approx([0.001, -0.001, -0.001, 0.001])
    assert robot.moved(Axis.X) == pytest.approx([0.001, -0.001, -0.001, 0.001])
    assert robot.pose == HANGS


def test_a_corner_over_the_hole_but_not_in_it_is_swept_across_further_each_time() -> None:
    corner = -(TASK.peg.half_extents[1] + TASK.hole.clearance / 2) + 0.003  # where it belongs
    over = scene_of(tip_y=corner + TASK.peg.half_extents[1], tip_z=0.0005)
    robot = SprungRobot(pose=HANGS, springs=standing_below(HANGS.z + 0.003))
    skills = GuidedSkills(task=TASK, teaching=TEACHING, manner=Manner())
    step = TEACHING.goals.step(Formation.FIT)

    def look(cameras: Sequence[str] = ("side",)) -> Look:
        return Look(observation=robot.observe(cameras), scene=over)

    outcome = skills(robot, look, HANGS, step, BELIEF)
    out, back = robot.moved(Axis.X)[::2], robot.moved(Axis.X)[1::2]
    assert out[:4] == pytest.approx([-0.0008, 0.0016, -0.0016, 0.0024])
    assert [-x for x in out] == pytest.approx(back)
    assert all(way < 0 for way in robot.moved(Axis.Y)), "always on to the far wall"
    turns = robot.moved(Axis.YAW)
    assert sum(turns) == pytest.approx(0.0)
    assert len(turns) == 3 * len(out)
    assert outcome.step is step
