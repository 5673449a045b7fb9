import math
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.conditions import (
    CONDITIONS,
    NOMINAL,
    PAPER_RANGES,
    QUANTITIES,
    Condition,
    Setup,
    condition,
)
from pliant.errors import InputError
from pliant.levels import load_level
from pliant.task import Hole, Peg, Task, Wrist, load_task, shipped_pegs

SEEDS = st.integers(0, 2**31)
WritePeg = Callable[[str], str]


@pytest.fixture
def peg_file(tmp_path: Path) -> WritePeg:
    """Writes a peg file and gives its path."""

    def write(text: str) -> str:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


def refused(make: Callable[[], object]) -> str:
    """The one line that a user reads."""
    with pytest.raises(InputError) as error:
        make()
    message = str(error.value)
    assert "\n" not in message
    return message


# --- pegs --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "half_x", "half_y"),
    [("circle", 0.02, 0.02), ("square", 0.02, 0.02), ("rectangle_narrow", 0.02, 0.01)],
)
def test_the_papers_three_pegs_ship_with_two_millimetres_of_clearance(
    name: str, half_x: float, half_y: float
) -> None:
    task = load_task(name)
    assert task.peg.half_extents == pytest.approx((half_x, half_y))
    assert task.peg.length == pytest.approx(0.09)
    assert task.hole == Hole(clearance=0.002, chamfer=0.0)
    assert (task.peg.radius is not None) == (name == "circle")


def test_beside_them_ship_the_pegs_that_were_never_taught() -> None:
    never_taught = load_level("L7").pegs
    assert {*shipped_pegs()} - {*never_taught} == {
        "circle",
        "rectangle",
        "rectangle_narrow",
        "square",
    }
    assert {*never_taught} < {*shipped_pegs()}


def test_the_tip_hangs_where_the_published_frames_put_it() -> None:
    task = load_task("circle")
    assert task.tip_below_hinge == pytest.approx(0.099 + 0.04 + 0.045)  # frame, centre, half a peg
    assert task.tip_below_hinge == pytest.approx(task.grasp_below_hinge + task.tip_below_grasp)


def test_a_peg_file_is_read_in_millimetres(peg_file: WritePeg) -> None:
    text = "shape: rectangle\nsize_x_mm: 30\nsize_y_mm: 10\nlength_mm: 80\nclearance_mm: 1\n"
    task = load_task(peg_file(text + "chamfer_mm: 2\n"))
    assert task.peg.name == "mine"
    assert task.peg.half_extents == pytest.approx((0.015, 0.005))
    assert task.peg.length == pytest.approx(0.08)
    assert (task.hole.clearance, task.hole.chamfer) == pytest.approx((0.001, 0.002))


def test_a_polygons_corners_are_read_in_millimetres(peg_file: WritePeg) -> None:
    text = "shape: polygon\ncorners_mm: [[-10, -12], [15, 0], [-10, 12.0]]\nlength_mm: 80\n"
    task = load_task(peg_file(text + "clearance_mm: 0.4\n"))
    assert task.peg.outline == ((-0.01, -0.012), (0.015, 0.0), (-0.01, 0.012))
    assert (task.peg.length, task.hole.clearance) == pytest.approx((0.08, 0.0004))
    assert task.peg.half_extents == pytest.approx((0.015, 0.012))


def test_an_unknown_peg_lists_the_valid_ones() -> None:
    message = refused(lambda: load_task("star"))
    assert message.startswith("unknown peg 'star': valid are circle, d_shape, hexagon, keyed")


def test_an_unknown_level_lists_the_valid_ones() -> None:
    assert refused(lambda: load_task("circle", "L99")).startswith(
        "unknown level 'L99': valid are L0, L1"
    )


def test_a_missing_peg_file_is_named() -> None:
    assert "nowhere.yaml" in refused(lambda: load_task("nowhere.yaml"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("shape: circle\ndiameter_mm: 40\nclearance_mm: -1", "line 3: hole clearance -1 mm"),
        ("shape: circle\ndiameter_mm: 40\nclearance_mm: 0", "clearance 0 mm: it must be 0.1 to"),
        ("shape: circle\ndiameter_mm: 40\nclearance_mm: 0.09", "clearance 0.09 mm"),
        ("shape: circle\ndiameter_mm: 40\nchamfer_mm: -1", "line 3: hole chamfer -1 mm"),
        (
            "shape: circle\ndiameter_mm: 86",
            "line 2: peg 'mine': radius 43 mm; it must be 1 to 42.5",
        ),
        ("shape: circle\ndiameter_mm: 0.04", "is diameter_mm in metres? Write millimetres"),
        ("shape: circle\ndiameter_mm: 40\nlength_mm: 0.08", "; is length_mm in metres? Write mill"),
        (
            "shape: polygon\ncorners_mm: [[-0.02, -0.02], [0.02, -0.02], [0, 0.02]]",
            "; is corners_mm in metres?",
        ),
        ("shape: rectangle\nsize_x_mm: 20\nsize_y_mm: 95", "line 3: peg 'mine': 95 mm along y"),
        ("shape: rectangle\nsize_x_mm: 100\nsize_y_mm: 40", "102 mm wide; the block leaves room"),
        ("shape: rectangle\nsize_x_mm: 40\nsize_y_mm: 86", "it must be 2 to 85 mm, which the"),
        ("shape: rectangle\nsize_x_mm: 20\nsize_y_mm: 130", "130 mm along y"),
        (
            "shape: circle\ndiameter_mm: -40",
            "line 2: diameter_mm is -40: it must be greater than 0",
        ),
        (
            "shape: circle\ndiameter_mm: 40\nlength_mm: 10",
            "line 3: length_mm is 10: it must be greater than or equal to 60",
        ),
        ("shape: circle\ndiameter_mm: forty", "line 2: diameter_mm is forty: it must be a number"),
        (
            "shape: circle\ndiameter_mm: .nan",
            "line 2: diameter_mm is .nan: a number must be finite",
        ),
        (
            "shape: circle\ndiameter_mm: yes",
            "line 2: diameter_mm is yes: some readers take it for true",
        ),
        ("shape: circle", "diameter_mm is missing; start from"),
        (
            "shape: circle\ndiameter_mm: 40\ncolour: red",
            "line 3: there is no field 'colour'; valid are length_mm, clearance_mm, chamfer_mm, ",
        ),
        (
            "shape: star\n",
            "line 1: shape is star: it must be one of 'circle', 'rectangle', 'polygon'",
        ),
        ("diameter_mm: 40", "shape is missing; start from"),
        ("shape: polygon", "corners_mm is missing"),
        (
            "shape: polygon\ncorners_mm: [[0, 1], [2]]",
            "line 2: corners_mm (item 2) is [2]: item 2 is missing",
        ),
        (
            "shape: polygon\ncorners_mm: [[0, 1], [2, three]]",
            "line 2: corners_mm (item 2) (item 2) is three: it must be a number",
        ),
        (
            "shape: polygon\ncorners_mm: [[0, 1], [.nan, 0]]",
            "line 2: corners_mm (item 2) (item 1) is .nan: a number must be finite",
        ),
        (
            "shape: polygon\ncorners_mm: []",
            "line 2: corners_mm is []: it should have at least 3 items, not 0",
        ),
        (
            "shape: circle\ndiameter_m: 40",
            "line 2: there is no field 'diameter_m'; did you mean 'diameter_mm'?",
        ),
        (
            "shape: circl\n",
            "line 1: shape is circl: it must be one of 'circle', 'rectangle', 'polygon'; did you",
        ),
        (
            'shape: circle\ndiameter_mm: "40"',
            'line 2: diameter_mm is "40": it must be a number: without quotes',
        ),
        ("shape: circle\ndiameter_mm: true", "line 2: diameter_mm is true: it must be a number"),
        ("- shape: circle\n", "holds no fields"),
        ("shape: [circle", "is not YAML"),
        ("", "holds no fields"),
    ],
)
def test_a_peg_file_that_cannot_be_used_says_why_in_one_line(
    peg_file: WritePeg, text: str, says: str
) -> None:
    path = peg_file(text)
    assert says in refused(lambda: load_task(path))


def test_a_peg_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.yaml"
    path.write_bytes(b"\xff\xfe\x00\x80")
    assert "noise.yaml" in refused(lambda: load_task(str(path)))


def test_a_rectangle_of_negative_size_is_refused(peg_file: WritePeg) -> None:
    path = peg_file("shape: rectangle\nsize_x_mm: -40\nsize_y_mm: -20")
    assert "-40" in refused(lambda: load_task(path))


def test_a_peg_is_a_disc_or_a_polygon_not_both() -> None:
    square = ((-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01))
    assert "either" in refused(lambda: Peg(name="p", radius=0.01, outline=square))
    assert "either" in refused(lambda: Peg(name="p"))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_wrist_without_stiffness_is_refused(value: float) -> None:
    assert "stiffness_z" in refused(lambda: Wrist(stiffness_z=value))


def test_a_chamfer_that_reaches_the_blocks_edge_is_refused() -> None:
    peg = Peg(name="wide", radius=0.042)
    assert "106 mm wide" in refused(lambda: Task(peg=peg, hole=Hole(chamfer=0.010)))


# --- what a trial draws ------------------------------------------------------------------------


def test_the_papers_four_conditions_randomise_what_the_paper_says() -> None:
    drawn = {name: set(c.ranges) for name, c in CONDITIONS.items()}
    assert drawn == {
        "none": set(),
        "friction": {"friction"},
        "pose": {"hole_y", "grasp_roll"},
        "all": {"friction", "hole_y", "grasp_roll"},
    }
    assert PAPER_RANGES["friction"] == (1.0, 5.0)
    assert PAPER_RANGES["hole_y"] == (-0.02, 0.02)
    assert PAPER_RANGES["grasp_roll"] == pytest.approx((math.radians(-5), math.radians(5)))


@given(SEEDS)
def test_a_seed_draws_the_same_quantities_in_every_condition(seed: int) -> None:
    everything = CONDITIONS["all"].draw(seed).quantities()
    for chosen in CONDITIONS.values():
        for name, value in chosen.draw(seed).quantities().items():
            assert value == (everything[name] if name in chosen.ranges else NOMINAL[name])


@given(SEEDS, st.sampled_from(sorted(CONDITIONS)))
def test_a_draw_stays_in_its_range(seed: int, name: str) -> None:
    chosen = CONDITIONS[name]
    drawn = chosen.draw(seed).quantities()
    assert all(low <= drawn[q] <= high for q, (low, high) in chosen.ranges.items())


@given(st.data(), SEEDS)
def test_a_range_can_be_set_and_is_respected(data: st.DataObject, seed: int) -> None:
    quantity = data.draw(st.sampled_from(sorted(NOMINAL)))
    least, most = QUANTITIES[quantity].valid
    low, high = sorted(data.draw(st.tuples(st.floats(least, most), st.floats(least, most))))
    mine = Condition(name="mine", ranges={quantity: (low, high)})
    drawn = getattr(mine.draw(seed), quantity)
    assert low <= (abs(drawn) if QUANTITIES[quantity].two_sided else drawn) <= high


def test_draws_fill_their_range_and_do_not_follow_each_other() -> None:
    setups = [CONDITIONS["all"].draw(seed) for seed in range(400)]
    for quantity, (low, high) in PAPER_RANGES.items():
        parts = sorted((getattr(s, quantity) - low) / (high - low) for s in setups)
        assert parts[0] < 0.02
        assert parts[-1] > 0.98
        assert 0.45 < sum(parts) / len(parts) < 0.55
    same_side = sum((s.hole_y > 0) == (s.grasp_roll > 0) for s in setups)
    assert 160 < same_side < 240


def test_no_condition_leaves_everything_nominal() -> None:
    assert CONDITIONS["none"].draw(7) == Setup(seed=7)


def test_an_unknown_condition_lists_the_valid_ones() -> None:
    message = refused(lambda: condition("wind"))
    assert message == "unknown condition 'wind': valid are none, friction, pose, all"


def test_an_unknown_quantity_lists_the_valid_ones() -> None:
    message = refused(lambda: Condition(name="mine", ranges={"gravity": (0, 1)}))
    assert message.startswith("unknown quantity 'gravity': valid are friction, hole_y, grasp_roll")


@pytest.mark.parametrize(
    "bounds", [(2.0, 1.0), (0.0, 1.0), (1.0, 100.0), (math.nan, 1.0), (1.0, math.inf)]
)
def test_a_range_that_cannot_be_is_refused(bounds: tuple[float, float]) -> None:
    message = refused(lambda: Condition(name="mine", ranges={"friction": bounds}))
    assert "friction" in message
    assert "0.05 to 20" in message
