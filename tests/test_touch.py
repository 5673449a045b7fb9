"""Where no camera shows anything, the guided method goes by touch: by the arm, the wrist's
compression, and where the peg was seen to hang before."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stand_ins import UNSEEN, outcome_of, prepared

from pliant import run
from pliant.belief import Belief, hang_share
from pliant.conditions import Setup, condition
from pliant.diagnosis import Hypothesis
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.levels import load_level
from pliant.methods.guided import Guided
from pliant.methods.guided.touch import hangs, placed
from pliant.pose import Axis, Pose, rotation_matrix
from pliant.records import End, Look, Trial
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.scene import Measured, Scene

CIRCLE, TEACHING = load_task("circle"), shipped().for_task(load_task("circle"))
SHARE = hang_share(TEACHING)
ANGLES = st.floats(-0.2, 0.2)


def known(value: float) -> Measured:
    return Measured(value=value, sd=0.0001)


def look_at(pose: Pose, *, compression: float = 0.0, scene: Scene = UNSEEN) -> Look:
    look = outcome_of(Formation.FIT, scene=scene).looks[-1]
    observation = replace(look.observation, pose=pose, compression_m=compression)
    return replace(look, observation=observation)


def believed(pose: Pose, tip: np.ndarray, roll: float, pitch: float) -> Belief:
    """The belief after a peg was seen to hang there from a hand in that pose, which hangs upright
    when the hand has that roll and pitch."""
    tilt, lean = SHARE * (pose.roll - roll), SHARE * (pose.pitch - pitch)
    return Belief(
        hole_y=known(0.0),
        hole_x=known(0.0),
        surface_z=known(0.0),
        upright_roll=known(roll),
        upright_pitch=known(pitch),
        tip_in_hand=hangs(pose, tip, tilt, lean),
    )


@given(ANGLES, ANGLES, ANGLES, ANGLES, ANGLES, st.floats(-0.02, 0.02))
def test_a_peg_that_still_hangs_as_it_was_seen_is_felt_where_it_was_seen(
    roll: float, pitch: float, yaw: float, up: float, over: float, at: float
) -> None:
    pose = Pose(x=0.01, y=at, z=0.2, roll=roll, pitch=pitch, yaw=yaw)
    tip = np.array([0.002, at - 0.01, 0.01])
    moved = replace(pose, x=pose.x + 0.03, z=pose.z - 0.02)
    scene = placed(CIRCLE, TEACHING, look_at(moved), believed(pose, tip, up, over))
    assert scene.peg is not None
    assert scene.across is not None
    assert scene.across.tip_x is not None
    felt = scene.across.tip_x.value, scene.peg.tip_y.value, scene.peg.tip_z.value
    assert felt == pytest.approx(tuple(tip + [0.03, 0.0, -0.02]), abs=1e-9)


@given(ANGLES, st.floats(0.0, 0.02))
def test_a_pressed_wrist_has_the_tip_higher_along_the_hand(roll: float, pressed: float) -> None:
    pose = Pose(z=0.2, roll=roll)
    belief = believed(pose, np.array([0.0, 0.0, 0.01]), 0.0, 0.0)
    free, under = (
        placed(CIRCLE, TEACHING, look_at(pose, compression=c), belief).peg for c in (0.0, pressed)
    )
    assert free is not None
    assert under is not None
    moved = under.tip_y.value - free.tip_y.value, under.tip_z.value - free.tip_z.value
    along = pressed * rotation_matrix(roll, 0.0, 0.0)[1:, 2]
    assert moved == pytest.approx(tuple(along), abs=1e-9)


def test_touch_says_nothing_where_a_picture_shows_something_or_nothing_was_seen_before() -> None:
    pose = Pose(z=0.2)
    belief = believed(pose, np.array([0.0, 0.0, 0.01]), 0.0, 0.0)
    shown = TEACHING.scenes[Formation.FIT]
    board_only = replace(shown, peg=None)
    assert placed(CIRCLE, TEACHING, look_at(pose, scene=board_only), belief).peg is None
    assert placed(CIRCLE, TEACHING, look_at(pose, scene=shown), belief).peg is shown.peg
    assert placed(CIRCLE, TEACHING, look_at(pose), Belief()) is UNSEEN
    assert placed(CIRCLE, TEACHING, look_at(pose), replace(belief, tip_in_hand=None)) is UNSEEN


def test_what_is_felt_has_no_pixels_and_a_check_says_that_it_is_by_touch() -> None:
    pose = Pose(z=0.2)
    belief = believed(pose, np.array([0.0, 0.0, -0.02]), 0.0, 0.0)
    peg = placed(CIRCLE, TEACHING, look_at(pose), belief).peg
    assert peg is not None
    assert math.isnan(peg.center_px[0])
    outcome = replace(outcome_of(Formation.INSERTION), looks=(look_at(pose),))
    evidence = Guided().check(CIRCLE, outcome, belief, TEACHING)
    metric = evidence["metric"]
    assert metric is not None
    assert metric.vote
    assert metric.message.startswith("by touch: 20.0 mm deep")


@given(st.floats(0.006, 0.030))
def test_a_peg_counts_as_inserted_by_touch_only_with_room_for_it_to_have_slid(depth: float) -> None:
    belief = believed(Pose(z=0.2), np.array([0.0, 0.0, -depth]), 0.0, 0.0)
    outcome = replace(outcome_of(Formation.INSERTION), looks=(look_at(Pose(z=0.2)),))
    metric = Guided().check(CIRCLE, outcome, belief, TEACHING)["metric"]
    assert metric is not None
    assert metric.vote == (depth >= 0.010 + 0.0008 + 0.005)


@pytest.mark.parametrize("peg", ["circle", "rectangle_narrow"])
def test_a_peg_is_inserted_though_no_camera_shows_it_near_the_board(peg: str) -> None:
    trial = run(level="blind", peg=peg, seed=43001)
    assert trial.inserted
    assert trial.diagnosis is not None
    assert trial.diagnosis.leading is Hypothesis.CAMERA_BLIND
    fit = next(e for e in trial.executions if e.formation is Formation.FIT)
    assert fit.outcome.scene.peg is None
    assert fit.outcome.step.goal.keys() == {Axis.Y}


def test_only_a_blind_camera_is_dark_and_only_near_the_board() -> None:
    down = Pose(z=CIRCLE.tip_below_hinge + 0.02)
    for below, dark in ((0.0, False), (0.03, True)):
        robot = prepared(setup=Setup(seed=0, blind_below=below))
        assert robot.observe(("side",)).views["side"].image.std() > 10.0
        robot.move_to(down, speed_m_s=0.05, stop_at_compression_m=0.02)
        assert (robot.observe(("side",)).views["side"].image.std() < 1.0) == dark
    robot = prepared(setup=Setup(seed=0))
    robot.move_to(replace(down, z=down.z - 0.03), speed_m_s=0.05, stop_at_compression_m=0.02)
    assert robot.observe(("side",)).views["side"].image.std() > 10.0  # also in the hole


def blind_and(**ranges: tuple[float, float]) -> Trial:
    """A trial in which no camera shows anything near the board, and something else is so."""
    level = load_level("blind")
    drawn = level.on(condition("all"))
    also = replace(drawn, name="both", ranges={**drawn.ranges, **ranges})
    spec = Spec.named(peg="square", level="blind", condition=also, seed=771)
    return perform(spec, SimCell(), shipped())


def test_a_board_that_lies_anywhere_is_looked_at_from_higher_first() -> None:
    trial = blind_and(hole_x=(-0.01, 0.01), board_yaw=(-0.17, 0.17), grasp_pitch=(-0.08, 0.08))
    assert trial.inserted
    heights = [look.observation.pose.z for look in trial.executions[0].outcome.looks]
    assert max(heights) == pytest.approx(heights[0] + 0.03, abs=0.002)


def test_nothing_is_accepted_by_touch_of_a_sensor_that_never_answered() -> None:
    trial = blind_and(compression_dead=(1.0, 1.0), compression_noise=(0.0003, 0.0003))
    assert trial.end_reason == "fault:sensor"
    assert "no picture shows where the peg is" in trial.fault


def test_a_peg_that_was_seen_to_be_short_is_not_put_in_blind() -> None:
    trial = blind_and(peg_longer=(-0.015, -0.015))
    assert trial.end_reason == End.STOPPED
    assert trial.diagnosis is not None
    assert trial.diagnosis.leading is Hypothesis.PEG_OTHER


def test_a_hole_that_is_not_found_by_touch_ends_the_trial_with_words() -> None:
    trial = blind_and(bar_height=(0.005, 0.005))
    assert trial.end_reason == End.STOPPED
    recovery = trial.executions[-1].recovery
    assert recovery is not None
    assert recovery.analysis.what == "the hole was not found"
