"""Two parallel lines through edge points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.vision.lines import fit_pair

PLACES = st.tuples(
    st.sampled_from([0, 1]), st.floats(0.0, 60.0), st.integers(0, 12), st.floats(0.05, 1.0)
)


@given(st.lists(PLACES, max_size=30), st.floats(4.0, 40.0))
def test_whatever_the_points_are_there_is_a_pair_of_finite_lines_or_none(
    places: list[tuple[int, float, int, float]], width: float
) -> None:
    pair = fit_pair(np.array(places, float), width, 0.2)
    if pair is not None:
        assert np.isfinite([pair.left, pair.right, pair.slope, pair.place_sd, pair.slope_sd]).all()
        assert abs(pair.right - pair.left - width) < 1.0 + width


@given(st.floats(-0.1, 0.1), st.floats(10.0, 40.0))
def test_lines_are_found_where_they_are(slope: float, width: float) -> None:
    points = [
        (line, 100.0 + (line - 0.5) * width + slope * (y - 10.0), float(y), 1.0)
        for line in (0, 1)
        for y in range(21)
    ]
    pair = fit_pair(np.array(points), width, 0.2)
    assert pair is not None
    assert (pair.left + pair.right) / 2 == pytest.approx(100.0, abs=0.1)
    assert pair.slope == pytest.approx(slope, abs=0.01)


def test_points_that_leave_one_line_without_a_slope_make_no_pair() -> None:
    """As at L5+, circle, 50011: the last weighing left one row of points on either line."""
    points = [(line, 10.0 + 20.0 * line, 5.0, 1.0) for line in (0, 1) for _ in range(4)]
    assert fit_pair(np.array(points), 20.0, 0.2) is None
