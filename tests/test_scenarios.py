"""Scenarios, in which the task itself is wrong: that it is really so in the cell and in its
pictures, that it is gone in the next trial, and how its trials are counted."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from stand_ins import prepared

from pliant import run
from pliant.conditions import NOMINAL, Condition, Setup, condition
from pliant.diagnosis import Hypothesis
from pliant.errors import RobotFault
from pliant.experiment import ladder, tables_text
from pliant.experiment.misread import Misread
from pliant.experiment.one import Spec, perform
from pliant.levels import EITHER, STOP, load_level, shipped_levels
from pliant.pose import Pose
from pliant.records import End
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.measure import measure
from pliant.vision.scene import Scene
from pliant.vision.sight import ByColour

SCENARIOS = [level for level in shipped_levels().values() if level.is_scenario]
DEEP_M = 0.012  # commanded below the surface
LIMIT_M = 0.030


def pushed(setup: Setup, peg: str = "square", *, y: float = 0.0) -> SimRobot:
    """The robot after it went straight down over the hole, upright."""
    robot = prepared(peg, setup)
    below = robot.task.tip_below_hinge
    for z, speed in ((below + 0.005, 0.1), (below - DEEP_M, 0.02)):
        robot.move_to(Pose(y=y, z=z), speed_m_s=speed, stop_at_compression_m=LIMIT_M)
    robot.settle(0.3)
    return robot


def tip_z(robot: SimRobot) -> float:
    return float(robot.data.site_xpos[robot.tip_site][2])


def image(robot: SimRobot, camera: str) -> NDArray[np.float64]:
    return robot.observe((camera,)).views[camera].image.astype(float)


def grey(robot: SimRobot, camera: str) -> int:
    """Pixels of steel amid the block's red, near the picture's middle."""
    r, g, b = np.moveaxis(image(robot, camera)[150:330, 220:420], 2, 0)
    return int(np.sum((abs(r - g) < 25) & (abs(g - b) < 25) & (r < 170) & (r > 60)))


# --- in the cell ---------------------------------------------------------------------------------


def test_without_anything_strange_the_peg_goes_in() -> None:
    assert tip_z(pushed(Setup(seed=1))) < -0.009


@pytest.mark.parametrize("peg", ["circle", "square"])
def test_a_peg_that_is_too_wide_stands_on_the_board_and_looks_right_from_the_side(
    peg: str,
) -> None:
    wrong = Setup(seed=1, peg_wider=0.006)
    robot = pushed(wrong, peg)
    assert tip_z(robot) > -0.0005
    assert robot.pressed() > 0.008
    shown = [
        measure(prepared(peg, s).observe().views["side"], load_task(peg)).peg
        for s in (Setup(seed=1), wrong)
    ]
    right, other = shown
    assert right is not None
    assert other is not None
    assert other.tip_y.value == pytest.approx(right.tip_y.value, abs=0.002)
    front = [image(prepared(peg, s), "front") for s in (Setup(seed=1), wrong)]
    assert np.mean(np.abs(front[0] - front[1])) > 0.3


def test_a_gripper_without_a_peg_touches_nothing_and_never_inserts() -> None:
    cell = SimCell()
    task = load_task("square")
    robot = cell.prepare(task, Setup(seed=1, peg_missing=1.0))
    seen = measure(robot.observe().views["side"], task)
    assert seen.peg is None
    assert seen.hole is not None
    robot.move_to(
        Pose(z=task.tip_below_hinge - 0.015), speed_m_s=0.1, stop_at_compression_m=LIMIT_M
    )
    truth = cell.truth()
    assert truth.depth_m > task.depth
    assert abs(truth.compression_m) < 0.001
    assert not truth.inserted
    assert truth.fit is False


@pytest.mark.parametrize("depth", [0.002, 0.007])
def test_a_plug_stops_the_peg_where_it_begins(depth: float) -> None:
    assert tip_z(pushed(Setup(seed=1, plugged_at=depth))) == pytest.approx(-depth, abs=0.0005)
    with_plug, without = (prepared("square", Setup(seed=1, plugged_at=d)) for d in (depth, 0.0))
    assert image(with_plug, "side").shape == image(without, "side").shape


def test_a_plug_is_seen_from_above_and_not_from_the_side() -> None:
    pictures = {}
    for depth in (0.0, 0.004):
        robot = prepared("square", Setup(seed=1, plugged_at=depth))
        robot.move_to(Pose(y=0.05, z=0.3), speed_m_s=0.2, stop_at_compression_m=LIMIT_M)
        pictures[depth] = {name: image(robot, name) for name in ("side", "oblique")}
    assert np.array_equal(pictures[0.0]["side"], pictures[0.004]["side"])
    assert np.max(np.abs(pictures[0.0]["oblique"] - pictures[0.004]["oblique"])) > 50


def test_a_bar_across_the_hole_holds_the_peg_up_and_one_beside_it_does_not() -> None:
    assert tip_z(pushed(Setup(seed=1, bar_height=0.004, bar_y=0.003))) == pytest.approx(
        0.004, abs=0.0005
    )
    assert tip_z(pushed(Setup(seed=1, bar_height=0.004, bar_y=0.028))) < -0.009


def test_a_bar_lies_where_the_hole_is() -> None:
    setup = Setup(seed=1, bar_height=0.005, hole_y=0.015, hole_x=0.004, board_z=0.006)
    assert tip_z(pushed(setup, y=0.015)) == pytest.approx(0.011, abs=0.0005)


def test_a_dead_sensor_reads_nothing_and_is_found_within_its_first_motion() -> None:
    setup = Setup(seed=1, compression_dead=1.0, bar_height=0.02)
    with pytest.raises(RobotFault, match="for a whole motion") as fault:
        pushed(setup)
    assert fault.value.kind == "sensor"


def test_a_dead_sensor_that_trembles_is_found_when_nothing_is_touched() -> None:
    ranges = {"compression_dead": (1.0, 1.0), "compression_noise": (0.0003, 0.0003)}
    spec = Spec(
        task=load_task("square", "dead_sensor"),
        condition=Condition(name="trembling", ranges=ranges),
        seed=2,
        reasoner="rules",
        method="guided",
    )
    cell = SimCell()
    ended = perform(spec, cell, shipped())
    assert ended.end_reason == "fault:no_touch"
    assert cell.truth().compression_m < 0.020


def test_a_lying_camera_moves_every_reading_by_the_same() -> None:
    setup = Setup(seed=3, hole_misread=-0.009)
    robot = prepared("square", setup)
    sight = ByColour(robot.task)
    read = Misread(sight, setup)
    look = robot.observe()
    truly = sight(look)
    for _ in range(5):
        seen: Scene = read(look)
        assert seen.hole is not None
        assert truly.hole is not None
        assert seen.hole.y.value - truly.hole.y.value == pytest.approx(-0.009)
        assert seen.peg == truly.peg


@pytest.mark.parametrize("peg", ["square", "rectangle_narrow"])
def test_a_peg_that_is_turned_in_the_grasp_looks_wider_and_is_told(peg: str) -> None:
    trial = run(level="turned_peg", peg=peg, seed=43001)
    assert trial.end_reason == End.STOPPED
    assert trial.diagnosis is not None
    assert trial.diagnosis.leading is Hypothesis.PEG_OTHER
    assert "wider" in trial.diagnosis.why


def test_nothing_strange_is_left_in_the_next_trial() -> None:
    before = pushed(Setup(seed=2))
    qpos, picture = before.data.qpos.copy(), image(before, "oblique")
    strange = Setup(seed=2, peg_missing=1.0, peg_wider=0.01, plugged_at=0.003, bar_height=0.01)
    assert not np.array_equal(image(pushed(strange), "oblique"), picture)
    after = pushed(Setup(seed=2))
    assert np.array_equal(after.data.qpos, qpos)
    assert np.array_equal(image(after, "oblique"), picture)


# --- as data -------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", SCENARIOS, ids=lambda level: level.name)
def test_every_scenario_is_strange_and_says_what_is_right(level: Any) -> None:
    assert level.right in (STOP, EITHER) or level.truly == (Hypothesis.AS_TOLD,)  # a near miss
    assert level.method == "guided"
    papers = set(condition("all").ranges)
    drawn = level.on(condition("all")).draw(1).disturbed()
    assert set(drawn) - papers or level.ranges["friction"][0] > 5.0
    assert all(NOMINAL[name] != value for name, value in drawn.items())


def test_a_bar_beside_the_hole_leaves_it_free() -> None:
    near = min(map(abs, load_level("bar_beside").ranges["bar_y"]))
    for peg in load_level("bar_beside").pegs:
        task = load_task(peg, "bar_beside")
        rim = task.peg.half_extents[1] + task.hole.clearance / 2
        assert near - 0.006 - rim > 0.0015


def trial(scenario: str, end: str, *, inserted: bool = False) -> dict[str, object]:
    return {
        "level": scenario,
        "method": "guided",
        "reasoner": "rules",
        "peg": "circle",
        "judged": end is End.INSERTED,
        "inserted": inserted,
        "end_reason": str(end),
        "moves": 40,
        "executions": 5,
        "simulated_s": 30.0,
        "decisions": 0,
        "own": 0,
        "failure_kind": None,
    }


def test_what_is_right_is_counted_and_a_false_accept_is_not() -> None:
    ends = [
        trial("blocked_hole", End.STOPPED),
        trial("blocked_hole", End.CAP),
        trial("blocked_hole", End.EXHAUSTED),
        trial("blocked_hole", End.INSERTED),
        trial("lying_camera", End.STOPPED),
        trial("lying_camera", End.INSERTED, inserted=True),
        trial("lying_camera", End.INSERTED),
        trial("dead_sensor", "fault:sensor"),
        trial("dead_sensor", "fault:camera"),
        trial("L1", End.INSERTED, inserted=True),
    ]
    blocked, lying, dead = ladder.scenarios(ends)
    assert (dead["rightly"]["successes"], dead["stopped"]["successes"]) == (1, 1)
    assert blocked["rightly"]["successes"] == 1
    assert [blocked[n]["successes"] for n in ("stopped", "cap", "exhausted", "false_accepts")] == [
        1
    ] * 4
    assert (lying["rightly"]["successes"], lying["rightly"]["n"]) == (2, 3)
    assert [row["level"] for row in ladder.rows(ends)] == ["L1"]
    assert "| blocked_hole | rules | stop | 25.0 [" in tables_text.scenarios([blocked])
    assert math.isclose(blocked["rightly"]["percent"], 25.0)


# --- a level on which some trials have a scenario ------------------------------------------------


def test_every_other_trial_of_l9_has_a_scenario_whose_ranges_go_first() -> None:
    level = load_level("L9")
    drawn = level.on(condition("all"))
    names = [drawn.scenario(seed) for seed in range(400)]
    assert 160 < names.count(None) < 240
    assert set(names) - {None} == set(level.scenarios)
    for seed, name in enumerate(names[:100]):
        here, plain = drawn.draw(seed), load_level("L8").on(condition("all")).draw(seed)
        own = {} if name is None else load_level(name).ranges
        assert all(abs(getattr(here, q)) >= low for q, (low, _) in own.items() if low > 0)
        same = set(NOMINAL) - set(own)
        assert {q: getattr(here, q) for q in same} == {q: getattr(plain, q) for q in same}
        assert level.in_trial(seed).name == (name or "L9")


def test_the_task_of_l9_does_not_tell_whether_it_has_a_scenario() -> None:
    assert load_task("circle", "L9") == load_task("circle", "L8")


def test_what_is_right_on_l9_is_told_trial_by_trial() -> None:
    level = load_level("L9")
    ends = []
    for seed in range(40):
        right = level.in_trial(seed).right
        end = End.STOPPED if right == STOP else End.INSERTED
        ends.append(trial("L9", end, inserted=right != STOP) | {"seed": seed})
    (row,) = ladder.scenarios(ends)
    assert (row["rightly"]["successes"], row["rightly"]["n"]) == (40, 40)
    assert 0 < row["stopped"]["successes"] < 20
    assert "| L9 | rules | by trial | 100.0 [" in tables_text.scenarios([row])
    wrong = [t | {"end_reason": str(End.CAP), "judged": False, "inserted": False} for t in ends]
    assert ladder.scenarios(wrong)[0]["rightly"]["successes"] == 0
    assert ladder.rows(ends) == []
