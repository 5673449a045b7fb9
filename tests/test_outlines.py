"""Random outlines: the simulated peg and board have the shape that the task says."""

from itertools import combinations

import mujoco
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from outlines import outlines

from pliant.errors import InputError
from pliant.polygon import Outline
from pliant.sim.board import (
    Polygon,
    area,
    contains,
    convex_pieces,
    hole_outline,
    hole_prisms,
    hull_faces,
)
from pliant.sim.model import add_board, add_peg
from pliant.task import Hole, Peg, Task, load_task, shipped_pegs

CLEARANCES = st.sampled_from([0.0002, 0.0005, 0.002, 0.008])
CHAMFERS = st.sampled_from([0.0, 0.0, 0.0005, 0.003])
# A groove with a floor: two inward corners in a row, the first of which starts a piece.
KEYWAY = tuple(
    (x * 1e-3, y * 1e-3)
    for x, y in [(-15, -12), (15, -12), (15, -5), (9, -2), (9, 2), (15, 5), (15, 12), (-15, 12)]
)
# A spike behind a groove, whose chamfer is not on the rays through the hole's corners.
SPIKE = tuple(
    (x * 1e-3, y * 1e-3)
    for x, y in [(19.5, 2.4), (10.5, 16.6), (-11.1, 20.7), (-3.5, 5.4), (-18, 11.1), (-12.4, -20.7)]
)
FAR, ROUNDING = 1e-6, 1e-9  # [m]


def task_of(outline: Outline, clearance: float = 0.0005, chamfer: float = 0.0) -> Task:
    """The task with this peg; outlines that are refused at the door are passed over."""
    try:
        return Task(
            peg=Peg(name="random", outline=outline), hole=Hole(clearance=clearance, chamfer=chamfer)
        )
    except InputError:
        assume(False)
        raise


def dent(polygon: Polygon) -> float:
    """How far a corner lies on the wrong side of an edge's line, at most [m]; 0: convex."""
    along = np.roll(polygon, -1, axis=0) - polygon
    inward = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    return -float(np.min(inward @ polygon.T - np.sum(inward * polygon, axis=1)[:, None]))


def apart(a: Polygon, b: Polygon) -> float:
    """How far two convex polygons are apart, by the edge that parts them best [m]."""
    return max(_beyond(a, b), _beyond(b, a))


def _beyond(polygon: Polygon, other: Polygon) -> float:
    along = np.roll(polygon, -1, axis=0) - polygon
    outward = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    reach = outward @ other.T - np.sum(outward * polygon, axis=1)[:, None]
    return float(np.max(np.min(reach, axis=1)))


# --- the peg ---------------------------------------------------------------------------------


@given(outlines())
@example(KEYWAY)
def test_a_pegs_pieces_are_convex_apart_and_the_whole_outline(outline: Outline) -> None:
    whole = np.array(task_of(outline).peg.outline)
    pieces = convex_pieces(whole)
    for piece in pieces:
        assert dent(piece) < 10 * ROUNDING
    assert sum(map(area, pieces)) == pytest.approx(area(whole), rel=1e-9)
    for a, b in combinations(pieces, 2):
        assert apart(a, b) > -ROUNDING


# --- the board -------------------------------------------------------------------------------


def within(prism: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """How deep points lie in a prism's convex hull [m], which is what MuJoCo makes of it."""
    faces = hull_faces(prism)
    starts = np.array([face[0] for face in faces])
    normals = np.array(
        [np.cross(f - f[0], np.roll(f, -1, axis=0) - f[0]).sum(axis=0) for f in faces]
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return -np.max(points @ normals.T - np.sum(starts * normals, axis=1), axis=1)


@settings(max_examples=12)
@given(outlines(most=30), CLEARANCES, CHAMFERS, st.integers(0, 1000))
@example(KEYWAY, 0.0005, 0.003, 0)
@example(SPIKE, 0.0002, 0.003, 0)
def test_the_prisms_leave_the_hole_free_with_its_chamfer_and_fill_all_the_rest(
    outline: Outline, clearance: float, chamfer: float, seed: int
) -> None:
    task = task_of(outline, clearance, chamfer)
    prisms = hole_prisms(task.peg, task.hole)
    rng = np.random.default_rng(seed)
    for z in (-0.1, -0.9 * chamfer - FAR, -0.4 * chamfer - FAR):
        wider = max(0.0, chamfer + z)
        free, kept = (hole_outline(task.peg, task.hole, grown=wider + g) for g in (-FAR, FAR))
        near = kept[rng.integers(len(kept), size=60)] * rng.uniform(0.9, 1.1, (60, 1))
        spread = rng.uniform(-0.06, 0.06, (60, 2))
        points = np.array([p for p in (*near, *spread) if np.abs(p).max() < 0.06])
        placed = np.column_stack([points, np.full(len(points), z)])
        deepest = np.max([within(prism, placed) for prism in prisms], axis=0)
        for point, depth in zip(points, deepest, strict=True):
            if contains(free, point):
                assert depth < ROUNDING
            elif not contains(kept, point):
                assert depth > -ROUNDING


# --- both, in MuJoCo -------------------------------------------------------------------------


class Plunge:
    """The peg above its hole in MuJoCo, exactly upright, on a rail straight down."""

    def __init__(self, task: Task) -> None:
        spec = mujoco.MjSpec()
        rail = spec.worldbody.add_body(name="rail")
        rail.add_joint(name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        add_peg(spec, rail, task)
        add_board(spec, task)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._upright = task.tip_below_hinge

    def touches(self, *, depth: float, x: float = 0.0, y: float = 0.0) -> bool:
        """Whether the peg touches the board, with its tip `depth` below its top and beside the
        hole's axis by (`x`, `y`) [m]."""
        self.model.body("rail").pos[:] = x, y, self._upright - depth
        mujoco.mj_forward(self.model, self.data)
        return bool(self.data.ncon)

    def falls(self) -> float:
        """How deep the peg is after it was let go at the board's surface [m], which takes 0.1 s."""
        self.model.body("rail").pos[:] = 0.0, 0.0, self._upright
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_step(self.model, self.data, round(0.1 / self.model.opt.timestep))
        return -float(self.data.qpos[0])


@settings(max_examples=20)
@given(outlines(most=40), CLEARANCES, CHAMFERS)
@example(KEYWAY, 0.0005, 0.0)
@example(KEYWAY, 0.0005, 0.003)
def test_a_true_peg_goes_straight_down_into_its_hole_untouched_and_nowhere_beside_it(
    outline: Outline, clearance: float, chamfer: float
) -> None:
    task = task_of(outline, clearance, chamfer)
    plunge = Plunge(task)
    assert plunge.falls() == pytest.approx(9.81 / 2 * 0.1**2, rel=0.05)
    for depth in (0.0005, 0.01, 0.035):
        assert not plunge.touches(depth=depth)
    hole, corners = hole_outline(task.peg, task.hole), np.array(outline)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        x, y = (clearance / 2 + 1e-5) * np.array([along[1], -along[0]])
        if not contains(hole, (start + end) / 2 + (x, y)):  # or a groove is there
            assert plunge.touches(depth=0.01, x=x, y=y)


@pytest.mark.parametrize("peg", shipped_pegs())
@pytest.mark.parametrize("chamfer", [0.0, 0.002])
def test_a_shipped_peg_goes_straight_down_into_its_hole(peg: str, chamfer: float) -> None:
    task = Task(peg=load_task(peg).peg, hole=Hole(clearance=0.0002, chamfer=chamfer))
    plunge = Plunge(task)
    assert plunge.falls() == pytest.approx(9.81 / 2 * 0.1**2, rel=0.05)
    assert plunge.touches(depth=0.01, y=0.0002)
