"""A cell's file: read, checked, written."""

import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pliant.errors import InputError
from pliant.pose import Axis, pose_from, rotation_matrix
from pliant.ur5e.configuration import CameraSource, Configuration, load, save, transform, ur_pose

EXAMPLE = Path(str(files("pliant") / "ur5e" / "example.yaml"))


def changed(tmp_path: Path, section: str, **fields: Any) -> Path:
    """The example with some fields of a section changed; None leaves a field out."""
    data = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    merged = {**data[section], **fields}
    data[section] = {k: v for k, v in merged.items() if v is not None}
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


def test_the_example_is_valid_and_explains_every_field() -> None:
    load(EXAMPLE)
    text = EXAMPLE.read_text(encoding="utf-8")
    for name, section in Configuration.model_fields.items():
        assert f"{name}:" in text
        kind = getattr(section.annotation, "__args__", (section.annotation,))[0]
        for field in getattr(kind, "model_fields", {}):
            assert f"  {field}:" in text, f"{name}.{field}"


def test_what_is_written_reads_the_same(tmp_path: Path) -> None:
    configuration = load(EXAMPLE)
    save(tmp_path / "cell.yaml", configuration)
    assert load(tmp_path / "cell.yaml") == configuration
    without = configuration.model_copy(update={"gripper": None, "colours": None})
    save(tmp_path / "cell.yaml", without)
    assert load(tmp_path / "cell.yaml") == without


def test_lengths_and_angles_become_si_units() -> None:
    configuration = load(EXAMPLE)
    assert configuration.tcp.pose == pytest.approx([0, 0, 0.055, math.pi, 0, 0])
    assert configuration.workspace.low.y == pytest.approx(-0.1)
    assert configuration.workspace.high.roll == pytest.approx(math.radians(28))
    np.testing.assert_allclose(configuration.task_frame.transform[:3, 3], [0.5, 0.13, 0.14])


def test_the_examples_camera_sees_y_to_the_right_and_z_up() -> None:
    camera = load(EXAMPLE).camera.calibration
    u, v = camera.project(np.array([0.0, 0.01, 0.02]))
    assert u > camera.width / 2
    assert v < camera.height / 2


@pytest.mark.parametrize(
    ("section", "fields", "complaint"),
    [
        ("limits", {"contact_speed_mm_s": 200}, "limits.contact_speed_mm_s is 200: .* 20"),
        ("limits", {"speed": 5}, "there is no field 'limits.speed'"),
        ("arm", {"address": None}, "arm.address is missing"),
        ("wrist", {"sign": 2}, "wrist.sign is 2"),
        ("wrist", {"stiffness_n_mm": math.nan}, "wrist.stiffness_n_mm is .nan: .* finite"),
        ("payload", {"mass_kg": "heavy"}, "payload.mass_kg is heavy"),
        (
            "patience",
            {"driver_ms": 300, "stamp_ms": 400},
            "patience.driver_ms 300: it must be above",
        ),
        ("workspace", {"y_mm": [50, -50]}, "workspace.y_mm: the first number must be below"),
        ("camera", {"source": "http"}, "camera.where: the source http needs"),
        (
            "colours",
            {"peg": [[[200, 0, 0], [10, 0, 0]]]},
            r"colours.peg \(item 1\) \(item 1\) \(item 1\) is 200: .* 179",
        ),
    ],
)
def test_a_field_that_cannot_be_used_is_one_line_with_field_and_value(
    tmp_path: Path, section: str, fields: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        load(changed(tmp_path, section, **fields))
    assert "\n" not in str(caught.value)
    assert "cell.yaml" in str(caught.value)


@pytest.mark.parametrize("text", ["[", "just a text", "", "- 1\n"])
def test_a_file_that_is_no_cell_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="cell file") as caught:
        load(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path / "missing.yaml")


def test_paths_count_from_the_files_folder(tmp_path: Path) -> None:
    path = changed(tmp_path, "camera", source="file", where="recorded.db3")
    assert load(path).camera.source is CameraSource.FILE
    assert load(path).camera.where == str(tmp_path / "recorded.db3")


@given(angles=st.tuples(*[st.floats(-1.5, 1.5)] * 3), position=st.tuples(*[st.floats(-1, 1)] * 3))
def test_a_pose_survives_the_controllers_way_of_writing_it(
    angles: tuple[float, float, float], position: tuple[float, float, float]
) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_matrix(*angles), position
    again = transform(ur_pose(matrix))
    np.testing.assert_allclose(again, matrix, atol=2e-5)  # OpenCV drops smaller turns
    there = pose_from(again[:3, 3], again[:3, :3])
    assert [there[a] for a in Axis][3:] == pytest.approx(angles, abs=2e-5)
