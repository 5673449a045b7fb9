import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.pose import Axis, Pose, angles_from, describe, pose_from, rotation_matrix

ANGLES = st.floats(-3.1, 3.1)
PITCHES = st.floats(-1.5, 1.5)
LENGTHS = st.floats(-1.0, 1.0)
POSES = st.builds(Pose, x=LENGTHS, y=LENGTHS, z=LENGTHS, roll=ANGLES, pitch=PITCHES, yaw=ANGLES)


@pytest.mark.parametrize("axis", list(Axis))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_pose_refuses_a_component_that_is_not_finite(axis: Axis, value: float) -> None:
    with pytest.raises(ValueError, match=f"pose {axis} is {value}"):
        Pose(**{axis.value: value})


@given(POSES)
def test_a_pose_comes_back_from_its_position_and_rotation(pose: Pose) -> None:
    back = pose_from(pose.position(), pose.rotation())
    assert all(abs(e) < 1e-6 for e in pose.error(back, Axis).values())


@given(ANGLES, PITCHES, ANGLES)
def test_a_rotation_keeps_lengths_and_handedness(roll: float, pitch: float, yaw: float) -> None:
    rotation = rotation_matrix(roll, pitch, yaw)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_positive_roll_leans_the_tools_top_to_the_left_which_is_minus_y() -> None:
    top = Pose(roll=math.radians(10)).rotation() @ [0.0, 0.0, 1.0]
    assert top[0] == pytest.approx(0.0)
    assert top[1] == pytest.approx(-math.sin(math.radians(10)))


def test_angles_are_applied_roll_first_then_pitch_then_yaw() -> None:
    turned = Pose(roll=math.pi / 2, yaw=math.pi / 2).rotation() @ [0.0, 1.0, 0.0]
    assert np.allclose(turned, [0.0, 0.0, 1.0])  # y to z by roll; yaw leaves z alone
    assert angles_from(rotation_matrix(0.1, -0.2, 0.3)) == pytest.approx((0.1, -0.2, 0.3))


@given(POSES, st.dictionaries(st.sampled_from(list(Axis)), st.floats(-1, 1)))
def test_updating_replaces_the_named_axes_and_no_other(pose: Pose, goal: dict[Axis, float]) -> None:
    updated = pose.updated(goal)
    assert all(updated[axis] == goal.get(axis, pose[axis]) for axis in Axis)


def test_an_error_is_other_minus_self_over_the_asked_axes_only() -> None:
    error = Pose(y=0.010, z=0.2).error(Pose(y=0.012, z=0.5), [Axis.Y])
    assert error == {Axis.Y: pytest.approx(0.002)}


def test_an_angles_error_takes_the_short_way_round() -> None:
    error = Pose(yaw=math.radians(179)).error(Pose(yaw=math.radians(-179)), [Axis.YAW])
    assert math.degrees(error[Axis.YAW]) == pytest.approx(2.0)


@given(st.sampled_from(list(Axis)), st.floats(-10, 10))
def test_report_units_convert_there_and_back(axis: Axis, value: float) -> None:
    assert axis.from_report(axis.to_report(value)) == pytest.approx(value)


def test_people_read_millimetres_and_degrees() -> None:
    goal = {Axis.Y: -0.035, Axis.ROLL: math.radians(10)}
    assert describe(goal) == "y -35.0 mm, roll 10.0 deg"
