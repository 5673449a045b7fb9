import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from stand_ins import UNSEEN, outcome_of, scene_of

from pliant.belief import Belief
from pliant.cell import Stop
from pliant.checks import (
    compression_check,
    doubt,
    goal_picture,
    metric_insertion,
    pose_check,
    slid,
    sunk,
    table_i,
)
from pliant.formations import OWNED, Formation
from pliant.methods.guided.checks import metric_upright
from pliant.methods.planar.checks import check, metric_align, metric_fit
from pliant.pose import Axis, Pose
from pliant.records import Check, Outcome
from pliant.task import Task, load_task
from pliant.teaching import shipped
from pliant.vision.scene import Across, Measured, Scene

CIRCLE, RECTANGLE = load_task("circle"), load_task("rectangle_narrow")
FORMATIONS = st.sampled_from(list(Formation))
SMALL = 1e-6


def pose_vote(formation: Formation, axis: Axis, error: float) -> bool | None:
    target = shipped().goals.target(formation)
    ended = target.updated({axis: target[axis] + error})
    return pose_check(outcome_of(formation, ended=ended)).vote


# --- pose --------------------------------------------------------------------------------------


@given(FORMATIONS, st.sampled_from([-1.0, 1.0]))
def test_a_length_passes_within_one_millimetre_and_fails_beyond(
    formation: Formation, sign: float
) -> None:
    for axis in OWNED[formation]:
        if not axis.is_angle:
            assert pose_vote(formation, axis, sign * (0.001 - SMALL)) is True
            assert pose_vote(formation, axis, sign * (0.001 + SMALL)) is False


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_angle_passes_within_half_a_degree_and_fails_beyond(sign: int) -> None:
    half = math.radians(0.5)
    assert pose_vote(Formation.APPROACH, Axis.ROLL, sign * (half - SMALL)) is True
    assert pose_vote(Formation.APPROACH, Axis.ROLL, sign * (half + SMALL)) is False


@given(FORMATIONS, st.sampled_from(list(Axis)), st.floats(-0.1, 0.1))
def test_axes_that_a_formation_does_not_own_are_not_checked(
    formation: Formation, axis: Axis, error: float
) -> None:
    if axis not in OWNED[formation]:
        assert pose_vote(formation, axis, error) is True


def test_a_missed_pose_says_by_how_much_on_which_axis() -> None:
    target = shipped().goals.target(Formation.APPROACH)
    ended = target.updated({Axis.Z: target.z + 0.0042, Axis.ROLL: target.roll - math.radians(2)})
    result = pose_check(outcome_of(Formation.APPROACH, ended=ended))
    assert result.message == "off by z +4.2 mm, roll -2.0 deg"
    assert result.paper


def test_lengths_are_judged_by_their_norm_as_in_the_paper() -> None:
    target = shipped().goals.target(Formation.APPROACH)
    ended = target.updated({Axis.Y: target.y + 0.0009, Axis.Z: target.z + 0.0009})
    assert pose_check(outcome_of(Formation.APPROACH, ended=ended)).vote is False


# --- compression -------------------------------------------------------------------------------


def test_a_compression_stop_fails_the_compression_check() -> None:
    stopped = compression_check(outcome_of(Formation.INSERTION, stop=Stop.COMPRESSION))
    assert stopped.vote is False
    assert "20.0 mm" in stopped.message
    assert compression_check(outcome_of(Formation.INSERTION)).vote is True


def test_a_stop_in_any_of_a_skills_motions_counts() -> None:
    free = outcome_of(Formation.FIT)
    stopped = outcome_of(Formation.FIT, stop=Stop.COMPRESSION)
    both = replace(free, motions=stopped.motions + free.motions)
    assert compression_check(both).vote is False


# --- which checks ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formation", "expected"),
    [
        (Formation.APPROACH, {"pose", "compression"}),
        (Formation.CONTACT, {"pose", "compression"}),
        (Formation.FIT, {"pose", "compression", "table_i", "metric"}),
        (Formation.ALIGN, {"pose", "compression", "table_i", "metric"}),
        (Formation.INSERTION, {"pose", "compression", "metric", "goal_picture"}),
    ],
)
def test_each_formation_has_its_checks_and_the_papers_are_marked(
    formation: Formation, expected: set[str]
) -> None:
    evidence = check(CIRCLE, outcome_of(formation, scene=scene_of()), shipped().scenes)
    assert set(evidence.votes) == expected
    assert {c.name for c in evidence.checks if not c.paper} == expected & {"metric"}


@pytest.mark.parametrize("formation", [Formation.FIT, Formation.ALIGN, Formation.INSERTION])
@pytest.mark.parametrize(
    "scene",
    [
        UNSEEN,
        replace(scene_of(), peg=None, problems=("no peg: hidden",)),
        replace(scene_of(), hole=None, problems=("no hole: hidden",)),
    ],
)
def test_a_check_that_cannot_be_made_has_a_reason_and_no_vote(
    formation: Formation, scene: Scene
) -> None:
    evidence = check(CIRCLE, outcome_of(formation, scene=scene), shipped().scenes)
    from_picture = [c for c in evidence.checks if c.name not in ("pose", "compression")]
    assert len(from_picture) == 2
    for made in from_picture:
        assert made.vote is None
        assert made.message == "; ".join(scene.problems)


def test_without_a_goal_picture_insertion_cannot_be_compared_with_it() -> None:
    result = goal_picture(scene_of(), None)
    assert (result.vote, result.message) == (None, "no goal picture")


def test_a_check_that_was_not_made_is_absent_from_the_evidence() -> None:
    evidence = check(CIRCLE, outcome_of(Formation.APPROACH), shipped().scenes)
    assert evidence["metric"] is None
    assert isinstance(evidence["pose"], Check)


# --- Table I's boundaries, in pixels -----------------------------------------------------------


@pytest.mark.parametrize(
    ("center", "edge", "message"),
    [
        (320.0, 320.1, "success"),
        (320.0, 320.0, "p_gy was too small."),
        (320.1, 400.0, "p_gy was too big."),
    ],
)
def test_fits_comparisons_are_the_papers_to_the_pixel(
    center: float, edge: float, message: str
) -> None:
    scene = scene_of(center_px=center, edge_px=edge, hole_px=320.0)
    result = table_i(Formation.FIT, scene, 12.0)
    assert result.message == message
    assert result.vote is (message == "success")


@pytest.mark.parametrize(
    ("tilt", "message"),
    [
        (5.0, "Align success"),
        (-5.0, "Align success"),
        (5.01, "peg is tilted to the left."),
        (-5.01, "peg is tilted to the right."),
    ],
)
def test_five_degrees_is_still_upright(tilt: float, message: str) -> None:
    assert table_i(Formation.ALIGN, scene_of(tilt_deg=tilt), 12.0).message == message


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        (12.0, "Align success"),
        (-12.0, "Align success"),
        (12.1, "p_ey was too big."),
        (-12.1, "p_ey was too small."),
    ],
)
def test_on_the_hole_ends_at_the_tolerance(offset: float, message: str) -> None:
    scene = scene_of(center_px=320.0 + offset, hole_px=320.0)
    assert table_i(Formation.ALIGN, scene, 12.0).message == message


# --- the metric checks -------------------------------------------------------------------------


def fit_scene(*, deep: float, past_rim: float, hole_y: float = 0.0) -> Scene:
    """A circle leaning 12 degrees left, its low corner `deep` below the board and its trailing
    corner `past_rim` inside the near rim of its 42 mm hole [m]."""
    tilt = math.radians(12)
    tip_y = hole_y + 0.021 - past_rim - 0.02 * math.cos(tilt)
    return scene_of(tip_y=tip_y, tip_z=0.02 * math.sin(tilt) - deep, tilt_deg=12, hole_y=hole_y)


@given(st.floats(-0.03, 0.03))
def test_fit_is_seen_wherever_the_hole_is(hole_y: float) -> None:
    assert metric_fit(CIRCLE, fit_scene(deep=0.004, past_rim=0.002, hole_y=hole_y)).vote is True


def test_a_tip_on_the_board_is_no_fit() -> None:
    assert metric_fit(CIRCLE, fit_scene(deep=-0.0005, past_rim=0.002)).vote is False


def test_a_trailing_corner_on_the_near_rim_is_no_fit_though_table_i_cannot_see_it() -> None:
    scene = fit_scene(deep=0.004, past_rim=-0.002)
    assert metric_fit(CIRCLE, scene).vote is False
    assert table_i(Formation.FIT, scene, 12.0).vote is True


def test_a_peg_beyond_the_far_rim_is_no_fit() -> None:
    result = metric_fit(CIRCLE, scene_of(tip_y=-0.035, tip_z=-0.001, tilt_deg=12))
    assert result.vote is False
    assert "beyond the far rim" in result.message


def test_align_wants_both_corners_in_the_hole_and_an_upright_peg() -> None:
    assert metric_align(CIRCLE, scene_of(tip_y=0.0005, tip_z=-0.005)).vote is True
    assert metric_align(CIRCLE, scene_of(tip_y=0.004, tip_z=-0.005)).vote is False
    assert metric_align(CIRCLE, scene_of(tip_z=-0.005, tilt_deg=6)).vote is False
    assert metric_align(CIRCLE, scene_of(tip_z=0.001)).vote is False


def test_a_deep_peg_stands_in_the_hole_wherever_its_tip_is_read_above_it() -> None:
    sd = 0.0002
    across = Across(
        tip_x=Measured(value=0.004, sd=sd), pitch=None, hole_x=Measured(value=0.0, sd=sd)
    )
    for tip_z, stands in ((-0.0055, True), (-0.0045, False)):
        assert metric_upright(CIRCLE, scene_of(tip_y=0.004, tip_z=tip_z)).vote is stands
        aside = replace(scene_of(tip_z=tip_z), across=across)
        assert metric_upright(CIRCLE, aside).vote is stands
    assert metric_upright(CIRCLE, scene_of(tip_y=0.025, tip_z=-0.040)).vote is False
    assert metric_upright(CIRCLE, scene_of(tip_z=-0.040, tilt_deg=6)).vote is False


@pytest.mark.parametrize("task", [CIRCLE, RECTANGLE])
def test_insertion_wants_ten_millimetres_inside_the_hole(task: Task) -> None:
    beside = 0.022 if task is CIRCLE else 0.012
    assert metric_insertion(task, scene_of(tip_z=-0.012)).vote is True
    assert metric_insertion(task, scene_of(tip_z=-0.0099)).vote is False
    assert metric_insertion(task, scene_of(tip_z=-0.012, tip_y=beside)).vote is False


@given(st.floats(-0.03, 0.0), st.floats(-0.02, 0.02))
def test_the_goal_picture_is_compared_relative_to_the_hole(tip_z: float, shift: float) -> None:
    here = goal_picture(scene_of(tip_z=tip_z), scene_of(tip_z=-0.024))
    moved = goal_picture(scene_of(tip_z=tip_z, tip_y=shift, hole_y=shift), scene_of(tip_z=-0.024))
    assert here.vote == moved.vote


def test_a_picture_like_the_goals_passes_and_a_leaning_or_shallow_peg_does_not() -> None:
    goal = scene_of(tip_z=-0.024)
    assert goal_picture(scene_of(tip_z=-0.020), goal).vote is True
    assert goal_picture(scene_of(tip_z=-0.006), goal).vote is False
    assert goal_picture(scene_of(tip_z=-0.020, tilt_deg=7), goal).vote is False


# --- whether the wrist's compression can be believed ---------------------------------------------

HANGS = 0.193  # [m] of the hinge point above an upright peg's tip


def in_contact(felt: float, *, tip_z: float, z: float) -> Outcome:
    outcome = outcome_of(Formation.CONTACT, scene=scene_of(tip_z=tip_z))
    seen = replace(outcome.looks[0].observation, compression_m=felt, pose=Pose(z=z))
    looks = (replace(outcome.looks[0], observation=seen),)
    return replace(outcome, looks=looks)


def doubted(outcome: Outcome, *, answered: bool = True) -> str | None:
    return doubt(load_task("circle"), outcome, Belief(), shipped(), answered=answered)


def test_what_is_felt_is_held_against_the_tips_height_in_the_picture() -> None:
    assert doubted(in_contact(0.005, tip_z=0.0, z=HANGS - 0.005)) is None
    assert doubted(in_contact(0.003, tip_z=0.005, z=HANGS - 0.003)) is None  # slid in the grasp
    assert "is felt" in str(doubted(in_contact(0.006, tip_z=0.0, z=HANGS - 0.022)))
    unseen = replace(in_contact(0.0, tip_z=0.0, z=HANGS - 0.03))
    unseen = replace(unseen, looks=(replace(unseen.looks[0], scene=UNSEEN),))
    assert doubted(unseen) is None


@pytest.mark.parametrize(
    ("tip_z", "depth"), [(0.004, 0.0), (-0.002, 0.0), (-0.005, 0.005), (-0.017, 0.017)]
)
def test_how_deep_the_tip_is_in_the_hole_is_read_off_the_picture(
    tip_z: float, depth: float
) -> None:
    outcome = in_contact(0.0, tip_z=tip_z, z=HANGS)
    assert sunk(outcome.scene) == pytest.approx(depth, abs=1e-4)
    unseen = replace(outcome, looks=(replace(outcome.looks[0], scene=UNSEEN),))
    assert sunk(unseen.scene) is None


def test_a_peg_that_is_seen_higher_than_it_is_felt_has_slid_up_in_the_grasp() -> None:
    task, belief = load_task("circle"), Belief()
    for by, believed in ((0.0, 0.0), (0.004, 0.004), (0.030, 0.010), (-0.004, 0.0)):
        outcome = in_contact(0.003, tip_z=by, z=HANGS - 0.003)
        assert slid(task, outcome, belief, shipped()) == pytest.approx(believed, abs=0.0012)
    unseen = replace(outcome, looks=(replace(outcome.looks[0], scene=UNSEEN),))
    assert slid(task, unseen, belief, shipped()) is None


@pytest.mark.parametrize(("tip_z", "is_doubted"), [(0.0, True), (-0.010, False)])
def test_a_sensor_that_never_answered_is_excused_at_the_end_only_by_a_peg_in_the_hole(
    tip_z: float, is_doubted: bool
) -> None:
    contact = in_contact(0.0, tip_z=tip_z, z=HANGS - 0.005)
    assert doubted(contact, answered=False) is None
    inserting = replace(contact, step=replace(contact.step, formation=Formation.INSERTION))
    assert ("never answered" in str(doubted(inserting, answered=False))) is is_doubted
    assert doubted(inserting) is None
    unseen = replace(inserting, looks=(replace(inserting.looks[0], scene=UNSEEN),))
    assert "no picture shows" in str(doubted(unseen, answered=False))
    assert doubted(unseen) is None
