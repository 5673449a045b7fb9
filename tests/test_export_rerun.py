"""A trial's recording, and a LeRobot data set, read by Rerun's own readers."""

import importlib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from stored_run import RECOVERED, store

from pliant.export import lerobot, recording
from pliant.export.source import open_run
from pliant.export.track import track
from pliant.records import Aborted, Trial
from pliant.sim import replay
from pliant.store import save_trial

pytestmark = pytest.mark.system
FPS = 5
LINKS = ["base", "shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link"]
LINKS += ["wrist_2_link", "wrist_3_link"]
MOVING = [f"/world/robot/{link}" for link in LINKS] + ["/world/wrist", "/world/gripper"]
MOVING += ["/world/peg", "/world/board", "/world/springs"]
PLOTS = [f"/plots/{name}/measured" for name in ("y_mm", "z_mm", "roll_deg", "compression_mm")]
PLOTS += [f"/plots/{name}/goal" for name in ("y_mm", "z_mm", "roll_deg")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs") / "run"


@pytest.fixture(scope="module")
def trial(folder: Path) -> Trial:
    """As if a fault had ended it during another execution."""
    whole = store(folder)[RECOVERED]
    last = whole.executions[-1].outcome
    begun = Aborted(step=last.step, target=last.target, motions=(), under_way=last.target)
    broken = replace(whole, aborted=begun, end_reason="fault:envelope", fault="refused a motion")
    save_trial(folder / "trials" / whole.trial_id, broken)
    return broken


@pytest.fixture(scope="module")
def chunks(folder: Path, trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    out = tmp_path_factory.mktemp("exports") / "trial.rrd"
    assert recording.write(open_run(folder, trial.trial_id), out, fps=FPS) == trial.trial_id
    assert [p.name for p in out.parent.iterdir()] == ["trial.rrd"]
    reader = importlib.import_module("rerun.chunk").RrdReader(str(out))
    (entry,) = reader.recordings()
    assert entry.recording_id == trial.trial_id
    return list(reader.stream())


def rows(chunks: list[Any], *, static: bool) -> Counter[str]:
    counted: Counter[str] = Counter()
    for chunk in chunks:
        if chunk.is_static == static:
            counted[chunk.entity_path] += chunk.num_rows
    return counted


def values(chunks: list[Any], path: str, component: str) -> list[Any]:
    """A component of an entity over the robot's time."""
    batches = [c.to_record_batch() for c in chunks if c.entity_path == path and not c.is_static]
    found = [
        pair
        for batch in batches
        if component in batch.schema.names
        for pair in zip(
            batch[recording.TIMELINE].cast(pa.int64()).to_pylist(),
            batch[component].to_pylist(),
            strict=True,
        )
    ]
    return [value for _, value in sorted(found, key=lambda pair: pair[0])]


def test_the_recording_has_the_cell_pictures_plots_and_words_on_the_robots_clock(
    chunks: list[Any], folder: Path, trial: Trial
) -> None:
    samples = len(track(trial, replay.load(folder / "trials" / trial.trial_id), FPS))
    moving = rows(chunks, static=False)
    for path in (*MOVING, *PLOTS, "/world/camera_side/film"):
        assert moving[path] == samples, path
    assert moving["/pictures/side"] == len(trial.executions)
    still = rows(chunks, static=True)
    for path in (*MOVING, "/world/camera_side", "/world/camera_side/film", "/about"):
        assert still[path] >= 1, path
    for chunk in chunks:
        if not chunk.is_static:
            assert recording.TIMELINE in chunk.timeline_names


def test_what_moves_in_the_recording_moves_as_in_the_trial(
    chunks: list[Any], folder: Path, trial: Trial
) -> None:
    sampled = track(trial, replay.load(folder / "trials" / trial.trial_id), FPS)
    plotted = np.array(values(chunks, "/plots/y_mm/measured", "Scalars:scalars")).ravel()
    assert plotted == pytest.approx(1e3 * sampled.pose[:, 1], abs=1e-6)
    pegs = np.array(values(chunks, "/world/peg", "Transform3D:translation")).reshape(-1, 3)
    below = trial.task.tip_below_grasp
    tip = trial.truths[-1].tip
    assert np.linalg.norm(pegs[-1] - tip) == pytest.approx(below, abs=5e-4)


def test_every_verdict_and_analysis_is_in_the_log(chunks: list[Any], trial: Trial) -> None:
    log = "\n".join(text for texts in values(chunks, "/log", "TextLog:text") for text in texts)
    for execution in trial.executions:
        assert execution.verdict.reason in log
        if execution.recovery is not None:
            analysis = execution.recovery.analysis
            assert all(w in log for w in (analysis.what, analysis.why, analysis.how))
    number = len(trial.executions) + 1
    assert log.endswith(f"fault:envelope during {number} Insertion: refused a motion")


@pytest.mark.filterwarnings("ignore::Warning")  # of an experimental reader
def test_reruns_own_reader_of_lerobot_data_sets_reads_ours(
    folder: Path, trial: Trial, tmp_path: Path
) -> None:
    source = open_run(folder, trial.trial_id)
    lerobot.write(source, tmp_path / "data", fps=FPS)
    reader = importlib.import_module("rerun.experimental").LeRobotReader(str(tmp_path / "data"))
    assert reader.version == "v3"
    assert list(reader.episodes()) == [0]
    counted = rows(list(reader.stream(0)), static=False)
    samples = len(track(trial, replay.load(source.saved[0].folder), FPS))
    for path in ("/observation.images.side", "/action", "/observation.state", "/subtask", "/task"):
        assert counted[path] >= samples, path
