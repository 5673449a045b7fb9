"""What edges measure, without colour, against the truth of pictures with random looks."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from stand_ins import PEGS, cell_for, prepared, stand_peg

from pliant.cell import Truth, View
from pliant.conditions import Setup, condition
from pliant.levels import load_level
from pliant.pose import Pose
from pliant.sim.cell import SimRobot
from pliant.task import load_task
from pliant.vision.edges import Aside, measure_edges
from pliant.vision.measure import measure
from pliant.vision.offset import UNKNOWN, Offset, hanging_tip, offset_between
from pliant.vision.outline import board_outline
from pliant.vision.scene import Measured, Scene

PER_PEG = 24
HANG_SHARE, SAG_M = 0.537, 0.0088  # of the nominal wrist and tool


@dataclass(frozen=True, eq=False)
class Sample:
    """A picture's measurement, with the offset that a picture at Approach gave, and the truth."""

    scene: Scene
    truth: Truth
    offset: Offset
    level: str


def approach(robot: SimRobot) -> Scene:
    """The peg hangs 30 mm above the board; measured without an offset."""
    above = Pose(y=-0.026, z=robot.task.tip_below_hinge + 0.03, roll=math.radians(10))
    robot.move_to(above, speed_m_s=0.05, stop_at_compression_m=0.02)
    robot.settle(4.0)
    return by_edges(robot)


def by_edges(robot: SimRobot, **known: Any) -> Scene:
    """What the side camera sees now, with the compression as a cell would have it."""
    seen = robot.observe()
    pressed = seen.compression_m - SAG_M
    return measure_edges(seen.views["side"], robot.task, seen.pose, pressed=pressed, **known)


def calibrated(robot: SimRobot) -> Offset:
    """What a camera is off, seen at Approach."""
    scene = approach(robot)
    if scene.peg is None:
        return UNKNOWN
    known = hanging_tip(
        robot.task, robot.pose(), scene.peg.tilt, hang_share=HANG_SHARE, sag_m=SAG_M
    )
    return offset_between(known, scene.peg)


def place_at_random(robot: SimRobot, rng: np.random.Generator, kind: int) -> None:
    """The peg over the board, leaning in the hole, or upright in it."""
    half, hole_y = robot.task.peg.half_extents[1], robot.setup.hole_y
    if kind == 0:
        lean, y = math.radians(rng.uniform(-15, 15)), rng.uniform(-0.05, 0.05)
        z = rng.uniform(0, 0.03) + half * abs(math.sin(lean))
    elif kind == 1:
        lean = math.radians(rng.uniform(6, 16))
        y = hole_y - 0.001 - half + half * math.cos(lean)
        z = half * math.sin(lean) - rng.uniform(0.0, 0.006)
    else:
        lean = math.radians(rng.uniform(-1, 1))
        y, z = hole_y + rng.uniform(-0.001, 0.001), -rng.uniform(0, 0.025)
    stand_peg(robot, tip_y=y, tip_z=z, lean=lean)
    robot.data.time += 1.0  # another moment, with noise of its own


@cache
def samples(level: str) -> tuple[Sample, ...]:
    found = []
    drawing = load_level(level).on(condition("all"))
    for n, peg in enumerate(PEGS):
        for seed in range(500 + n * PER_PEG, 500 + (n + 1) * PER_PEG):  # other looks for each peg
            robot = prepared(peg, replace(drawing.draw(seed), stale=0.0))
            offset = calibrated(robot)
            place_at_random(robot, np.random.default_rng([seed, 7]), seed % 3)
            scene = by_edges(robot, offset=offset)
            truth = cell_for(peg).truth()
            found.append(Sample(scene=scene, truth=truth, offset=offset, level=level))
    return tuple(found)


Error = Callable[[Sample], tuple[float, float]]  # (error, standard deviation)


def of(value: Measured, true: float) -> tuple[float, float]:
    return value.value - true, value.sd


def relative_hole(sample: Sample) -> tuple[float, float]:
    """Of the hole from the tip along y: the offset cancels, and what is not known of it."""
    peg, hole = sample.scene.peg, sample.scene.hole
    assert peg is not None
    assert hole is not None
    truth = sample.truth
    error = hole.y.value - peg.tip_y.value - (truth.hole_y - truth.tip[1])
    return error, math.sqrt(peg.tip_y.sd**2 + hole.y.sd**2 - 2 * sample.offset.y.sd**2)


ERRORS: dict[str, Error] = {
    "tip y": lambda s: of(s.scene.peg.tip_y, s.truth.tip[1]),  # type: ignore[union-attr]
    "tip z": lambda s: of(s.scene.peg.tip_z, s.truth.tip[2]),  # type: ignore[union-attr]
    "tilt": lambda s: of(s.scene.peg.tilt, s.truth.tilt_rad),  # type: ignore[union-attr]
    "hole from the tip": relative_hole,
}


def whole(level: str) -> Iterator[Sample]:
    return (s for s in samples(level) if s.scene.peg is not None and s.scene.hole is not None)


@pytest.mark.parametrize("level", ["L5", "L5+"])
def test_peg_and_hole_are_found_in_nearly_every_picture_whatever_it_looks_like(level: str) -> None:
    assert len(list(whole(level))) >= 0.95 * len(samples(level))


@pytest.mark.parametrize("level", ["L5", "L5+"])
@pytest.mark.parametrize("name", ERRORS)
def test_an_interval_of_95_percent_holds_the_truth_as_often_as_it_says(
    name: str, level: str
) -> None:
    """Within what a small sample allows: for 90 %, 83 % of 72."""
    within = [abs(e) <= 1.96 * sd for e, sd in map(ERRORS[name], whole(level))]
    assert np.mean(within) >= 0.83


@pytest.mark.parametrize(
    ("name", "typical"),
    [
        ("tip y", 0.0005),
        ("tip z", 0.0004),
        ("tilt", math.radians(0.2)),
        ("hole from the tip", 0.0004),
    ],
)
def test_half_of_the_errors_are_far_below_a_millimetre(name: str, typical: float) -> None:
    errors = [abs(e) for e, _ in map(ERRORS[name], whole("L5"))]
    sds = [sd for _, sd in map(ERRORS[name], whole("L5"))]
    assert np.median(errors) < typical
    assert np.median(sds) < 1.5 * typical  # an interval that says something


def test_at_approach_the_arm_finds_out_where_its_camera_really_is() -> None:
    """The board's surface, which is at 0, is seen millimetres off; with the offset it is right."""
    surfaces = [s.scene.hole.surface_z.value for s in whole("L5") if s.scene.hole is not None]
    raw = [
        s.scene.hole.surface_z.value - s.offset.z.value
        for s in whole("L5")
        if s.scene.hole is not None
    ]
    assert np.percentile(np.abs(raw), 80) > 0.004
    assert np.percentile(np.abs(surfaces), 80) < 0.001


@pytest.mark.parametrize("peg", PEGS)
def test_on_plain_pictures_edges_and_colours_agree(peg: str) -> None:
    rng = np.random.default_rng(5)
    for kind in (0, 1, 2):
        robot = prepared(peg, Setup(seed=kind, hole_y=rng.uniform(-0.02, 0.02)))
        place_at_random(robot, rng, kind)
        seen = robot.observe()
        one = measure(seen.views["side"], robot.task)
        two = by_edges(robot)
        assert one.peg is not None
        assert one.hole is not None
        assert two.peg is not None
        assert two.hole is not None
        assert two.peg.tip_y.value == pytest.approx(one.peg.tip_y.value, abs=0.001)
        assert two.peg.tip_z.value == pytest.approx(one.peg.tip_z.value, abs=0.0008)
        assert two.peg.tilt.value == pytest.approx(one.peg.tilt.value, abs=math.radians(0.7))
        assert two.hole.y.value == pytest.approx(one.hole.y.value, abs=0.0005)
        assert two.hole.surface_z.value == pytest.approx(one.hole.surface_z.value, abs=0.0005)
        assert two.peg.edge_px == pytest.approx(one.peg.edge_px, abs=4 if kind == 0 else math.inf)
        assert two.hole.center_px[0] == pytest.approx(one.hole.center_px[0], abs=1)


def test_a_board_turned_about_the_vertical_is_measured_where_it_is() -> None:
    for yaw in (-0.15, 0.15):
        robot = prepared("square", Setup(seed=0, board_yaw=yaw, hole_y=0.01))
        stand_peg(robot, tip_y=0.0, tip_z=0.02, lean=0.0)
        scene = by_edges(robot, aside=Aside(board_yaw=yaw))
        assert scene.hole is not None
        assert scene.hole.y.value == pytest.approx(0.01, abs=0.0006)


def test_the_oblique_picture_tells_how_the_board_is_turned_whatever_it_looks_like() -> None:
    drawing = load_level("L8").on(condition("all"))
    errors = []
    for seed in range(700, 724):
        robot = prepared("square", replace(drawing.draw(seed), stale=0.0))
        outline = board_outline(robot.observe(cameras=("oblique",)).views["oblique"])
        assert outline is not None
        errors.append(outline.yaw.value - robot.setup.board_yaw)
        assert abs(errors[-1]) < math.radians(1.5)
        assert abs(outline.y - robot.setup.hole_y) < 0.012  # the camera itself is off
    assert np.std(errors) < math.radians(0.5)


def test_where_nothing_is_nothing_is_found_and_it_says_so() -> None:
    seen = prepared().observe()
    view = seen.views["side"]
    noise = np.random.default_rng(0).normal(120, 6, view.image.shape).clip(0, 255).astype(np.uint8)
    for image in (noise, np.full_like(view.image, 90)):
        empty = View(camera=view.camera, time_s=1.5, image=image)
        scene = measure_edges(empty, load_task("circle"), seen.pose)
        assert (scene.peg, scene.hole, scene.time_s) == (None, None, 1.5)
        assert len(scene.problems) == 2
