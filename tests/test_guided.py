"""Skills guided by what is seen and felt: how they move, what they believe, what they insert."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stand_ins import ScriptedRobot, executed, outcome_of, scene_of
from vlm_cases import blind, wedged

from pliant.belief import Belief, Seen
from pliant.cell import Stop
from pliant.conditions import condition
from pliant.errors import InputError, RobotFault
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.levels import load_level
from pliant.methods.guided import Guided
from pliant.methods.guided.hand import Hand, HandFrame, Manner
from pliant.methods.guided.touch import placed
from pliant.methods.named import method
from pliant.pose import Axis, Pose
from pliant.reasoners.rules import Rules
from pliant.records import Look, Trial
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.scene import HoleSeen, Measured, Scene

TEACHING = shipped()
GUIDED = Guided()
FIT, CONTACT = (TEACHING.goals.step(f) for f in (Formation.FIT, Formation.CONTACT))


def hole_at(y: float) -> Seen:
    sd = 0.0002
    hole = HoleSeen(
        box_px=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
        center_px=(0.5, 0.5),
        y=Measured(value=y, sd=sd),
        surface_z=Measured(value=0.0, sd=sd),
    )
    return Seen(step=FIT, pose=Pose(), scene=Scene(peg=None, hole=hole))


def hole_y(*readings: float, by: Guided = GUIDED) -> float:
    belief = Belief()
    for y in readings:
        belief = by.believe(belief, hole_at(y), TEACHING)
    found = belief.hole_y
    assert found is not None
    return found.value


# --- belief --------------------------------------------------------------------------------------


def test_from_fit_on_the_hole_is_looked_for_where_the_step_says() -> None:
    aside = replace(FIT, goal={Axis.Y: FIT.goal[Axis.Y] + 0.010}, retreat=True)
    belief = GUIDED.believe(Belief(), hole_at(0.002), TEACHING)
    for step, y in ((aside, 0.012), (CONTACT, 0.012), (FIT, 0.002)):
        belief = GUIDED.believe(belief, replace(hole_at(0.002), step=step), TEACHING)
        assert belief.hole_y is not None
        assert belief.hole_y.value == pytest.approx(y)


@given(
    st.lists(st.floats(-0.0004, 0.0004), min_size=3, max_size=12),
    st.integers(0, 11),
    st.sampled_from([-0.010, 0.010]),
)
def test_one_wrong_reading_does_not_poison_the_belief(
    noise: list[float], when: int, wrong: float
) -> None:
    readings = [0.005 + n for n in noise]
    readings.insert(max(1, min(when, len(readings))), 0.005 + wrong)
    assert abs(hole_y(*readings) - 0.005) < 0.001


def test_a_board_that_has_moved_is_believed_once_three_readings_agree() -> None:
    before = [0.0] * 6
    assert hole_y(*before, 0.012) == pytest.approx(0.0)
    assert hole_y(*before, 0.012, 0.0121) == pytest.approx(0.0)
    assert hole_y(*before, 0.012, 0.0121, 0.0119) == pytest.approx(0.012, abs=0.0002)


def test_the_checks_take_the_hole_where_it_is_believed_to_be() -> None:
    belief = Belief()
    for y in (0.0, 0.0001, -0.0001):
        belief = GUIDED.believe(belief, hole_at(y), TEACHING)
    look = outcome_of(Formation.CONTACT, scene=hole_at(0.010).scene).looks[-1]
    hole = placed(load_task("circle"), TEACHING, look, belief).hole
    assert hole is not None
    assert abs(hole.y.value) < 0.0002


# --- motion --------------------------------------------------------------------------------------


@given(
    *(st.floats(-0.02, 0.02) for _ in range(3)),
    st.floats(-0.3, 0.3),
    *(st.floats(-0.05, 0.05) for _ in range(3)),
)
def test_the_holes_frame_and_the_task_frame_are_each_others_inverse(
    x: float, y: float, z: float, yaw: float, a: float, b: float, c: float
) -> None:
    frame = HandFrame(x=x, y=y, z=z, yaw=yaw)
    pose = Pose(x=a, y=b, z=c, roll=0.1, yaw=0.05)
    back = frame.outside(frame.inside(pose))
    assert np.allclose(back.position(), pose.position(), atol=1e-12)
    assert math.isclose(back.yaw, pose.yaw, abs_tol=1e-12)
    inside = frame.inside(pose)
    assert np.allclose(frame.point(inside.position()), pose.position(), atol=1e-12)


# --- trials --------------------------------------------------------------------------------------


def inserted(
    level: str, peg: str, seed: int, reasoner: str = "rules", by: str | None = None
) -> Trial:
    rung = load_level(level)
    spec = Spec(
        task=load_task(peg, level),
        level=level,
        condition=rung.on(condition("all")),
        seed=seed,
        reasoner=reasoner,
        method=by or rung.method,
    )
    return perform(spec, SimCell(), TEACHING)


@pytest.fixture(scope="module")
def spatial() -> Trial:
    return inserted("L4", "square", 9001)


def test_a_turned_board_and_a_tilted_grasp_are_met_on_all_six_axes(spatial: Trial) -> None:
    assert spatial.inserted
    assert spatial.judged
    assert spatial.method == "guided"
    drawn, ended = spatial.drawn, spatial.executions[-1].outcome.pose
    assert ended.yaw == pytest.approx(drawn["board_yaw"], abs=math.radians(1))
    belief = spatial.executions[-1].belief
    assert belief.hole_x is not None
    assert belief.hole_x.value == pytest.approx(drawn["hole_x"], abs=0.001)


def test_a_guarded_motion_that_touches_is_no_compression_stop(spatial: Trial) -> None:
    contact = spatial.executions[1].outcome
    assert contact.motions[0].stop is Stop.TOUCH
    assert contact.stop is Stop.REACHED


def test_everything_a_guided_skill_commands_lies_in_the_workspace(spatial: Trial) -> None:
    from pliant.envelope import Limits

    for execution in spatial.executions:
        for motion in execution.outcome.motions:
            assert Limits().within(motion.commanded) == motion.commanded


def test_a_tight_hole_is_entered_without_any_recovery() -> None:
    trial = inserted("L1", "circle", 9003, reasoner="none")
    assert trial.inserted
    assert len(trial.executions) == len(Formation)


def test_the_same_seed_gives_the_same_guided_trial() -> None:
    one, other = (inserted("L1", "rectangle_narrow", 9002) for _ in range(2))
    targets = [[e.outcome.target for e in trial.executions] for trial in (one, other)]
    assert targets[0] == targets[1]
    assert one.truths == other.truths


def test_where_colours_are_anything_edges_do() -> None:
    trial = inserted("L5", "circle", 9001)
    assert trial.drawn["looks"] == 1.0
    assert trial.inserted


def test_a_strike_in_the_middle_is_survived() -> None:
    trial = inserted("L6", "square", 9002)
    assert trial.drawn["board_shift"] >= 0.005
    assert trial.inserted


@pytest.mark.parametrize(
    ("level", "peg", "seed"),
    [
        ("L7", "plug_x", 9104),  # stands astride the near rim until it is slid to the far wall
        ("L6", "circle", 40020),  # turns in the grasp after it was last seen hanging
        ("L8", "circle", 9142),  # so deep that the robot's own edges may be taken for its top
    ],
)
def test_what_once_ended_without_success_is_inserted_and_judged_so(
    level: str, peg: str, seed: int
) -> None:
    trial = inserted(level, peg, seed)
    assert trial.inserted
    assert trial.judged


@pytest.mark.parametrize(("unseen", "stops"), [(1, False), (3, False), (4, True), (7, True)])
def test_the_rules_stop_when_four_executions_in_a_row_show_too_little(
    unseen: int, stops: bool
) -> None:
    case = replace(blind(), method=GUIDED)
    case = replace(case, history=(executed(case),) * (unseen - 1))
    recovery = Rules().recover(case, Rules().judge(case))
    assert recovery is not None
    assert (recovery.steps == ()) is stops


def test_one_picture_that_shows_enough_lets_the_rules_go_on() -> None:
    case, seen = replace(blind(), method=GUIDED), wedged()
    case = replace(case, history=(executed(case), executed(case), executed(seen), executed(case)))
    recovery = Rules().recover(case, Rules().judge(case))
    assert recovery is not None
    assert recovery.steps[0].retreat


def test_without_a_mechanism_a_trial_says_so_and_does_not_use_it() -> None:
    def turned(trial: Trial) -> int:
        """Motions that turn the hand about z alone."""
        motions = [m for e in trial.executions for m in e.outcome.motions]
        pairs = pairwise(motions)
        return sum(
            a.requested.yaw != b.requested.yaw
            and np.allclose(a.requested.position(), b.requested.position())
            for a, b in pairs
        )

    whole, without = (
        inserted("L1", "circle", 9003),
        inserted("L1", "circle", 9003, by="guided-dither-ease"),
    )
    assert without.method == "guided-dither-ease"
    assert turned(whole) > 0
    assert turned(without) == 0


def test_without_the_median_the_last_reading_decides() -> None:
    readings = (0.005, 0.005, 0.005, 0.015)
    assert hole_y(*readings, by=Guided(frozenset({"median"}))) == 0.015


@pytest.mark.parametrize(
    ("name", "said"), [("agile", "guided"), ("guided-magic", "dither"), ("planar-ease", "guided")]
)
def test_methods_that_there_are_not_are_refused_with_those_that_there_are(
    name: str, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        method(name)


# --- what a touch is held against ----------------------------------------------------------------


HOLE_Y = Measured(value=0.0, sd=0.0002)


def hand_at(robot: ScriptedRobot, surface_z: float = 0.0, scene: Scene | None = None) -> Hand:
    belief = Belief(hole_y=HOLE_Y, surface_z=Measured(value=surface_z, sd=0.0002))
    task = load_task("square", "L1")

    def look(cameras: Sequence[str] = ("side",)) -> Look:
        assert scene is not None, "nothing is looked at"
        return Look(observation=robot.observe(cameras), scene=scene)

    return Hand(Manner(), task, TEACHING, robot, look, CONTACT, belief)


def test_a_descent_that_meets_nothing_is_a_fault() -> None:
    robot = ScriptedRobot(pose=Pose(z=0.22))
    with pytest.raises(RobotFault, match=r"nothing was felt down to 160\.0 mm") as fault:
        hand_at(robot, scene=scene_of(tip_z=0.0)).down(0.06, 0.004)
    assert fault.value.kind == "no_touch"
    hand_at(robot, scene=scene_of(tip_z=-0.008)).down(0.06, 0.004)  # went in without a touch
    touching = ScriptedRobot(pose=Pose(z=0.22), blocked_below=0.19)
    hand = hand_at(touching)
    hand.down(0.06, 0.004)
    assert hand.motions[-1].stop is Stop.TOUCH


@pytest.mark.parametrize(("surface_z", "hangs"), [(0.0, True), (0.030, True), (0.042, False)])
def test_a_hand_that_is_too_low_for_its_peg_to_hang_does_not_tare(
    surface_z: float, hangs: bool
) -> None:
    robot = ScriptedRobot(pose=Pose(z=0.22))
    if hangs:
        hand_at(robot, surface_z).tare()
    else:
        with pytest.raises(RobotFault, match="too low for the peg to hang freely"):
            hand_at(robot, surface_z).tare()
    assert robot.calls.count("tare") == hangs
