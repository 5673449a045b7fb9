"""What goes wrong on the upper levels goes wrong as it is drawn, and the physics bears it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from stand_ins import outcome_of, prepared, scene_of

from pliant.cell import Observation, Truth
from pliant.conditions import NOMINAL, QUANTITIES, Condition, Setup, condition
from pliant.experiment.misread import MISREAD_BY, Misread
from pliant.formations import Formation
from pliant.levels import load_level
from pliant.pose import Axis, Pose
from pliant.sim import replay
from pliant.sim.cell import SimCell, SimRobot
from pliant.sim.looks import looks_of
from pliant.sim.model import PEG
from pliant.sim.setup import STRIKE_S
from pliant.task import load_task
from pliant.vision.scene import Scene

SPEED, LIMIT = 0.05, 0.02


def go(robot: SimRobot, pose: Pose, limit: float = LIMIT) -> float:
    """The peak compression of a motion."""
    return robot.move_to(pose, speed_m_s=SPEED, stop_at_compression_m=limit).peak_compression_m


def side(robot: SimRobot) -> NDArray[np.float64]:
    return robot.observe().views["side"].image.astype(float)


# --- levels ------------------------------------------------------------------------------------


def test_a_level_widens_a_condition_of_the_papers_and_not_one_of_the_users() -> None:
    harsh = load_level("L6+")
    assert harsh.on(condition("all")).ranges["friction"] == (1.0, 10.0)
    own = Condition(name="slippery", ranges={"friction": (0.2, 0.4)})
    assert harsh.on(own).ranges["friction"] == (0.2, 0.4)


def test_the_last_level_draws_what_the_levels_it_joins_draw() -> None:
    last = load_level("L8")
    for name in ("L4", "L5", "L6"):
        assert set(load_level(name).ranges) <= set(last.ranges)
    assert (last.clearance, last.depth) == (0.0005, 0.025)


def test_a_level_below_looks_and_strikes_draws_none_of_them() -> None:
    setup = load_level("L4").on(condition("all")).draw(3)
    for name in ("looks", "occluder", "stale", "board_shift", "grasp_turn", "misread"):
        assert getattr(setup, name) == NOMINAL[name]


def test_what_a_seed_looks_like_is_the_same_on_every_level() -> None:
    one, two = (load_level(name).on(condition("all")).draw(5) for name in ("L5", "L8"))
    assert looks_of(one).noise == looks_of(two).noise
    assert np.array_equal(looks_of(one).paints["peg"].rgb, looks_of(two).paints["peg"].rgb)


# --- looks -------------------------------------------------------------------------------------


def test_random_looks_change_the_picture_and_neither_calibration_nor_physics() -> None:
    plain = prepared("square")
    before = plain.observe()
    robot = prepared("square", Setup(seed=4, looks=1.0))
    after = robot.observe()
    images = [o.views["side"].image.astype(float) for o in (before, after)]
    assert np.mean(np.abs(images[1] - images[0])) > 20
    for name in ("position", "rotation", "focal_px"):
        nominal, given = (getattr(o.views["side"].camera, name) for o in (before, after))
        assert np.array_equal(nominal, given)
    assert after.pose == before.pose


def test_a_trial_looks_as_it_did_when_it_is_repeated_and_plain_after_it() -> None:
    plain = side(prepared())
    setup = Setup(seed=11, looks=1.0, occluder=1.0)
    first, again = (side(prepared("circle", setup)) for _ in range(2))
    assert np.array_equal(first, again)
    assert np.array_equal(side(prepared()), plain)


def test_every_looks_lets_the_peg_and_the_block_be_told_from_what_is_around_them() -> None:
    for seed in range(50):
        paints = looks_of(Setup(seed=seed, looks=1.0)).paints
        for one, two in (("peg", "block"), ("peg", "backdrop"), ("block", "backdrop")):
            assert np.linalg.norm(paints[one].rgb - paints[two].rgb) >= 0.35


def test_cameras_are_elsewhere_by_millimetres_and_a_third_of_a_degree_at_most() -> None:
    for seed in range(50):
        for shift in looks_of(Setup(seed=seed, looks=1.0)).shifts.values():
            assert np.all(np.abs(shift.offset) <= (0.002, 0.002, 0.005))
            assert np.all(np.abs(shift.angles) <= math.radians(0.3))


def test_a_camera_that_is_elsewhere_sees_things_elsewhere() -> None:
    """The block's left edge in the picture, against where the nominal camera would see it."""
    setup = Setup(seed=2, looks=1.0)
    shift = looks_of(setup).shifts["side"]
    focal = 240 / math.tan(math.radians(7.5))
    distance = 1.2 - 0.06
    predicted = focal * (-shift.offset[0] / distance + shift.angles[1])
    at = [_left_edge(side(prepared("square", s))) for s in (Setup(seed=2), setup)]
    assert at[1] - at[0] == pytest.approx(predicted, abs=1.5)


def _left_edge(image: NDArray[np.float64]) -> float:
    """The column of the strongest upright edge around the block's left side, low in the picture."""
    rows = image[400:440, 190:260].mean(axis=0)
    return float(np.argmax(np.abs(np.diff(rows, axis=0)).sum(axis=1)))


@pytest.mark.parametrize("camera", ["side", "front"])
def test_a_post_hides_a_part_of_the_scene_and_never_all(camera: str) -> None:
    for seed in range(8):
        views = [
            prepared("square", Setup(seed=seed, occluder=on)).observe((camera,)).views[camera].image
            for on in (0.0, 1.0)
        ]
        hidden = np.any(views[0] != views[1], axis=2)
        block = np.all(np.abs(views[0].astype(int) - views[0][300, 320]) < 30, axis=2)
        assert 0 < np.mean(hidden[block]) < 0.3
        assert np.mean(hidden) < 0.1


def test_a_stale_picture_is_the_one_before_and_its_time_tells() -> None:
    robot = prepared("circle", Setup(seed=0, stale=0.3))
    views = []
    for _ in range(60):
        robot.settle(0.02)
        views.append((robot.clock(), robot.observe().views["side"]))
    stale = [n for n, (now, view) in enumerate(views) if view.time_s < now - 0.001]
    assert 9 <= len(stale) <= 27
    assert all(views[n][1] is views[n - 1][1] for n in stale)


@dataclass(frozen=True)
class Same:
    """A sight that always measures the same."""

    scene: Scene
    colours = None

    def __call__(self, observation: Observation) -> Scene:
        return self.scene


def test_a_misread_hole_is_10_mm_aside_in_pixels_too_and_as_often_as_drawn() -> None:
    scene = scene_of(hole_y=0.004)
    assert scene.hole is not None
    box = ((220.0, 240.0), (420.0, 240.0), (420.0, 470.0), (220.0, 470.0))
    hole = replace(scene.hole, box_px=box)
    scene = replace(scene, hole=hole)
    setup = Setup(seed=3, misread=0.2)
    look = outcome_of(Formation.FIT).looks[-1].observation
    misread = Misread(Same(scene), setup)
    read = [misread(look).hole for _ in range(400)]
    again = Misread(Same(scene), setup)
    assert [again(look).hole for _ in range(400)] == read
    off = [seen.y.value - 0.004 for seen in read if seen is not None]
    wrong = [o for o in off if o]
    assert 0.14 < len(wrong) / len(off) < 0.26
    assert {round(o, 9) for o in wrong} == {MISREAD_BY, -MISREAD_BY}
    shifted = next(seen for seen in read if seen is not None and seen.y.value > 0.01)
    assert shifted.center_px[0] - hole.center_px[0] == pytest.approx(0.01 / 0.12 * 200)
    assert Misread(Same(scene), Setup(seed=3))(look) is scene


# --- strikes -----------------------------------------------------------------------------------

STRIKES: Mapping[str, Mapping[str, float]] = {
    "board to +y": {"board_shift": 0.015, "board_shift_heading": math.pi / 2},
    "board to -x": {"board_shift": 0.015, "board_shift_heading": math.pi},
    "turn": {"grasp_turn": math.radians(8)},
    "turn back": {"grasp_turn": math.radians(-8)},
    "slide": {"grasp_slide": 0.005},
    "all": {
        "board_shift": 0.012,
        "board_shift_heading": -2.0,
        "grasp_turn": math.radians(6),
        "grasp_slide": 0.004,
    },
}


def test_a_strike_moves_board_and_peg_as_drawn_and_smoothly() -> None:
    setup = Setup(
        seed=0,
        struck_at=1.0,
        board_shift=0.01,
        board_shift_heading=math.atan2(0.6, 0.8),
        grasp_turn=math.radians(5),
        grasp_slide=0.004,
    )
    cell = SimCell()
    robot = cell.prepare(load_task("square"), setup)
    before, holes, slides = cell.truth(), [], []
    for _ in range(150):
        robot.settle(0.01)
        holes.append(robot.data.xpos[robot.board_body].copy())
        slides.append(float(np.linalg.norm(robot.model.body(PEG).pos - [0, 0, -0.099])))
    moved = np.linalg.norm(np.array(holes) - holes[0], axis=1)
    assert np.all(np.diff(moved) >= 0)
    assert np.max(np.diff(moved)) < 0.0006  # 60 mm/s
    assert np.count_nonzero(np.diff(moved)) == pytest.approx(STRIKE_S / 0.01, abs=2)
    assert holes[-1] - holes[0] == pytest.approx([0.008, 0.006, 0.0])
    assert slides[-1] == pytest.approx(0.004)
    after = cell.truth()
    assert after.hole_y - before.hole_y == pytest.approx(0.006)
    robot.settle(5.0)
    # The tool hangs from a hinge: its weight takes a part of the turn back.
    assert 0.02 < abs(cell.truth().tilt_rad - before.tilt_rad) < math.radians(5)
    assert cell.truth().tip[2] - before.tip[2] == pytest.approx(0.004, abs=0.001)


@cache
def _inserted(name: str) -> tuple[Truth, Truth, float, SimCell]:
    """The truth before and after a strike on a peg 15 mm deep in its hole, and the highest speed of
    any joint from the strike on."""
    cell = SimCell()
    robot = cell.prepare(load_task("square"), Setup(seed=0, struck_at=6.0, **STRIKES[name]))
    above = robot.task.tip_below_hinge
    go(robot, Pose(z=above + 0.01))
    robot.settle(1.0)
    go(robot, Pose(z=above - 0.024))
    robot.settle(6.0 - robot.clock())
    before, fastest = cell.truth(), 0.0
    while robot.clock() < 8.0:
        robot.settle(0.01)
        fastest = max(fastest, float(np.max(np.abs(robot.data.qvel))))
    return before, cell.truth(), fastest, cell


@pytest.mark.parametrize("name", STRIKES)
def test_a_strike_on_a_peg_in_its_hole_is_borne(name: str) -> None:
    before, after, fastest, _ = _inserted(name)
    assert before.inserted
    assert math.isfinite(after.depth_m)
    assert after.fit
    assert -0.02 < after.depth_m - before.depth_m < 0.002
    assert abs(after.tilt_rad) < math.radians(12)
    assert fastest < 6.0  # [rad/s, m/s] of the soft wrist; an unstable solver gives hundreds


@pytest.mark.parametrize("name", ["board to +y", "all"])
def test_a_struck_trial_is_drawn_again_as_it_was(name: str) -> None:
    _, _, _, cell = _inserted(name)
    trajectory = cell.trajectory()
    robot = cell.robot
    seen = side(robot)
    drawing = replay.Replay(robot.task, trajectory)
    again = drawing.image("side", len(drawing) - 1).astype(float)
    first = drawing.image("side", 0).astype(float)
    drawing.cameras.close()
    assert np.mean(np.abs(again - seen)) < 1.5
    assert np.mean(np.abs(first - seen)) > 5


def test_a_trajectory_stored_before_strikes_were_drawn_reads_back(tmp_path: Path) -> None:
    cell = SimCell()
    cell.prepare(load_task("square"), Setup(seed=1, hole_y=0.01))
    replay.save(tmp_path, cell.trajectory())
    with np.load(tmp_path / replay.FILE) as stored:
        old = {k: stored[k] for k in ("time_s", "qpos", "setup_seed", "setup_hole_y")}
    np.savez_compressed(tmp_path / replay.FILE, **old)
    assert replay.load(tmp_path).setup == Setup(seed=1, hole_y=0.01)


# --- the wrist ---------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_another_wrist_hangs_as_far_as_its_stiffness_lets_it(factor: float) -> None:
    robot = prepared("square", Setup(seed=0, wrist_stiffness=factor))
    stiffness = robot.task.wrist.stiffness_z * factor
    weight = 0.894 * 9.81
    slide = float(robot.data.qpos[robot.model.joint("wrist_z").qposadr[0]])
    assert -slide == pytest.approx(weight / stiffness, rel=0.02)
    assert list(robot.model.jnt_stiffness[-4:]) == pytest.approx(
        [factor * s for s in (1000.0, 0.5, 0.5, 5.0)]
    )
    assert list(prepared("square").model.jnt_stiffness[-4:]) == [1000.0, 0.5, 0.5, 5.0]


def test_a_noisy_sensor_reports_its_noise_and_the_truth_has_none() -> None:
    cell = SimCell()
    robot = cell.prepare(load_task("square"), Setup(seed=0, compression_noise=0.0003))
    read, true = [], []
    for _ in range(200):
        robot.settle(0.01)
        read.append(robot.observe(()).compression_m)
        true.append(cell.truth().compression_m)
    assert np.std(np.subtract(read, true)) == pytest.approx(0.0003, rel=0.15)
    assert np.std(true) < 0.00001
    quiet = cell.prepare(load_task("square"), Setup(seed=0))
    assert quiet.observe(()).compression_m == cell.truth().compression_m


def test_noise_neither_stops_a_free_motion_nor_lets_a_press_pass_its_limit() -> None:
    for seed in range(4):
        robot = prepared("square", Setup(seed=seed, compression_noise=0.0003))
        assert go(robot, Pose(y=0.04, z=0.25), limit=0.002) < 0.002
        go(robot, Pose(y=0.04, z=0.15), limit=0.006)
        assert robot.pressed() < 0.006 + 0.0025  # what the filter lags behind at 50 mm/s
        pressed = robot.pressed()
        go(robot, robot.set_point().updated({Axis.Z: robot.set_point().z + 0.005}), limit=0.006)
        assert robot.pressed() < pressed - 0.003


# --- quantities --------------------------------------------------------------------------------


def test_every_quantity_of_a_setup_is_described_and_nominal_by_itself() -> None:
    setup = Setup(seed=0)
    assert setup.quantities() == dict(NOMINAL)
    assert setup.disturbed() == {}
    for quantity in QUANTITIES.values():
        assert quantity.valid[0] <= quantity.nominal <= quantity.valid[1]
        assert quantity.meaning
