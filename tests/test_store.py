"""Records to a folder and back."""

import json
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.conditions import condition
from pliant.errors import InputError
from pliant.experiment.one import Spec, perform
from pliant.methods.named import method
from pliant.reasoners.rules import Rules
from pliant.records import Case, Trial
from pliant.sim import replay
from pliant.sim.cell import SimCell, Trajectory
from pliant.store import (
    load_case,
    load_trial,
    prepare_folder,
    save_case,
    save_trial,
    write_run_json,
)
from pliant.task import load_task
from pliant.teaching import shipped


@pytest.fixture(scope="module")
def ran() -> tuple[Trial, Trajectory]:
    cell = SimCell()
    spec = Spec(task=load_task("circle"), condition=condition("pose"), seed=3, reasoner="none")
    return perform(spec, cell, shipped()), cell.trajectory()


@pytest.fixture(scope="module")
def trial(ran: tuple[Trial, Trajectory]) -> Trial:
    return ran[0]


def leaves(value: Any) -> Iterator[Any]:
    """Everything in a record, arrays as they are stored: to six digits."""
    if isinstance(value, np.ndarray):
        yield value.shape
        yield value.tobytes() if value.dtype == np.uint8 else [f"{v:.6g}" for v in value.ravel()]
    elif isinstance(value, dict):
        for key, item in value.items():
            yield type(key), key
            yield from leaves(item)
    elif isinstance(value, tuple):
        yield len(value)
        for item in value:
            yield from leaves(item)
    elif hasattr(value, "__dataclass_fields__"):
        yield type(value)
        yield from leaves({name: getattr(value, name) for name in value.__dataclass_fields__})
    else:
        yield isinstance(value, str) or type(value), value


def same(one: object, other: object) -> bool:
    return list(leaves(one)) == list(leaves(other))


def case_of(trial: Trial) -> Case:
    *history, last = trial.executions
    return Case(
        task=trial.task,
        teaching=shipped(),
        goals=trial.goals,
        history=tuple(history),
        outcome=last.outcome,
        evidence=last.evidence,
        belief=last.belief,
        method=method(trial.method),
    )


def test_a_trial_reads_back_as_it_was(trial: Trial, tmp_path: Path) -> None:
    save_trial(tmp_path, trial)
    assert same(load_trial(tmp_path), trial)


def test_a_trial_without_an_execution_reads_back(trial: Trial, tmp_path: Path) -> None:
    empty = replace(trial, executions=(), truths=(), end_reason="fault:lost", fault="no answer")
    save_trial(tmp_path, empty)
    assert same(load_trial(tmp_path), empty)


def test_a_picture_is_stored_once_and_nothing_is_left_half_written(
    trial: Trial, tmp_path: Path
) -> None:
    save_trial(tmp_path, replace(trial, executions=trial.executions * 2))
    save_trial(tmp_path, trial)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["pictures", "trial.json"]
    pictures = list((tmp_path / "pictures").iterdir())
    assert len(pictures) == len(trial.executions)
    assert all(p.suffix == ".png" and len(p.stem) == 16 for p in pictures)


def test_a_stored_case_can_be_judged_again(trial: Trial, tmp_path: Path) -> None:
    case = case_of(trial)
    save_case(tmp_path, case)
    again = load_case(tmp_path)
    assert same(again, case)
    assert Rules().judge(again) == Rules().judge(case)


def _edit(folder: Path, path: list[Any], value: Any) -> None:
    document = json.loads((folder / "trial.json").read_text(encoding="utf-8"))
    inner = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    (folder / "trial.json").write_text(json.dumps(document), encoding="utf-8")


def _view(name: str) -> list[Any]:
    look = ["trial", "executions", 0, "outcome", "looks", 0]
    return [*look, "observation", "views", "side", name]


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (["schema"], 99, "schema 99"),
        (["trial"], {}, "broken at trial_id"),
        (["trial", "seed"], "three", "broken at seed"),
        (["trial", "task", "peg", "radius"], 9.0, "radius 9000 mm"),
        (["trial", "executions", 0, "outcome", "motions", 0, "trace", "time_s"], {}, "time_s"),
        (_view("image"), "../../../secret", "not a hash"),
        (_view("image"), "0123456789abcdef", "missing or broken"),
        (_view("image"), None, "not a hash"),
    ],
)
def test_a_broken_trial_is_refused_in_one_line(
    trial: Trial, tmp_path: Path, path: list[Any], value: Any, says: str
) -> None:
    save_trial(tmp_path, trial)
    _edit(tmp_path, path, value)
    with pytest.raises(InputError, match=says) as refused:
        load_trial(tmp_path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[1, 2]", b'{"schema": 1}', b"[" * 100_000])
def test_a_file_that_is_no_trial_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "trial.json").write_bytes(content)
    with pytest.raises(InputError) as refused:
        load_trial(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_missing_trial_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_trial(tmp_path)


def test_a_picture_that_was_changed_is_refused(trial: Trial, tmp_path: Path) -> None:
    save_trial(tmp_path, trial)
    first, second, *_ = sorted((tmp_path / "pictures").iterdir())
    first.write_bytes(second.read_bytes())
    with pytest.raises(InputError, match="not the one that was stored"):
        load_trial(tmp_path)


def test_a_place_that_cannot_be_written_is_refused(trial: Trial, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        save_trial(tmp_path / "file" / "inside", trial)


# --- the output folder -------------------------------------------------------------------------


def test_a_new_an_empty_and_an_own_folder_may_be_used(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    prepare_folder(folder)
    prepare_folder(folder)
    write_run_json(folder, configuration={}, reasoner="rules", model=None)
    prepare_folder(folder)


def test_a_folder_with_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="holds something else"):
        prepare_folder(tmp_path)
    with pytest.raises(InputError, match="cannot be used"):
        prepare_folder(tmp_path / "thesis.tex")


def test_a_run_says_what_made_it(tmp_path: Path) -> None:
    write_run_json(tmp_path, configuration={"seeds": [0, 20]}, reasoner="vlm", model="qwen")
    run = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert run["configuration"] == {"seeds": [0, 20]}
    assert (run["reasoner"], run["model"]) == ("vlm", "qwen")
    assert set(run["versions"]) == {"python", "pliant", "mujoco", "opencv", "numpy"}
    assert (run["commit"] is None) == (run["dirty"] is None)


# --- the trajectory ----------------------------------------------------------------------------


def test_a_trajectory_reads_back_as_it_was(ran: tuple[Trial, Trajectory], tmp_path: Path) -> None:
    before = ran[1]
    replay.save(tmp_path, before)
    after = replay.load(tmp_path)
    assert after.setup == before.setup
    assert np.array_equal(after.time_s, before.time_s)
    assert np.array_equal(after.qpos, before.qpos)
    assert [p.name for p in tmp_path.iterdir()] == ["trajectory.npz"]


def test_a_broken_trajectory_is_refused_and_runs_no_code(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        replay.load(tmp_path)
    for content in (b"", b"PK\x03\x04 cut off", pickle.dumps([1])):
        (tmp_path / "trajectory.npz").write_bytes(content)
        with pytest.raises(InputError, match="is broken"):
            replay.load(tmp_path)
    with (tmp_path / "trajectory.npz").open("wb") as file:
        np.savez(file, time_s=np.zeros(1), qpos=np.array([[object()]]))
    with pytest.raises(InputError, match="is broken"):
        replay.load(tmp_path)
