"""Pegs as data: what an outline must be, and how a peg is seen, gripped and let into its hole."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from stand_ins import cell_for, prepared, seen, stand_peg
from test_sim_model import LIMIT, SIDE_FORCE, ceiling, depth, play_under, press_on_board

from pliant.conditions import Setup
from pliant.errors import InputError
from pliant.levels import load_level
from pliant.polygon import Outline
from pliant.pose import Pose
from pliant.sim.board import area, contains, convex_pieces, hole_outline
from pliant.sim.cell import SimCell, SimRobot
from pliant.sim.gripper import closed_on
from pliant.sim.model import ARM_JOINTS, PEG, build
from pliant.task import Hole, Peg, Task, load_task, shipped_pegs

SQUARE = ((-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01))
NEVER_TAUGHT = load_level("L7").pegs
POLYGONS = ("triangle", "hexagon", "d_shape", "keyed")
CLEARANCES = (0.0002, 0.0003, 0.0005, 0.002)  # [m] of the ladder


def refused(outline: Outline, hole: Hole | None = None) -> str:
    """The one line that a user reads."""
    with pytest.raises(InputError) as error:
        Task(peg=Peg(name="mine", outline=outline), hole=hole or Hole())
    message = str(error.value)
    assert "\n" not in message
    return message


# --- what an outline must be ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outline", "says"),
    [
        (SQUARE[:2], "2 corners; it must have at least 3"),
        (SQUARE[::-1], "its corners go clockwise; list them in the opposite order"),
        ((*SQUARE[:2], (0.0, 0.0), *SQUARE[2:]), "edge from (10, -10) to (0, 0) mm"),
        ((SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]), "counter-clockwise around the axis"),
        (tuple((x + 0.02, y) for x, y in SQUARE), "edge from (10, 10) to (10, -10) mm"),
        ((*SQUARE, *SQUARE), "2 times around the axis"),
        (tuple((0.5 * x, 6 * y) for x, y in SQUARE), "120 mm along y"),
        (tuple((4.95 * x, y) for x, y in SQUARE), "101 mm wide; the block leaves room for 100 mm"),
        (tuple((x, y + 0.002) for x, y in SQUARE), "add -2 mm to every y"),
        (((math.nan, 0.0), *SQUARE[1:]), "counter-clockwise"),
        ((*SQUARE, SQUARE[0]), "corner (-10, -10) mm is given twice in a row; give it once"),
        (tuple((math.cos(n / 32), math.sin(n / 32)) for n in range(201)), "at most 200"),
    ],
)
def test_an_outline_that_cannot_be_used_says_why_in_one_line(outline: Outline, says: str) -> None:
    assert says in refused(outline)


def test_a_slot_that_the_holes_clearance_closes_is_refused() -> None:
    slot = ((0.01, -0.001), (0.006, -0.0003), (0.006, 0.0003), (0.01, 0.001))
    outline = (*SQUARE[:2], *slot, *SQUARE[2:])
    assert "closes at the edge from (6, -0.3) to (6, 0.3) mm" in refused(outline)
    Task(peg=Peg(name="mine", outline=outline), hole=Hole(clearance=0.0002))


@pytest.mark.parametrize("half", [0.001, 0.005, 0.02, 0.04])
def test_a_peg_too_short_to_go_in_before_the_fingers_reach_the_board_is_refused(
    half: float,
) -> None:
    peg = Peg(name="mine", outline=tuple((x, half / 0.01 * y) for x, y in SQUARE), length=0.0785)
    with pytest.raises(InputError, match=r"36 mm before the fingers .* at least 79 mm"):
        Task(peg=peg, depth=0.036)
    robot = SimCell().prepare(Task(peg=peg, depth=0.035), Setup(seed=0))
    stand_peg(robot, tip_y=0.0, tip_z=-0.035, lean=0.0)
    assert robot.data.ncon == 0


# --- what a camera sees --------------------------------------------------------------------------


def test_a_cylinders_silhouette_is_at_its_axis_however_it_is_turned() -> None:
    assert load_task("circle").peg.silhouette(0.3) == ((-0.02, 0.0), (0.02, 0.0))


def test_a_box_shows_its_front_edges_and_beside_the_optical_axis_one_of_its_back() -> None:
    peg = load_task("rectangle_narrow").peg
    assert peg.silhouette() == ((-0.01, 0.02), (0.01, 0.02))
    assert peg.silhouette(slopes=(0.02, 0.04)) == ((-0.01, -0.02), (0.01, 0.02))
    assert peg.silhouette(slopes=(-0.04, -0.02)) == ((-0.01, 0.02), (0.01, -0.02))


def test_a_turned_box_shows_opposite_corners() -> None:
    yaw = math.radians(10)
    (left_y, left_x), (right_y, right_x) = load_task("rectangle_narrow").peg.silhouette(yaw)
    assert (left_y, left_x) == pytest.approx((-right_y, -right_x))
    assert right_y == pytest.approx(0.02 * math.sin(yaw) + 0.01 * math.cos(yaw))
    assert right_x == pytest.approx(0.02 * math.cos(yaw) - 0.01 * math.sin(yaw))


def test_the_front_of_a_peg_is_its_nearest_part_around_its_middle() -> None:
    assert load_task("circle").peg.front(0.003) == 0.02
    assert load_task("rectangle_narrow").peg.front(0.003) == 0.02
    wedge = Peg(name="wedge", outline=((0.02, 0.01), (-0.02, 0.01), (0.0, -0.01)))
    assert wedge.front(0.005) == pytest.approx(0.015)
    assert wedge.front(0.005, math.pi) == pytest.approx(0.015)


@pytest.mark.parametrize("peg", NEVER_TAUGHT)
def test_a_peg_is_measured_about_its_axis_in_the_picture(peg: str) -> None:
    rng = np.random.default_rng(5)
    hole_y, grasp = rng.uniform(-0.02, 0.02), math.radians(rng.uniform(-5, 5))
    robot = prepared(peg, Setup(seed=0, hole_y=hole_y, grasp_roll=grasp))
    half = robot.task.peg.half_extents[1]
    for kind in ("hanging", "leaning in", "upright in") * 2:
        if kind == "hanging":
            lean = math.radians(rng.uniform(-8, 8))
            y = rng.uniform(-0.05, 0.05)
            z = rng.uniform(0, 0.005) + half * abs(math.sin(lean))
        elif kind == "leaning in":
            lean = math.radians(rng.uniform(6, 16))
            y = hole_y - 0.001 - half + half * math.cos(lean)
            z = half * math.sin(lean) - rng.uniform(0.0, 0.006)
        else:
            lean, y, z = math.radians(rng.uniform(-1, 1)), hole_y, -rng.uniform(0, 0.025)
        stand_peg(robot, tip_y=y, tip_z=z, lean=lean)
        truth, scene = cell_for(peg).truth(), seen(robot)
        assert scene.peg is not None, scene.problems
        assert scene.hole is not None, scene.problems
        assert scene.peg.tip_y.value == pytest.approx(truth.tip[1], abs=0.0006)
        assert scene.peg.tip_z.value == pytest.approx(truth.tip[2], abs=0.0007)
        assert scene.peg.tilt.value == pytest.approx(truth.tilt_rad, abs=math.radians(0.6))
        assert scene.hole.y.value == pytest.approx(truth.hole_y, abs=0.0004)


# --- the board around it -------------------------------------------------------------------------


@given(
    st.sampled_from(POLYGONS), st.integers(0, 100), st.floats(0, 1), st.floats(0, 2), st.booleans()
)
def test_a_point_is_in_a_hole_on_the_axis_side_of_its_wall(
    peg: str, edge: int, along: float, out: float, wide: bool
) -> None:
    task = load_task(peg)
    hole = hole_outline(task.peg, task.hole if wide else Hole(clearance=0.0002))
    start, end = hole[edge % len(hole)], hole[(edge + 1) % len(hole)]
    wall = start + along * (end - start)
    if abs(out - 1) > 1e-6:
        assert contains(hole, tuple(out * wall)) is (out < 1)


@pytest.mark.parametrize("peg", POLYGONS)
def test_a_hole_is_half_its_clearance_away_from_every_face_of_the_peg(peg: str) -> None:
    task = load_task(peg)
    hole = hole_outline(task.peg, task.hole)
    outline = np.array(task.peg.outline)
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        edge = end - start
        normal = np.array([edge[1], -edge[0]]) / np.linalg.norm(edge)
        middle = (start + end) / 2
        assert contains(hole, tuple(middle + 0.00099 * normal))
        assert not contains(hole, tuple(middle + 0.00101 * normal))


@pytest.mark.parametrize("peg", POLYGONS)
@pytest.mark.parametrize("chamfer", [0.0, 0.003])
def test_in_the_compiled_board_a_polygons_hole_is_open_and_all_else_is_solid(
    peg: str, chamfer: float
) -> None:
    task = Task(peg=load_task(peg).peg, hole=Hole(chamfer=chamfer))
    robot = SimRobot(task)
    robot.data.qpos[: len(ARM_JOINTS)] = [0.0, -2.5, 0.5, 0, 0, 0]  # folded away from the board
    robot.pose()  # moves the bodies there
    inner = hole_outline(task.peg, task.hole, grown=-1e-5)
    outer = hole_outline(task.peg, task.hole, grown=chamfer + 1e-5)
    steps = np.linspace(-0.0595, 0.0595, 41)  # moved a little, off the seams between prisms
    for x, y in [(x + 0.00013, y + 0.00037) for x in steps for y in steps]:
        height = ceiling(robot.model, robot.data, x, y)
        if contains(inner, (x, y)):
            assert height == -math.inf
        elif not contains(outer, (x, y)):
            assert height == pytest.approx(0.0, abs=1e-7)
        else:
            assert -chamfer - 1e-7 <= height <= 0.0


@pytest.mark.parametrize(("peg", "pieces"), [("triangle", 1), ("d_shape", 1), ("keyed", 3)])
def test_a_peg_is_built_of_as_few_convex_pieces_as_its_inward_corners_ask_for(
    peg: str, pieces: int
) -> None:
    outline = np.array(load_task(peg).peg.outline)
    found = convex_pieces(outline)
    assert len(found) == pieces
    assert sum(map(area, found)) == pytest.approx(area(outline))
    for piece in found:
        before, after = piece - np.roll(piece, 1, axis=0), np.roll(piece, -1, axis=0) - piece
        assert np.all(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0)
    model = build(load_task(peg))
    assert model.body(PEG).geomnum[0] == pieces
    assert model.body(PEG).mass[0] == pytest.approx(0.03)


# --- gripped, hanging, in its hole ---------------------------------------------------------------


@pytest.mark.parametrize("peg", shipped_pegs())
def test_the_fingertips_close_on_the_peg(peg: str) -> None:
    half = load_task(peg).peg.half_extents[1]
    gaps = [
        abs(float(pad.position[1])) - float(np.min(pad.half_size))
        for pad in closed_on(2 * half)
        if pad.half_size is not None
    ]
    assert gaps == pytest.approx([half, half], abs=0.002)


@pytest.mark.parametrize("peg", NEVER_TAUGHT)
def test_a_peg_hangs_free_and_nearly_upright_before_a_trial(peg: str) -> None:
    robot = prepared(peg)
    truth = cell_for(peg).truth()
    assert robot.data.ncon == 0
    assert truth.tip[:2] == pytest.approx((0, 0), abs=0.001)
    assert abs(truth.tilt_rad) < math.radians(0.2)
    assert not truth.inserted


def test_a_peg_fits_where_the_corner_that_is_ahead_is_in_the_hole_wherever_that_corner_is() -> None:
    outline = ((0.012, -0.015), (0.02, 0.0), (-0.012, 0.015), (-0.02, 0.0))
    cell = SimCell()
    robot = cell.prepare(Task(peg=Peg(name="skew", outline=outline)), Setup(seed=0))
    lean = math.radians(10)
    for depth_m, fits in ((0.003, True), (-0.003, False)):
        stand_peg(robot, tip_y=0.0, tip_z=0.015 * math.sin(lean) - depth_m, lean=lean)
        assert cell.truth().fit is fits


def lowered(cell: SimCell, peg: str, clearance: float) -> SimRobot:
    """A peg let down upright into its hole, with too little friction to stick."""
    task = load_task(peg)
    robot = cell.prepare(replace(task, hole=Hole(clearance=clearance)), Setup(seed=0))
    robot.model.geom_friction[:, 0] = 0.1
    stand_peg(robot, tip_y=0.0, tip_z=0.001, lean=0.0)
    robot.halt()  # holds it there
    down = Pose(z=task.tip_below_hinge - 0.020)
    robot.move_to(down, speed_m_s=0.05, stop_at_compression_m=LIMIT)
    robot.settle(0.5)
    return robot


def room(task: Task) -> NDArray[np.float64]:  # (2,) [m]
    """How far a peg may move along x and y in its hole without turning."""
    hole = hole_outline(task.peg, task.hole)
    edges = np.roll(hole, -1, axis=0) - hole
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    most = task.hole.clearance / 2  # along each face's normal
    corners = []
    for pair in map(list, combinations(range(len(hole)), 2)):
        if abs(np.linalg.det(normals[pair])) > 1e-6:
            corner = np.linalg.solve(normals[pair], [most, most])
            if np.all(normals @ corner < most + 1e-9):
                corners.append(corner)
    return np.asarray(np.ptp(np.array(corners), axis=0))


@pytest.mark.parametrize("peg", shipped_pegs())
def test_an_upright_peg_drops_into_its_hole_and_has_the_outlines_room_there(peg: str) -> None:
    cell = SimCell()
    for clearance in CLEARANCES:
        robot = lowered(cell, peg, clearance)
        truth = cell.truth()
        assert truth.inserted
        assert truth.depth_m > 0.015
        for axis in (0, 1):
            expected = float(room(robot.task)[axis])
            play = play_under(robot, axis, SIDE_FORCE)
            sunk = depth(robot.data)
            print(
                f"{peg}, clearance {clearance * 1e3:g} mm, {'xy'[axis]}: room"
                f" {expected * 1e3:.3f} mm, play {play * 1e3:.3f} mm, sunk {sunk * 1e3:.3f} mm"
            )
            assert play == pytest.approx(expected, abs=0.0001)
            assert sunk < 0.0001


@pytest.mark.parametrize(
    ("peg", "x", "y"),
    [("circle", 1, 1), ("thin", 1, 1), ("plug_x", 1, 1), ("triangle", 3**0.5, 1.5)],
)
def test_the_room_is_the_clearance_and_more_where_the_walls_slant(
    peg: str, x: float, y: float
) -> None:
    task = load_task(peg, "L7")
    assert room(task) / task.hole.clearance == pytest.approx([x, y], rel=1e-3)


@pytest.mark.parametrize("peg", NEVER_TAUGHT)
def test_a_leaning_peg_pressed_on_the_board_sinks_in_by_less_than_a_tenth_of_a_millimetre(
    peg: str,
) -> None:
    press = press_on_board(peg, math.radians(10))
    print(
        f"{peg}, flange at 10 deg: {press.at_touch_m * 1e3:.3f} mm at touch-down,"
        f" {press.at_rest_m * 1e3:.3f} mm at rest under {press.force_n:.1f} N"
    )
    assert press.force_n == pytest.approx(SIDE_FORCE, abs=1.0)
    assert 0 < press.at_rest_m < 0.0001
    assert press.at_touch_m < 0.0001
