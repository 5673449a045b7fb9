"""Pegs as data: what their outlines must be, how they are drawn, gripped, held, seen and let in."""

import math

import pytest

from pliant.errors import InputError
from pliant.task import Peg, load_task

SQUARE = ((-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01))


def refused(outline: tuple[tuple[float, float], ...]) -> str:
    """The one line that a user reads."""
    with pytest.raises(InputError) as error:
        Peg(name="mine", outline=outline)
    message = str(error.value)
    assert "\n" not in message
    return message


# --- what an outline must be ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outline", "says"),
    [
        (SQUARE[:2], "2 corners; it must have at least 3"),
        (SQUARE[::-1], "edge from (-10, 10) to (10, 10) mm does not go counter-clockwise"),
        ((*SQUARE[:2], (0.0, 0.0), *SQUARE[2:]), "edge from (10, -10) to (0, 0) mm"),
        ((SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]), "counter-clockwise around the axis"),
        (tuple((x + 0.02, y) for x, y in SQUARE), "edge from (10, 10) to (10, -10) mm"),
        ((*SQUARE, *SQUARE), "2 times around the axis"),
        (tuple((0.5 * x, 6 * y) for x, y in SQUARE), "120 mm along y"),
        (tuple((x, y + 0.002) for x, y in SQUARE), "add -2 mm to every y"),
        (((math.nan, 0.0), *SQUARE[1:]), "counter-clockwise"),
    ],
)
def test_an_outline_that_cannot_be_used_says_why_in_one_line(
    outline: tuple[tuple[float, float], ...], says: str
) -> None:
    assert says in refused(outline)


# --- what a camera sees --------------------------------------------------------------------------


def test_a_cylinders_silhouette_is_at_its_axis_however_it_is_turned() -> None:
    assert load_task("circle").peg.silhouette(0.3) == ((-0.02, 0.0), (0.02, 0.0))


def test_a_box_shows_its_front_edges_and_beside_the_optical_axis_one_of_its_back() -> None:
    peg = load_task("rectangle").peg
    assert peg.silhouette() == ((-0.01, 0.02), (0.01, 0.02))
    assert peg.silhouette(slopes=(0.02, 0.04)) == ((-0.01, -0.02), (0.01, 0.02))
    assert peg.silhouette(slopes=(-0.04, -0.02)) == ((-0.01, 0.02), (0.01, -0.02))


def test_a_turned_box_shows_opposite_corners() -> None:
    yaw = math.radians(10)
    (left_y, left_x), (right_y, right_x) = load_task("rectangle").peg.silhouette(yaw)
    assert (left_y, left_x) == pytest.approx((-right_y, -right_x))
    assert right_y == pytest.approx(0.02 * math.sin(yaw) + 0.01 * math.cos(yaw))
    assert right_x == pytest.approx(0.02 * math.cos(yaw) - 0.01 * math.sin(yaw))


def test_the_front_of_a_peg_is_its_nearest_part_around_its_middle() -> None:
    assert load_task("circle").peg.front(0.003) == 0.02
    assert load_task("rectangle").peg.front(0.003) == 0.02
    wedge = Peg(name="wedge", outline=((0.02, 0.01), (-0.02, 0.01), (0.0, -0.01)))
    assert wedge.front(0.005) == pytest.approx(0.015)
    assert wedge.front(0.005, math.pi) == pytest.approx(0.015)
