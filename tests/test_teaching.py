import shutil
from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.formations import OWNED, Formation
from pliant.pose import Axis, Pose
from pliant.teaching import load, save, shipped

Edit = Callable[[dict[str, Any]], None]


@pytest.fixture
def goal_file(tmp_path: Path) -> Path:
    """A copy of the shipped goals, to be broken."""
    with as_file(files("pliant") / "goals") as folder:
        shutil.copytree(folder, tmp_path / "goals")
    return tmp_path / "goals" / "goals.yaml"


def edit(path: Path, change: Edit) -> None:
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(yaml.safe_dump(document), encoding="utf-8")


def refused(path: Path, limits: Limits | None = None) -> str:
    with pytest.raises(InputError) as error:
        load(path, limits)
    message = str(error.value)
    assert "\n" not in message
    assert str(path) in message
    return message


# --- what ships --------------------------------------------------------------------------------


def test_the_shipped_goals_name_exactly_the_owned_axes_and_lie_in_the_workspace() -> None:
    for formation, goal in shipped().goals.formations.items():
        assert set(goal) == set(OWNED[formation])
        assert Limits().outside(goal) is None


def test_the_shipped_goals_were_taught_with_the_circle() -> None:
    assert {d.peg for d in shipped().demonstrations.values()} == {"circle"}


def test_every_shipped_goal_picture_shows_peg_and_hole() -> None:
    for formation in Formation:
        scene = shipped().scenes[formation]
        assert scene.peg is not None, scene.problems
        assert scene.hole is not None, scene.problems
        assert scene.hole.y.value == pytest.approx(0.0, abs=0.0005)


def test_the_poses_that_were_reached_agree_with_the_goals() -> None:
    for formation, shown in shipped().demonstrations.items():
        target = shipped().goals.target(formation)
        error = target.error(shown.pose, OWNED[formation])
        assert all(abs(e) < (0.01 if a.is_angle else 0.001) for a, e in error.items())


def test_fit_travels_toward_minus_y_and_align_comes_back_over_the_hole() -> None:
    goals = shipped().goals
    approach, fit, align = (
        goals.target(f).y for f in (Formation.APPROACH, Formation.FIT, Formation.ALIGN)
    )
    assert fit < align < approach
    assert align == pytest.approx(0.0, abs=0.002)


def test_the_last_goal_picture_shows_an_inserted_peg() -> None:
    scene = shipped().scenes[Formation.INSERTION]
    assert scene.peg is not None
    assert scene.hole is not None
    assert scene.hole.surface_z.value - scene.peg.tip_z.value > 0.010


# --- round trip --------------------------------------------------------------------------------


def test_what_is_saved_is_what_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "new" / "goals.yaml"
    save(path, shipped())
    back = load(path)
    assert back.goals == shipped().goals
    for formation in Formation:
        before, after = shipped().demonstrations[formation], back.demonstrations[formation]
        assert after.pose == before.pose
        assert after.peg == before.peg
        assert np.array_equal(after.view.image, before.view.image)
        camera, kept = after.view.camera, before.view.camera
        assert (camera.name, camera.width, camera.height) == (kept.name, kept.width, kept.height)
        assert camera.focal_px == kept.focal_px
        assert np.array_equal(camera.position, kept.position)
        assert np.array_equal(camera.rotation, kept.rotation)
        assert back.scenes[formation] == shipped().scenes[formation]


def test_goals_are_kept_to_a_micrometre(tmp_path: Path, goal_file: Path) -> None:
    edit(goal_file, lambda d: d["formations"]["fit"]["goal"].update(y_mm=-31.2345678))
    path = tmp_path / "again.yaml"
    save(path, load(goal_file))
    assert load(path).goals.formations[Formation.FIT][Axis.Y] == pytest.approx(-0.0312346, abs=1e-6)


def test_goals_are_written_in_millimetres_and_degrees(goal_file: Path) -> None:
    edit(goal_file, lambda d: d["formations"]["fit"].update(goal={"y_mm": -30}))
    assert load(goal_file).goals.formations[Formation.FIT] == {Axis.Y: pytest.approx(-0.030)}


@pytest.mark.parametrize("name", ["fit.png", "goals.yaml"])
def test_goals_are_not_written_through_a_link_to_nothing(tmp_path: Path, name: str) -> None:
    mine, folder = tmp_path / ".config", tmp_path / "theirs"
    folder.mkdir()
    (folder / name).symlink_to(mine)
    save(folder / "goals.yaml", shipped())
    assert not mine.exists()
    assert load(folder / "goals.yaml").goals == shipped().goals


def test_a_goal_picture_is_not_written_through_a_link_to_a_file(tmp_path: Path) -> None:
    mine, folder = tmp_path / "holiday.png", tmp_path / "theirs"
    mine.write_bytes(b"mine")
    folder.mkdir()
    (folder / "fit.png").symlink_to(mine)
    save(folder / "goals.yaml", shipped())
    assert mine.read_bytes() == b"mine"
    assert not (folder / "fit.png").is_symlink()


# --- what cannot be loaded ---------------------------------------------------------------------


def test_a_missing_goal_file_is_named(tmp_path: Path) -> None:
    assert "cannot be read" in refused(tmp_path / "none.yaml")


def test_a_folder_is_no_goal_file(tmp_path: Path) -> None:
    assert "cannot be read" in refused(tmp_path)


@pytest.mark.parametrize("content", [b"goals: [1, 2", b"goals: a: b"])
def test_a_goal_file_that_is_not_yaml_is_refused(goal_file: Path, content: bytes) -> None:
    goal_file.write_bytes(content)
    assert "is not YAML" in refused(goal_file)


@pytest.mark.parametrize("content", ["schema: 2\n", 'schema: "1"\n'])
def test_a_goal_file_of_another_schema_is_refused(goal_file: Path, content: str) -> None:
    goal_file.write_text(content, encoding="utf-8")
    assert "it must be 1" in refused(goal_file)


def test_a_missing_picture_is_named(goal_file: Path) -> None:
    (goal_file.parent / "fit.png").unlink()
    message = refused(goal_file)
    assert "fit.png" in message
    assert "fit" in message


def test_a_broken_picture_is_refused(goal_file: Path) -> None:
    (goal_file.parent / "align.png").write_bytes(b"not a picture")
    assert "align.png" in refused(goal_file)


def test_a_picture_of_another_size_than_its_camera_is_refused(goal_file: Path) -> None:
    edit(goal_file, lambda d: d["camera"].update(size_px=[320, 240]))
    assert "640" in refused(goal_file)


def formation_goal(name: str, **goal: Any) -> Edit:
    return lambda d: d["formations"][name].update(goal=goal)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["formations"].pop("align"), "no goal for align"),
        (
            lambda d: d["formations"].update(fly={}),
            "there is no 'formations.fly'; valid are",
        ),
        (lambda d: d.pop("formations"), "formations is missing"),
        (lambda d: d["formations"].update(fit=3), "formations.fit is 3: it must be a section"),
        (lambda d: d["formations"]["fit"].pop("goal"), "fit.goal is missing"),
        (lambda d: d["formations"]["fit"].pop("pose"), "fit.pose is missing"),
        (lambda d: d.pop("camera"), "camera is missing"),
        (
            lambda d: d["camera"].update(position_m=[1, 2]),
            "position_m is [1, 2]: item 3 is missing",
        ),
        (lambda d: d.update(peg="pentagon"), "unknown peg 'pentagon'"),
        (formation_goal("fit", y_mm="far"), "fit.goal.y_mm is far: it must be a number"),
        (formation_goal("fit", y_mm=float("nan")), "a number must be finite"),
        (formation_goal("fit", y_mm=True), "it must be a number"),
        (
            formation_goal("fit", y_m=0.1),
            "no field 'formations.fit.goal.y_m'; did you mean 'y_mm'?",
        ),
        (formation_goal("fit", y_mm=-30, z_mm=190), "sets z, which fit does not own"),
        (formation_goal("approach", y_mm=26, z_mm=213), "lacks roll"),
        (formation_goal("fit", y_mm=-150), "fit y -150.0 mm is outside the workspace, -99.0 to"),
        (formation_goal("contact", z_mm=50), "contact z 50.0 mm is outside the workspace"),
    ],
)
def test_a_goal_file_that_cannot_be_used_says_why_in_one_line(
    goal_file: Path, change: Edit, says: str
) -> None:
    edit(goal_file, change)
    assert says in refused(goal_file)


def test_the_workspace_is_the_users(goal_file: Path) -> None:
    low, high = Limits().low, Limits().high
    narrow = Limits(low=low, high=Pose(**{a.value: high[a] for a in Axis if a is not Axis.Y}))
    assert "is outside the workspace" in refused(goal_file, narrow)
