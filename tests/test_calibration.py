"""What a cell finds out about itself, and what it refuses to believe."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from stand_ins import cell_for, picture, prepared, side_camera

from pliant.calibration import camera, colours, file, tour, wrist
from pliant.calibration.camera import CalibrationShot, CameraFound
from pliant.calibration.outline import Hang, Points, block_points, outside, peg_points, project
from pliant.calibration.wrist import Press
from pliant.cell import Camera
from pliant.cli.calibrate import calibrate
from pliant.cli.usages import CALIBRATE
from pliant.conditions import Setup
from pliant.envelope import Guarded, Limits
from pliant.errors import InputError, RobotFault
from pliant.pose import Pose, rotation_matrix
from pliant.task import load_task
from pliant.ur5e import configuration
from pliant.vision.measure import SIMULATED, Colours, measure

SIZE = (640, 480)
HOLE = np.zeros(3)
LEANING = Setup(seed=0, hole_y=0.012, grasp_roll=math.radians(-4.0))
ABOVE_BOARD = np.array(
    [(x, y, z) for x in (-0.02, 0.06) for y in (-0.05, 0.05) for z in (0.0, 0.1)]
)


@cache
def toured() -> tuple[CalibrationShot, ...]:
    """The simulated cell's tour, with a peg at an angle and a hole to the side."""
    robot = Guarded(prepared("square", LEANING), Limits())
    taken = tour.travel(robot, load_task("square"))
    return tuple(t.shot for t in taken if t.shot is not None)


def furthest_px(one: Camera, other: Camera) -> float:
    off = project(one, ABOVE_BOARD) - project(other, ABOVE_BOARD)
    return float(np.max(np.linalg.norm(off, axis=1)))


def drawn(true: Camera, hang: Hang, noise_px: float = 0.0) -> list[CalibrationShot]:
    """Outlines as a perfect camera would see them, without pictures."""
    task, random = load_task("square"), np.random.default_rng(1)

    def outline(corners: Points) -> Points:
        hull = cv2.convexHull(corners.astype(np.float32)).reshape(-1, 2)
        ends = np.roll(hull, -1, axis=0)
        points = [
            a + (b - a) * s for a, b in zip(hull, ends, strict=True) for s in np.arange(20) / 20
        ]
        return np.array(points) + random.normal(0.0, noise_px, (len(points), 2))

    block = outline(project(true, block_points(0.004)))
    return [
        CalibrationShot(
            pose=pose, peg=outline(project(true, peg_points(task, pose, hang))), block=block
        )
        for pose in tour.stops(task)
    ]


# --- the camera --------------------------------------------------------------------------------


def test_the_simulators_own_camera_is_found_with_a_peg_at_an_unknown_angle() -> None:
    found = camera.calibrate(toured(), load_task("square"), SIZE, leave_out=False)

    assert furthest_px(found.camera, side_camera()) < 0.8  # half a millimetre
    assert found.camera.focal_px == pytest.approx(side_camera().focal_px, rel=0.05)
    assert found.hang.grasp_roll == pytest.approx(LEANING.grasp_roll, abs=math.radians(0.3))
    assert found.block_y == pytest.approx(LEANING.hole_y, abs=0.0005)
    assert found.total_rms_px < camera.WORST_RMS_PX


@pytest.mark.parametrize("focal_px", [450.0, 2400.0])
def test_any_lens_is_found_wherever_the_camera_stands(focal_px: float) -> None:
    true = replace(
        side_camera(),
        focal_px=focal_px,
        position=np.array([0.25 + focal_px * 5e-4, -0.08, 0.12]),
        rotation=side_camera().rotation @ rotation_matrix(-0.1, -0.08, 0.05),
    )
    hang = Hang(reach=0.003, sag=0.007, droop=0.7, grasp_roll=0.06, grasp_pitch=-0.02)

    found = camera.calibrate(drawn(true, hang, 0.2), load_task("square"), SIZE, leave_out=False)

    assert furthest_px(found.camera, true) < 0.8
    assert math.hypot(*np.subtract(found.camera.project(HOLE), true.project(HOLE))) < 0.4
    assert found.hang.grasp_roll == pytest.approx(hang.grasp_roll, abs=0.003)


def test_how_well_the_hole_is_known_is_told_and_one_bad_picture_stands_out() -> None:
    shots, task = list(toured())[:10], load_task("square")
    good = camera.calibrate(shots, task, SIZE)
    assert good.problem() is None
    _, z = good.camera.on_plane_x(*side_camera().project(np.zeros(3)), 0.0)
    assert abs(z) < 2 * good.sd_at_hole_m[1]

    slipped = replace(shots[5], peg=shots[5].peg + np.array([6.0, 0.0]))
    bad = camera.calibrate([*shots[:5], slipped, *shots[6:]], task, SIZE)
    assert "picture 6" in str(bad.problem())


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rms_px": (0.9, 0.9)}, "outlines are 0.90 px off"),
        ({"left_out_px": (0.4, 1.5)}, "picture 2, left out"),
        ({"sd_at_hole_m": (0.0002, 0.0008)}, "known to 0.80 mm only"),
    ],
)
def test_a_poor_calibration_is_refused_with_what_to_do(changed: dict[str, Any], words: str) -> None:
    found = CameraFound(
        camera=side_camera(),
        hang=Hang(),
        block_y=0.0,
        rms_px=(0.3, 0.3),
        left_out_px=(0.4, 0.4),
        sd_at_hole_m=(0.0002, 0.0002),
    )
    assert found.problem() is None
    problem = replace(found, **changed).problem()
    assert problem is not None
    assert words in problem


def test_too_few_pictures_or_none_of_the_block_are_refused() -> None:
    shots, task = toured(), load_task("square")
    with pytest.raises(InputError, match="7 pictures show the whole peg"):
        camera.calibrate(shots[:7], task, SIZE)
    with pytest.raises(InputError, match="whole block"):
        camera.calibrate([replace(shot, block=None) for shot in shots], task, SIZE)


def test_the_outside_of_an_outline_counts_above_zero() -> None:
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    for corners in (square, square[::-1]):
        off = outside(np.array([[5.0, 5.0], [12.0, 5.0], [5.0, 1.0]]), corners)
        assert off == pytest.approx([-5.0, 2.0, -1.0], abs=1e-5)


def test_the_tour_keeps_clear_of_the_board_and_stops_when_something_is_in_the_way() -> None:
    task = load_task("circle")
    hang = Hang(sag=0.009, droop=0.9)
    for pose in tour.stops(task):
        assert peg_points(task, pose, hang)[:, 2].min() > 0.015
    robot = prepared()
    robot.move_to(Pose(z=0.18), speed_m_s=0.05, stop_at_compression_m=0.02)
    blocked = Guarded(_Blocked(), Limits())  # type: ignore[arg-type]
    with pytest.raises(RobotFault, match="in the arm's way"):
        tour.travel(blocked, task)


# --- the wrist ---------------------------------------------------------------------------------


@pytest.mark.parametrize("angle_deg", [0.0, 5.0])
def test_the_wrists_stiffness_is_found_by_pressing(angle_deg: float) -> None:
    robot = prepared("square", Setup(seed=0, grasp_roll=math.radians(angle_deg)))
    task = load_task("square")

    pressed = wrist.press(Guarded(robot, Limits()), task)
    found = wrist.evaluate(pressed, 1000.0)

    assert found.stiffness_n_m == pytest.approx(task.wrist.stiffness_z, rel=0.01)
    assert found.problem() is None
    assert pressed.compression_m.max() < 0.008
    assert robot.pose().z > task.tip_below_hinge + 0.02  # above the board again


def readings(slope: float, *, gap: float = 0.0, bend: float = 0.0, noise: float = 0.0) -> Press:
    """Three presses by 6 mm: `slope` reported per real metre, a `gap` [m] on the way back, a `bend`
    from the line at the end, as a share of it."""
    depth = np.arange(-0.002, 0.006, 0.0005)
    real = np.concatenate([depth, depth[::-1]] * 3)
    back = np.tile(np.repeat([False, True], len(depth)), 3)
    share = np.maximum(real, 0.0) / 0.006
    reported = slope * np.maximum(real, 0.0) * (1 + bend * share**2) - gap * back * (real > 0)
    reported += np.random.default_rng(0).normal(0.0, noise, len(real))
    return Press(height_m=0.19 - real, compression_m=reported, is_release=back)


@given(st.floats(0.2, 4.0))
def test_a_wrong_stiffness_in_the_file_is_put_right(slope: float) -> None:
    found = wrist.evaluate(readings(slope, noise=2e-5), 1000.0)
    assert found.stiffness_n_m == pytest.approx(1000.0 * slope, rel=0.05)
    assert found.touch_m == pytest.approx(0.19, abs=0.0005)
    assert found.problem() is None


@given(st.floats(0.2, 4.0))
def test_a_wrong_sign_in_the_file_is_refused(slope: float) -> None:
    with pytest.raises(InputError, match=r"turn wrist\.sign round"):
        wrist.evaluate(readings(-slope, noise=2e-5), 1000.0)


@pytest.mark.parametrize(
    ("press", "words"),
    [
        (lambda: readings(1.0, bend=2.0), "not in proportion"),
        (lambda: readings(1.0, noise=0.0008), "known to"),
        (lambda: readings(1.0, gap=0.0012), "pressing and releasing differ"),
    ],
)
def test_a_wrist_that_does_not_answer_like_a_spring_is_refused(
    press: Callable[[], Press], words: str
) -> None:
    assert words in str(wrist.evaluate(press(), 1000.0).problem())


def test_pressing_that_is_not_felt_is_refused() -> None:
    with pytest.raises(InputError, match=r"hardly felt.*wrist\.axis is z"):
        wrist.evaluate(readings(0.001), 1000.0)


# --- colours -----------------------------------------------------------------------------------


@pytest.mark.parametrize("hue_shift", [0, 87])
def test_picked_colours_measure_as_well_as_the_known_ones(hue_shift: int) -> None:
    """Also where the hues lie around red, for the peg or for the block."""
    view = picture(prepared("circle", LEANING))
    known = measure(view, load_task("circle"))
    hsv = cv2.cvtColor(view.image, cv2.COLOR_RGB2HSV)
    hsv[..., 0] = (hsv[..., 0].astype(int) + hue_shift) % 180
    image = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB).astype(np.uint8)

    picked = Colours(
        peg=colours.widen([image], colours.pick(image, 320, 120, "peg")),
        block=colours.widen([image], colours.pick(image, 320, 350, "block")),
    )
    assert colours.evaluate([image], picked).problem() is None
    seen = measure(replace(view, image=image), load_task("circle"), picked)
    assert known.peg is not None
    assert seen.peg is not None
    assert known.hole is not None
    assert seen.hole is not None
    assert seen.peg.tip_y.value == pytest.approx(known.peg.tip_y.value, abs=0.0006)
    assert seen.hole.y.value == pytest.approx(known.hole.y.value, abs=0.0006)


def test_a_pixel_that_is_no_part_is_refused() -> None:
    image = picture(prepared()).image
    with pytest.raises(InputError, match="nearly grey"):
        colours.pick(image, 20, 20, "peg")
    with pytest.raises(InputError, match="not in the picture"):
        colours.pick(image, 700, 20, "peg")


def test_a_second_thing_of_the_same_colour_is_refused() -> None:
    image = picture(prepared()).image.copy()
    image[300:400, 10:110] = image[120, 320]  # of the peg's colour
    assert "elsewhere" in str(colours.evaluate([image], SIMULATED).problem())
    same = replace(SIMULATED, block=SIMULATED.peg)
    assert "same colour" in str(colours.evaluate([picture(prepared()).image], same).problem())


# --- the file ----------------------------------------------------------------------------------


@pytest.fixture
def example(tmp_path: Path) -> Path:
    path = tmp_path / "cell.yaml"
    path.write_text(
        (files("pliant") / "ur5e" / "example.yaml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    return path


def test_calibrated_values_replace_the_old_ones_and_nothing_else(example: Path) -> None:
    before = example.read_text(encoding="utf-8")
    lines = file.put(
        example,
        {
            "camera": {"focal_px": 912.5, "position_mm": [800.0, 1.5, -2.0]},
            "colours": {"peg": (((1, 2, 3), (4, 5, 6)),)},
        },
    )
    after = configuration.load(example)
    assert after.camera.focal_px == 912.5
    assert after.colours is not None
    assert after.colours.peg == (((1, 2, 3), (4, 5, 6)),)
    assert lines[0] == "camera.focal_px: 1823 -> 912.5"
    changed = [
        (old, new)
        for old, new in zip(
            before.splitlines(), example.read_text(encoding="utf-8").splitlines(), strict=True
        )
        if old != new
    ]
    assert len(changed) == 3
    assert all(old.partition("#")[2] == new.partition("#")[2] for old, new in changed)


@pytest.mark.parametrize(
    "form",
    [
        "",  # the section is absent
        "colours: null # none yet\n",
        "colours: {}\n",
        "colours: {peg: [[[9, 9, 9], [9, 9, 9]]]}\n",
        "colours:\n  # why\n  peg:\n    - - [9, 9, 9]\n      - [9, 9, 9] # this\n  # after\n",
    ],
)
def test_a_section_is_written_however_the_file_has_it(example: Path, form: str) -> None:
    text = example.read_text(encoding="utf-8")
    start, end = text.index("colours:"), text.index("goals:")
    example.write_text(text[:start] + form + "\n" + text[end:], encoding="utf-8")
    values = {"peg": [[[1, 2, 3], [4, 5, 6]]], "block": [[[7, 8, 9], [10, 11, 12]]]}
    file.put(example, {"colours": values})
    assert yaml.safe_load(example.read_text(encoding="utf-8"))["colours"] == values
    assert configuration.load(example).goals is None


def test_a_value_that_is_not_valid_leaves_the_file_as_it_was(example: Path) -> None:
    before = example.read_bytes()
    with pytest.raises(InputError, match=r"cell\.yaml', line 69: camera\.focal_px is -3\.0"):
        file.put(example, {"wrist": {"sign": -1}, "camera": {"focal_px": -3.0}})
    assert example.read_bytes() == before
    assert list(example.parent.iterdir()) == [example]


def test_an_entry_that_is_commented_out_is_not_the_one_that_counts(example: Path) -> None:
    text = example.read_text(encoding="utf-8")
    text = text.replace("  focal_px:", "  # focal_px: 1  # focal_px: 2\n  focal_px:")
    example.write_text(text, encoding="utf-8")
    file.put(example, {"camera": {"focal_px": 912.5}})
    assert "  # focal_px: 1  # focal_px: 2\n  focal_px: 912.5 " in example.read_text(
        encoding="utf-8"
    )


def test_a_file_with_an_entry_twice_is_not_calibrated(example: Path) -> None:
    with example.open("a", encoding="utf-8") as more:
        more.write("wrist: {stiffness_n_mm: 2.0}\n")
    before = example.read_bytes()
    with pytest.raises(InputError, match="'wrist' stands on line 47 already"):
        file.put(example, {"wrist": {"sign": -1}})
    assert example.read_bytes() == before


@pytest.mark.parametrize("mark", ["", "\N{BOM}"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_line_ends_mode_and_links_stay(example: Path, end: str, mark: str) -> None:
    text = (mark + "# größe µ\n" + example.read_text(encoding="utf-8")).replace("\n", end)
    text = text.partition("colours:")[0]
    example.write_bytes(text.encode())
    example.chmod(0o600)
    link = example.parent / "there" / "link.yaml"
    link.parent.mkdir()
    link.symlink_to("../cell.yaml")
    file.put(
        link,
        {
            "camera": {"focal_px": 912.5},
            "limits": {"speed_mm_s": 50.0},
            "colours": {"peg": [[[1, 2, 3], [4, 5, 6]]], "block": [[[7, 8, 9], [9, 9, 9]]]},
        },
    )
    after = example.read_bytes().decode()
    assert after.startswith(mark + "# größe µ" + end)
    assert after.count("\n") == after.count(end) == text.count(end) + 3
    assert link.is_symlink()
    assert example.stat().st_mode & 0o777 == 0o600
    assert configuration.load(link).limits.speed_mm_s == 50.0


@pytest.mark.parametrize(
    ("camera", "after"),
    [
        (
            "position_mm: [1200, # far\n    0,\n    0] # from here",
            "position_mm: [1.5, # far\n    2.5,\n    3.5] # from here",
        ),
        (
            "position_mm:\n  - 1200 # far\n  # and\n  - 0\n  - 0 # from here",
            "position_mm:\n  - 1.5 # far\n  # and\n  - 2.5\n  - 3.5 # from here",
        ),
        (
            "position_mm:\n    # this\n    [1200, 0, 0]",
            "position_mm:\n    # this\n    [1.5, 2.5, 3.5]",
        ),
    ],
)
def test_comments_within_a_value_stay(example: Path, camera: str, after: str) -> None:
    text = example.read_text(encoding="utf-8")
    assert "position_mm: [1200, 0, 0]" in text
    example.write_text(text.replace("position_mm: [1200, 0, 0]", camera), encoding="utf-8")
    file.put(example, {"camera": {"position_mm": (1.5, 2.5, 3.5)}})
    assert example.read_text(encoding="utf-8") == text.replace("position_mm: [1200, 0, 0]", after)


@pytest.mark.parametrize("wrist", ["{stiffness_n_mm: 1, }", "{stiffness_n_mm: 1, # a, b\n }"])
def test_a_field_is_added_where_a_comma_ends_a_section(example: Path, wrist: str) -> None:
    text = example.read_text(encoding="utf-8")
    start, end = text.index("wrist:"), text.index("gripper:")
    example.write_text(f"{text[:start]}wrist: {wrist}\n{text[end:]}", encoding="utf-8")
    file.put(example, {"wrist": {"sign": -1}})
    assert configuration.load(example).wrist.sign == -1


def test_a_layout_that_cannot_be_edited_is_said_and_left(example: Path) -> None:
    text = example.read_text(encoding="utf-8")
    start, end = text.index("wrist:"), text.index("gripper:")
    odd = f"{text[:start]}? wrist\n: stiffness_n_mm: 1\n{text[end:]}"
    example.write_text(odd, encoding="utf-8")
    with pytest.raises(InputError, match=r"line 47: wrist\.sign cannot be put .* 'sign: -1'"):
        file.put(example, {"wrist": {"sign": -1}})
    assert example.read_text(encoding="utf-8") == odd


# --- the command -------------------------------------------------------------------------------


def test_the_command_finds_the_simulated_cells_colours_and_wrist(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pliant.sim.cell.SimCell", lambda: cell_for("circle"))
    (example,) = (line.split() for line, _ in CALIBRATE.examples if "--peg-at" in line)
    picked: dict[str, Any] = {"out": tmp_path}
    for name in ("peg-at", "block-at"):  # where the page of help points
        u, v = example[example.index(f"--{name}") + 1 :][:2]
        picked[name.replace("-", "_")] = int(u), int(v)
    for what in ("colours", "wrist"):
        assert calibrate(what, condition="pose", seed=3, **picked) == 0
    said = capsys.readouterr().out
    assert "block: HSV (0, " in said
    assert "1.000 ± 0.000 N/mm" in said
    assert [p.name for p in tmp_path.iterdir()] == ["colours.png"]


def test_without_a_terminal_the_command_asks_for_pixels_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    with pytest.raises(InputError, match="--peg-at and --block-at"):
        calibrate("colours", peg_at=(1, 1))


class _Blocked:
    """A robot whose every motion ends by compression."""

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> object:
        from stand_ins import motion_to

        from pliant.cell import Stop

        return motion_to(pose, pose, Stop.COMPRESSION)

    def halt(self) -> None:
        """Nothing moves."""
