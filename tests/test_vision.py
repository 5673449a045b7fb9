"""Measurements against the truth of the rendered pictures they were made from."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import mujoco
import numpy as np
import pytest
from stand_ins import PEGS, cell_for, picture, prepared, seen, stand_peg

from pliant.cell import Truth, View
from pliant.conditions import Setup
from pliant.sim.cell import SimRobot
from pliant.sim.model import BOARD
from pliant.task import load_task
from pliant.vision.measure import measure
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Scene

PER_PEG = 24


@dataclass(frozen=True, eq=False)
class Sample:
    """A picture's measurement beside the truth of what was drawn."""

    kind: str
    truth: Truth
    peg: PegSeen
    hole: HoleSeen


@cache
def samples(peg: str) -> tuple[Sample, ...]:
    """The peg hanging over the board, leaning in the hole, and upright in it, at random."""
    rng = np.random.default_rng(11)
    found = []
    for i in range(PER_PEG):
        hole_y, grasp = rng.uniform(-0.02, 0.02), math.radians(rng.uniform(-5, 5))
        robot = prepared(peg, Setup(seed=i, hole_y=hole_y, grasp_roll=grasp))
        half = robot.task.peg.half_extents[1]
        kind = ("hanging", "leaning in", "upright in")[i % 3]
        if kind == "hanging":
            lean = math.radians(rng.uniform(-15, 15))
            y = rng.uniform(-0.05, 0.05)
            z = rng.uniform(0, 0.03) + half * abs(math.sin(lean))
        elif kind == "leaning in":
            lean = math.radians(rng.uniform(6, 16))
            y = hole_y - 0.001 - half + half * math.cos(lean)
            z = half * math.sin(lean) - rng.uniform(0.0, 0.006)
        else:
            lean = math.radians(rng.uniform(-1, 1))
            y = hole_y + rng.uniform(-0.001, 0.001)
            z = -rng.uniform(0, 0.025)
        stand_peg(robot, tip_y=y, tip_z=z, lean=lean)
        scene = seen(robot)
        assert scene.peg is not None, scene.problems
        assert scene.hole is not None, scene.problems
        assert scene.problems == ()
        found.append(Sample(kind=kind, truth=cell_for(peg).truth(), peg=scene.peg, hole=scene.hole))
    return tuple(found)


def pooled() -> Iterator[Sample]:
    for peg in PEGS:
        yield from samples(peg)


QUANTITIES: dict[str, tuple[Callable[[Sample], Measured], Callable[[Sample], float]]] = {
    "tip y": (lambda s: s.peg.tip_y, lambda s: s.truth.tip[1]),
    "tip z": (lambda s: s.peg.tip_z, lambda s: s.truth.tip[2]),
    "tilt": (lambda s: s.peg.tilt, lambda s: s.truth.tilt_rad),
    "hole y": (lambda s: s.hole.y, lambda s: s.truth.hole_y),
    "surface z": (lambda s: s.hole.surface_z, lambda s: 0.0),
}


# --- metres ------------------------------------------------------------------------------------


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_nine_in_ten_errors_lie_within_two_standard_deviations(quantity: str) -> None:
    measured, true = QUANTITIES[quantity]
    within = [abs(measured(s).value - true(s)) <= 2 * measured(s).sd for s in pooled()]
    assert np.mean(within) >= 0.9


def test_nine_in_ten_tilts_of_upright_pegs_lie_within_two_standard_deviations() -> None:
    within = [
        abs(s.peg.tilt.value - s.truth.tilt_rad) <= 2 * s.peg.tilt.sd
        for s in pooled()
        if s.kind == "upright in"
    ]
    assert np.mean(within) >= 0.9


@pytest.mark.parametrize(
    ("quantity", "most"),
    [("tip y", 0.0005), ("tip z", 0.0005), ("tilt", math.radians(0.4)), ("hole y", 0.0003)],
)
def test_an_uncertainty_is_not_so_large_that_it_says_nothing(quantity: str, most: float) -> None:
    measured, _ = QUANTITIES[quantity]
    assert all(0 < measured(s).sd <= most for s in pooled())


@pytest.mark.parametrize(
    ("quantity", "most"),
    [
        ("tip y", 0.001),
        ("tip z", 0.001),
        ("tilt", math.radians(0.8)),
        ("hole y", 0.0004),
        ("surface z", 0.0003),
    ],
)
def test_no_error_is_large(quantity: str, most: float) -> None:
    measured, true = QUANTITIES[quantity]
    assert max(abs(measured(s).value - true(s)) for s in pooled()) < most


@pytest.mark.parametrize("peg", PEGS)
def test_the_corners_are_the_pegs_own_also_where_the_hole_hides_them(peg: str) -> None:
    half = load_task(peg).peg.half_extents[1]
    for s in samples(peg):
        dy, dz = half * math.cos(s.truth.tilt_rad), half * math.sin(s.truth.tilt_rad)
        _, y, z = s.truth.tip
        assert (s.peg.left_y, s.peg.left_z) == pytest.approx((y - dy, z - dz), abs=0.001)
        assert (s.peg.right_y, s.peg.right_z) == pytest.approx((y + dy, z + dz), abs=0.001)


# --- pixels, as in the paper -------------------------------------------------------------------


@pytest.mark.parametrize("peg", PEGS)
def test_the_papers_quantities_are_right_to_the_pixel_for_a_free_peg(peg: str) -> None:
    robot = prepared(peg)
    for lean_deg in (-12, 0, 7):
        lean = math.radians(lean_deg)
        stand_peg(robot, tip_y=0.01, tip_z=0.02, lean=lean)
        view = picture(robot)
        found = measure(view, robot.task).peg
        assert found is not None
        middle = robot.task.peg.length / 2
        center = (0.0, 0.01 - middle * math.sin(lean), 0.02 + middle * math.cos(lean))
        assert found.center_px == pytest.approx(view.camera.project(np.array(center)), abs=4.0)
        assert found.tilt_deg == pytest.approx(lean_deg, abs=1.2)


def test_h_center_is_the_blocks_middle_in_the_picture() -> None:
    robot = prepared("circle", Setup(seed=0, hole_y=0.017))
    view = picture(robot)
    hole = measure(view, robot.task).hole
    assert hole is not None
    front = view.camera.project(np.array([0.06, 0.017, -0.07]))
    assert hole.center_px == pytest.approx(front, abs=1.5)


def test_a_measurement_carries_the_time_of_its_picture() -> None:
    robot = prepared()
    robot.settle(0.5)
    view = picture(robot)
    assert measure(view, robot.task).time_s == view.time_s == robot.clock()


def test_measuring_leaves_the_picture_alone() -> None:
    robot = prepared()
    view = picture(robot)
    before = view.image.copy()
    measure(view, robot.task)
    assert np.array_equal(view.image, before)


# --- what cannot be measured -------------------------------------------------------------------


def edited(robot: SimRobot, change: Callable[[np.ndarray], None]) -> Scene:
    view = picture(robot)
    image = view.image.copy()
    change(image)
    return measure(View(camera=view.camera, time_s=view.time_s, image=image), robot.task)


def paint(rows: slice, columns: slice) -> Callable[[np.ndarray], None]:
    """Hide a part of the picture behind something grey."""

    def change(image: np.ndarray) -> None:
        image[rows, columns] = 128

    return change


def no_peg(scene: Scene, because: str) -> None:
    assert scene.peg is None
    assert any(p.startswith("no peg") and because in p for p in scene.problems), scene.problems


def no_hole(scene: Scene, because: str) -> None:
    assert scene.hole is None
    assert any(p.startswith("no hole") and because in p for p in scene.problems), scene.problems


def test_a_peg_out_of_the_picture_is_not_found_but_the_hole_is() -> None:
    robot = prepared()
    stand_peg(robot, tip_y=0.0, tip_z=0.18, lean=0.0)
    scene = seen(robot)
    no_peg(scene, "no cyan region")
    assert scene.hole is not None


@pytest.mark.parametrize(("y", "z"), [(0.0, 0.10), (0.205, 0.02), (-0.205, 0.02)])
def test_a_peg_cut_off_by_the_pictures_border_is_not_measured(y: float, z: float) -> None:
    robot = prepared()
    stand_peg(robot, tip_y=y, tip_z=z, lean=0.0)
    no_peg(seen(robot), "cut off")


def test_a_peg_cut_off_below_is_not_measured() -> None:
    robot = prepared()
    view = picture(robot)
    cut = View(camera=view.camera, time_s=0.0, image=np.roll(view.image, 340, axis=0))
    no_peg(measure(cut, robot.task), "cut off")


def test_a_peg_of_which_hardly_anything_shows_is_not_measured() -> None:
    robot = prepared()
    stand_peg(robot, tip_y=0.0, tip_z=0.02, lean=0.0)
    top = int(np.nonzero(cyan(robot))[0].min())
    no_peg(edited(robot, paint(slice(top + 15, 480), slice(0, 640))), "long edges")


def cyan(robot: SimRobot) -> np.ndarray:
    hsv = cv2.cvtColor(picture(robot).image, cv2.COLOR_RGB2HSV)
    return np.asarray((hsv[..., 0] > 80) & (hsv[..., 0] < 97) & (hsv[..., 1] > 110))


def test_a_block_that_is_not_red_is_not_found() -> None:
    robot = prepared()
    model = robot.model
    board = [i for i in range(model.ngeom) if model.geom(i).name.startswith(BOARD)]
    colour = model.geom_rgba[board].copy()
    model.geom_rgba[board] = [0.5, 0.5, 0.5, 1.0]
    try:
        scene = seen(robot)
    finally:
        model.geom_rgba[board] = colour
    no_hole(scene, "no red region")
    assert scene.peg is not None


@pytest.mark.parametrize("y", [-0.16, 0.16])
def test_a_block_cut_off_by_the_pictures_border_is_not_measured(y: float) -> None:
    robot = prepared()
    robot.model.body(BOARD).pos[1] = y
    mujoco.mj_forward(robot.model, robot.data)
    no_hole(seen(robot), "cut off")


def test_a_block_whose_sides_are_hidden_is_not_measured() -> None:
    robot = prepared()
    no_hole(edited(robot, paint(slice(256, 480), slice(0, 640))), "edges are not visible")


def test_an_empty_picture_says_that_both_are_missing() -> None:
    robot = prepared()
    scene = edited(robot, paint(slice(0, 480), slice(0, 640)))
    no_peg(scene, "no cyan region")
    no_hole(scene, "no red region")


@pytest.mark.parametrize("seed", range(8))
def test_noise_is_measured_or_refused_with_a_reason_but_never_an_error(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def garble(image: np.ndarray) -> None:
        for _ in range(60):
            row, column = rng.integers(0, 440), rng.integers(0, 600)
            image[row : row + 40, column : column + 40] = rng.integers(0, 256, 3)

    scene = edited(prepared(), garble)
    assert (scene.peg is None or scene.hole is None) == bool(scene.problems)
