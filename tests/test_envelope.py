import math
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from stand_ins import ScriptedRobot

from pliant.cell import Motion, Robot
from pliant.envelope import Descent, Guarded, Limits
from pliant.errors import RobotFault
from pliant.pose import Axis, Pose
from pliant.wrist import SensorAnswer

LIMITS = Limits()
ANYWHERE = st.builds(Pose, **{axis.value: st.floats(-1.0, 1.0) for axis in Axis})
INSIDE = st.builds(
    Pose, **{axis.value: st.floats(LIMITS.low[axis], LIMITS.high[axis]) for axis in Axis}
)
ANY_NUMBER = st.floats(allow_nan=True, allow_infinity=True)


def is_inside(pose: Pose) -> bool:
    return all(LIMITS.low[axis] <= pose[axis] <= LIMITS.high[axis] for axis in Axis)


@given(ANYWHERE, ANY_NUMBER, ANY_NUMBER)
def test_nothing_outside_the_limits_ever_reaches_the_robot(
    pose: Pose, speed: float, compression: float
) -> None:
    robot = ScriptedRobot()
    with suppress(RobotFault):
        Guarded(robot, LIMITS).move_to(pose, speed_m_s=speed, stop_at_compression_m=compression)
    for sent in robot.poses:
        assert is_inside(sent)
    assert all(0 < s <= LIMITS.speed_m_s for s in robot.speeds)
    assert all(0 < c <= LIMITS.compression_m for c in robot.compression_limits)


@given(INSIDE, st.sampled_from(list(Axis)), st.floats(1e-9, 1.0), st.booleans())
def test_one_axis_outside_the_workspace_is_enough_to_refuse(
    pose: Pose, axis: Axis, by: float, above: bool
) -> None:
    outside = LIMITS.high[axis] + by if above else LIMITS.low[axis] - by
    robot = ScriptedRobot()
    with pytest.raises(RobotFault, match=f"{axis} .* is outside the workspace"):
        Guarded(robot, LIMITS).move_to(
            pose.updated({axis: outside}), speed_m_s=0.05, stop_at_compression_m=0.01
        )
    assert robot.calls == ["halt"]


@given(INSIDE, st.floats(0.001, 0.1), st.floats(0.001, 0.02))
def test_what_lies_inside_the_limits_passes_unchanged(
    pose: Pose, speed: float, compression: float
) -> None:
    robot = ScriptedRobot()
    motion = Guarded(robot, LIMITS).move_to(
        pose, speed_m_s=speed, stop_at_compression_m=compression
    )
    assert (robot.poses, robot.speeds, robot.compression_limits) == ([pose], [speed], [compression])
    assert motion.requested == motion.commanded == pose


def test_too_much_speed_and_compression_are_capped() -> None:
    robot = ScriptedRobot()
    Guarded(robot, LIMITS).move_to(Pose(z=0.2), speed_m_s=5.0, stop_at_compression_m=1.0)
    assert robot.speeds == [LIMITS.speed_m_s]
    assert robot.compression_limits == [LIMITS.compression_m]


@pytest.mark.parametrize("value", [0.0, -0.1, math.nan])
def test_a_speed_or_a_limit_that_is_not_above_zero_is_refused_and_halts(value: float) -> None:
    for speed, compression in ((value, 0.01), (0.05, value)):
        robot = ScriptedRobot()
        with pytest.raises(RobotFault, match="above 0"):
            Guarded(robot, LIMITS).move_to(
                Pose(z=0.2), speed_m_s=speed, stop_at_compression_m=compression
            )
        assert robot.calls == ["halt"]


@given(st.dictionaries(st.sampled_from(list(Axis)), st.floats(-1, 1), min_size=1))
def test_a_goal_is_outside_exactly_when_one_of_its_axes_is(goal: dict[Axis, float]) -> None:
    bad = [a for a, v in goal.items() if not LIMITS.low[a] <= v <= LIMITS.high[a]]
    reason = LIMITS.outside(goal)
    assert (reason is not None) == bool(bad)
    assert reason is None or reason.startswith(str(bad[0]))


@given(st.sampled_from(list(Axis)))
def test_a_goal_that_is_not_a_number_is_outside(axis: Axis) -> None:
    assert LIMITS.outside({axis: math.nan}) is not None


def test_limits_of_ones_own_are_kept() -> None:
    limits = Limits(speed_m_s=0.01, compression_m=0.005, high=Pose(z=0.15))
    robot = ScriptedRobot()
    guarded = Guarded(robot, limits)
    guarded.move_to(Pose(z=0.14), speed_m_s=1.0, stop_at_compression_m=1.0)
    assert (robot.speeds, robot.compression_limits) == ([0.01], [0.005])
    with pytest.raises(RobotFault):
        guarded.move_to(Pose(z=0.16), speed_m_s=1.0, stop_at_compression_m=1.0)


def test_leaving_the_envelope_halts_the_robot_also_after_an_error() -> None:
    robot = ScriptedRobot()
    with pytest.raises(ZeroDivisionError), Guarded(robot, LIMITS):
        _ = 1 / 0
    assert robot.calls == ["halt"]


def test_everything_else_is_passed_on() -> None:
    robot = ScriptedRobot()
    guarded: Robot = Guarded(robot, LIMITS)
    guarded.settle(0.5)
    guarded.tare()
    assert guarded.clock() == 0.5
    assert list(guarded.observe(("side", "wide")).views) == ["side", "wide"]
    guarded.halt()
    assert robot.calls == ["settle", "tare", "clock", "observe", "halt"]


@given(ANYWHERE)
def test_a_refusal_says_value_and_valid_range_in_millimetres_or_degrees(pose: Pose) -> None:
    assume(not is_inside(pose))
    with pytest.raises(RobotFault) as error:
        Guarded(ScriptedRobot(), LIMITS).move_to(pose, speed_m_s=0.05, stop_at_compression_m=0.01)
    axis = next(a for a in Axis if not LIMITS.low[a] <= pose[a] <= LIMITS.high[a])
    assert f"{axis} {axis.to_report(pose[axis]):.1f} {axis.report_unit}" in str(error.value)
    assert f"{axis.to_report(LIMITS.low[axis]):.1f} to" in str(error.value)


# --- descents ------------------------------------------------------------------------------------

HANG_M = 0.193


@given(st.floats(-0.05, 0.05), st.floats(0.001, 0.019), st.floats(0.12, 0.25))
def test_what_is_to_touch_a_board_goes_no_lower_than_the_touch_is_due(
    surface: float, touch: float, z: float
) -> None:
    robot = ScriptedRobot()
    guarded = Guarded(robot, LIMITS)
    guarded.descent = Descent(surface_z=surface, hang_m=HANG_M, depth_m=0.010)
    motion = guarded.move_to(Pose(z=z), speed_m_s=0.02, stop_at_compression_m=touch)
    due = max(-0.02, min(0.02, surface)) + HANG_M - touch
    assert motion.requested.z == z
    assert robot.poses[0].z == motion.commanded.z
    assert motion.commanded.z == pytest.approx(max(z, min(due - 0.010, 0.244)))


LOW = replace(LIMITS, low=replace(LIMITS.low, z=0.05))


def test_a_peg_may_go_into_its_hole_but_not_through_the_board() -> None:
    robot = ScriptedRobot(answer=SensorAnswer(slope=1.0, sd=0.0))
    guarded = Guarded(robot, LOW)
    guarded.descent = Descent(surface_z=0.0, hang_m=HANG_M, depth_m=0.010)
    guarded.move_to(Pose(z=0.190), speed_m_s=0.02, stop_at_compression_m=0.02)
    for z, commanded in ((0.160, 0.160), (0.100, HANG_M - 0.010 - 0.020 - 0.010)):
        guarded.move_to(Pose(z=z), speed_m_s=0.02, stop_at_compression_m=0.02)
        assert robot.poses[-1].z == pytest.approx(commanded)


@pytest.mark.parametrize(
    "answer",
    [
        None,
        SensorAnswer(slope=0.0, sd=0.2),
        SensorAnswer(slope=0.7, sd=0.0),
        SensorAnswer(slope=1.5, sd=0.1),
    ],
)
def test_until_the_wrists_sensor_has_answered_nothing_presses_further_than_a_touch_may(
    answer: SensorAnswer | None,
) -> None:
    robot = ScriptedRobot(answer=answer)
    guarded = Guarded(robot, LOW)
    guarded.descent = Descent(surface_z=0.0, hang_m=HANG_M, depth_m=0.010)
    for _ in range(2):
        guarded.move_to(Pose(z=0.100), speed_m_s=0.02, stop_at_compression_m=0.02)
        assert robot.poses[-1].z == pytest.approx(HANG_M - 0.014)
    robot.answer = SensorAnswer(slope=0.95, sd=0.05)
    guarded.move_to(Pose(z=0.178), speed_m_s=0.02, stop_at_compression_m=0.02)
    guarded.move_to(Pose(z=0.100), speed_m_s=0.02, stop_at_compression_m=0.02)
    assert robot.poses[-1].z < HANG_M - 0.03


def test_until_then_a_peg_that_is_seen_in_the_hole_goes_on_from_where_it_is_seen() -> None:
    robot = ScriptedRobot(answer=SensorAnswer(slope=0.1, sd=0.0))
    guarded = Guarded(robot, LOW)
    for sunk, commanded in ((0.005, HANG_M - 0.019), (0.017, HANG_M - 0.031), (0.090, 0.153)):
        guarded.descent = Descent(surface_z=0.0, hang_m=HANG_M, depth_m=0.010, sunk_m=sunk)
        for _ in range(9):  # in the hole a press that is not felt is a slide
            guarded.move_to(Pose(z=0.100), speed_m_s=0.02, stop_at_compression_m=0.02)
        assert robot.poses[-1].z == pytest.approx(commanded)
    assert not guarded.has_answered


def test_a_peg_that_has_been_lifted_out_of_the_hole_is_not_counted_as_deep_in_it() -> None:
    robot = ScriptedRobot(answer=None)
    guarded = Guarded(robot, LOW)
    guarded.descent = Descent(
        surface_z=0.0, hang_m=HANG_M, depth_m=0.010, sunk_m=0.009, seen_z=HANG_M - 0.009
    )
    for lifted, lowest in ((HANG_M - 0.001, HANG_M - 0.023), (HANG_M + 0.02, HANG_M - 0.014)):
        for z in (lifted, 0.100):
            guarded.move_to(Pose(z=z), speed_m_s=0.02, stop_at_compression_m=0.02)
        assert robot.poses[-1].z == pytest.approx(lowest)


@pytest.mark.parametrize("held", [False, True])
def test_until_then_a_peg_in_the_hole_must_be_seen_to_rise_with_the_hand(held: bool) -> None:
    robot = ScriptedRobot(answer=None)
    guarded = Guarded(robot, LOW)
    guarded.descent = Descent(
        surface_z=0.0, hang_m=HANG_M, depth_m=0.040, sunk_m=0.030, seen_z=0.160
    )
    guarded.sees_depth = lambda: 0.030 - (0.0 if held else robot.poses[-1].z - 0.160)
    guarded.move_to(Pose(z=0.160), speed_m_s=0.02, stop_at_compression_m=0.02)
    with pytest.raises(RobotFault, match="not seen to rise") if held else nullcontext():
        guarded.move_to(Pose(z=0.240), speed_m_s=0.02, stop_at_compression_m=0.02)
    rises = [0.174] if held else [0.174, 0.188, 0.202, 0.240]  # out of the hole nothing holds it
    assert [pose.z for pose in robot.poses[1:]] == pytest.approx(rises, abs=0.003)


@pytest.mark.parametrize(
    ("off", "answered", "arrives"),
    [(0.009, False, True), (0.011, False, False), (0.02, True, True)],
)
def test_until_then_a_hand_that_is_held_back_is_a_fault(
    off: float, answered: bool, arrives: bool
) -> None:
    robot = HeldBack(by=off, answer=None)
    guarded = Guarded(robot, LIMITS)
    guarded.has_answered = answered
    with nullcontext() if arrives else pytest.raises(RobotFault, match="has not answered yet"):
        guarded.move_to(Pose(y=0.02, z=0.2), speed_m_s=0.02, stop_at_compression_m=0.02)
    assert (robot.calls[-1] == "halt") is not arrives


@dataclass(kw_only=True)
class HeldBack(ScriptedRobot):
    """A robot that ends every motion beside its goal."""

    by: float

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        motion = super().move_to(
            pose, speed_m_s=speed_m_s, stop_at_compression_m=stop_at_compression_m
        )
        return replace(motion, ended=pose.updated({Axis.Y: pose.y - self.by}))


@pytest.mark.parametrize(("slope", "presses"), [(0.5, 4), (1.5, 1)])
def test_a_sensor_that_answers_wrongly_ends_the_trial_one_that_slid_once_does_not(
    slope: float, presses: int
) -> None:
    robot = ScriptedRobot(answer=SensorAnswer(slope=slope, sd=0.0))
    guarded = Guarded(robot, LIMITS)
    for _ in range(presses - 1):
        guarded.move_to(Pose(z=0.19), speed_m_s=0.02, stop_at_compression_m=0.02)
    with pytest.raises(RobotFault, match=f"a millimetre of pressing is felt as {slope:.2f} mm"):
        guarded.move_to(Pose(z=0.19), speed_m_s=0.02, stop_at_compression_m=0.02)
    assert robot.calls[-1] == "halt"


def test_what_slides_after_the_sensor_has_answered_is_no_news() -> None:
    robot = ScriptedRobot()
    guarded = Guarded(robot, LIMITS)
    for slope in (0.5, 1.05, *[0.2] * 9):
        robot.answer = SensorAnswer(slope=slope, sd=0.0)
        guarded.move_to(Pose(z=0.19), speed_m_s=0.02, stop_at_compression_m=0.02)
    assert guarded.has_answered


def test_an_arm_that_is_lower_already_is_not_lifted_by_it() -> None:
    robot = ScriptedRobot(pose=Pose(z=0.150))
    guarded = Guarded(robot, LIMITS)
    guarded.descent = Descent(surface_z=0.0, hang_m=HANG_M, depth_m=0.010)
    guarded.move_to(Pose(z=0.140), speed_m_s=0.02, stop_at_compression_m=0.004)
    assert robot.poses[-1].z == 0.150


@pytest.mark.parametrize(
    ("readings", "looks", "felt"),
    [
        ((0.0063,), 1, True),  # sure at once
        ((0.0031, 0.0022, 0.0058), 3, True),  # noise hid it at first
        ((0.0031, 0.0005), 2, False),  # noise feigned it
        ((0.0015,), 1, False),
        ((0.0022,) * 9, 4, True),
        ((0.0021, 0.002, 0.0019), 3, False),
    ],
)
def test_what_noise_hides_at_rest_is_read_again(
    readings: tuple[float, ...], looks: int, felt: bool
) -> None:
    robot = ScriptedRobot(readings=readings, sd_m=0.001)
    guarded = Guarded(robot, LIMITS)
    guarded.observe(())
    assert guarded.has_answered is felt
    assert robot.calls.count("observe") == looks


def test_a_wrist_that_has_answered_is_not_read_again() -> None:
    robot = ScriptedRobot(readings=(0.0031, 0.0031), sd_m=0.001)
    guarded = Guarded(robot, LIMITS)
    guarded.has_answered = True
    guarded.observe(())
    assert robot.calls == ["observe"]
