"""`pliant calibrate` on the emulated UR5e: a cell whose file is wrong calibrates itself, and then
inserts."""

import math
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from ur5e_emulated import cell_at

from pliant.calibration import file
from pliant.cli.calibrate import calibrate
from pliant.conditions import condition
from pliant.emulator.client import started
from pliant.experiment.one import Spec, perform
from pliant.experiment.where import Where
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.ur5e import configuration as c

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST = "127.0.0.87"
WRONG_CAMERA = {"focal_px": 1500.0, "position_mm": [900, 40, 30], "rotation_deg": [-85, 3, 95]}
WRONG_WRIST = {"stiffness_n_mm": 2.0}
WRONG_COLOURS = {"peg": [[[20, 50, 50], [30, 255, 255]]], "block": [[[50, 50, 50], [60, 255, 255]]]}


def miscalibrated(path: Path, true: c.Configuration) -> None:
    """The example with the emulated cell's frames and connections, and wrong calibrations."""
    path.write_text(
        (files("pliant") / "ur5e" / "example.yaml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    known = true.model_dump(mode="json", exclude_none=True)
    sections = ("arm", "tcp", "payload", "task_frame", "workspace", "patience", "emulator")
    fields = {name: known[name] for name in sections}
    source = {name: known["camera"][name] for name in ("source", "where", "width", "height")}
    fields["camera"] = source | WRONG_CAMERA
    fields["emulator"]["ticks_per_look"] = 10  # half as many grants
    file.put(path, fields | {"wrist": WRONG_WRIST, "colours": WRONG_COLOURS})


def test_a_wrong_file_is_calibrated_by_the_cell_itself_and_then_the_peg_goes_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cell.yaml"
    with started("--host", HOST, "--mode", "lockstep"):
        true = cell_at(HOST)
        miscalibrated(path, true)

        status = calibrate(
            cell=str(path),
            condition="all",
            seed=4,
            peg_at=(320, 120),
            block_at=(320, 350),
            out=tmp_path,
        )

        assert status == 0, capsys.readouterr().out
        found = c.load(path)
        hole = np.array([[0.0, y, z] for y in (-0.04, 0.0, 0.04) for z in (0.0, 0.05)])
        for point in hole:
            off = np.subtract(
                found.camera.calibration.project(point), true.camera.calibration.project(point)
            )
            assert np.linalg.norm(off) < 0.8  # [px], half a millimetre
        assert math.isclose(found.wrist.stiffness_n_mm, true.wrist.stiffness_n_mm, rel_tol=0.05)
        assert "# roll, pitch, yaw of its axes" in path.read_text(encoding="utf-8")

        where = Where(file=path)
        with where.open() as cell:  # type: ignore[attr-defined]
            spec = Spec(
                task=load_task("circle"), condition=condition("all"), seed=4, reasoner="rules"
            )
            trial = perform(spec, cell, shipped(), limits=where.limits, colours=where.colours)
    assert trial.inserted
