"""Table I, every row on a rendered picture that shows the case, with the paper's own messages."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from stand_ins import PEGS, cell_for, outcome_of, picture, prepared, stand_peg

from pliant.conditions import Setup
from pliant.formations import Formation
from pliant.methods.planar.checks import check
from pliant.records import Check
from pliant.teaching import shipped
from pliant.vision.measure import measure

FIT, ALIGN = Formation.FIT, Formation.ALIGN
MIDDLE = 0.045  # [m] from the tip to the peg's middle
ABOVE = 0.003  # [m] of the lowest corner over the board: the whole peg is to be seen


@dataclass(frozen=True)
class Row:
    """A row of Table I: its message as in the paper, and a case of it.

    `beside_mm` is where the peg's middle is from the hole's centre; `lean_deg` is to the left.
    """

    formation: Formation
    message: str
    beside_mm: float
    lean_deg: float


ROWS = [
    Row(FIT, "success", -8, 10),
    Row(FIT, "$p_{gy}$ was too small.", -34, 10),
    Row(FIT, "$p_{gy}$ was too big.", +8, 10),
    Row(ALIGN, "Align success", 0, 0),
    Row(ALIGN, "peg is tilted to the left.", 0, 9),
    Row(ALIGN, "peg is tilted to the right.", 0, -9),
    Row(ALIGN, "$p_{ey}$ was too small.", -15, 0),
    Row(ALIGN, "$p_{ey}$ was too big.", +15, 0),
    Row(ALIGN, "peg is tilted to the left. $p_{gy}$ was too small.", -15, 9),
    Row(ALIGN, "$p_{gy}$ was too big. also tilted to the left.", +15, 9),
    Row(ALIGN, "$p_{gy}$ was too small. also tilted to the right.", -15, -9),
    Row(ALIGN, "$p_{gy}$ was too big. also tilted to the right.", +15, -9),
]


def table_i_on_picture(peg: str, row: Row, hole_y: float, grasp_roll: float) -> Check:
    """Stand the peg as the row says, draw it, measure the picture, and ask the table."""
    robot = prepared(peg, Setup(seed=0, hole_y=hole_y, grasp_roll=grasp_roll))
    lean = math.radians(row.lean_deg)
    half = robot.task.peg.half_extents[1]
    tip_y = hole_y + row.beside_mm * 1e-3 + MIDDLE * math.sin(lean)
    stand_peg(robot, tip_y=tip_y, tip_z=ABOVE + half * abs(math.sin(lean)), lean=lean)
    truth = cell_for(peg).truth()
    assert math.degrees(truth.tilt_rad) == pytest.approx(row.lean_deg, abs=0.01)
    scene = measure(picture(robot), robot.task)
    evidence = check(robot.task, outcome_of(row.formation, scene=scene), shipped().scenes)
    result = evidence["table_i"]
    assert result is not None
    return result


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.formation}: {row.message}")
@pytest.mark.parametrize(
    ("peg", "hole_y", "grasp_deg"),
    [("circle", 0.0, 0.0), ("square", 0.015, 4.0), ("rectangle_narrow", -0.015, -4.0)],
)
def test_a_row_of_the_table_is_read_from_a_picture_that_shows_it(
    row: Row, peg: str, hole_y: float, grasp_deg: float
) -> None:
    result = table_i_on_picture(peg, row, hole_y, math.radians(grasp_deg))
    assert result.message == row.message.replace("$", "").replace("{", "").replace("}", "")
    assert result.vote is (row.message in ("success", "Align success"))
    assert result.paper


def test_all_twelve_rows_are_covered() -> None:
    assert len({(row.formation, row.message) for row in ROWS}) == 12


@pytest.mark.parametrize("peg", PEGS)
def test_left_in_the_table_is_left_in_the_picture(peg: str) -> None:
    robot = prepared(peg)
    stand_peg(robot, tip_y=-0.02, tip_z=0.01, lean=math.radians(8))
    scene = measure(picture(robot), robot.task)
    assert scene.peg is not None
    assert scene.hole is not None
    assert scene.peg.center_px[0] < scene.hole.center_px[0]
    upper, lower = (
        [p for p in scene.peg.box_px if (p[1] < scene.peg.center_px[1]) is above]
        for above in (True, False)
    )
    assert sum(p[0] for p in upper) / 2 < sum(p[0] for p in lower) / 2  # the top leans left
    assert scene.peg.tilt_deg == pytest.approx(8, abs=1.0)


@pytest.mark.parametrize("peg", PEGS)
def test_p_edge_is_the_bottom_right_corner(peg: str) -> None:
    robot = prepared(peg)
    half = robot.task.peg.half_extents[1]
    for lean_deg in (-8, 0, 8):
        lean = math.radians(lean_deg)
        stand_peg(robot, tip_y=0.004, tip_z=0.02, lean=lean)
        view = picture(robot)
        scene = measure(view, robot.task)
        assert scene.peg is not None
        corner = np.array(
            [
                robot.task.peg.silhouette_x,
                0.004 + half * math.cos(lean),
                0.02 + half * math.sin(lean),
            ]
        )
        assert scene.peg.edge_px == pytest.approx(view.camera.project(corner), abs=4.0)
