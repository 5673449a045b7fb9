"""A LeRobot data set read again without LeRobot: with pyarrow, PyAV and the published layout.

`PUBLISHED` holds the metadata that lerobot 0.6.1 writes, without the feature's names.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from stored_run import FAILED, HELD_OUT, RECOVERED, store

from pliant.errors import InputError
from pliant.export import lerobot
from pliant.export.lerobot_stats import of_pictures, of_values
from pliant.export.source import Source, open_run
from pliant.formations import Formation
from pliant.pose import Axis
from pliant.records import Trial

FPS = 2
KEY = "observation.images.side"
PUBLISHED_INFO = {
    "codebase_version", "fps", "features", "total_episodes", "total_frames", "total_tasks",
    "chunks_size", "data_files_size_in_mb", "video_files_size_in_mb", "data_path", "video_path",
    "robot_type", "splits",
}  # fmt: skip
PUBLISHED_INDEX = {
    "timestamp": pa.float32(), "frame_index": pa.int64(), "episode_index": pa.int64(),
    "index": pa.int64(), "task_index": pa.int64(),
}  # fmt: skip
PUBLISHED_EPISODE = {
    "episode_index": pa.int64(), "tasks": pa.list_(pa.string()), "length": pa.int64(),
    "data/chunk_index": pa.int64(), "data/file_index": pa.int64(),
    "dataset_from_index": pa.int64(), "dataset_to_index": pa.int64(),
    f"videos/{KEY}/chunk_index": pa.int64(), f"videos/{KEY}/file_index": pa.int64(),
    f"videos/{KEY}/from_timestamp": pa.float64(), f"videos/{KEY}/to_timestamp": pa.float64(),
    "meta/episodes/chunk_index": pa.int64(), "meta/episodes/file_index": pa.int64(),
}  # fmt: skip
PUBLISHED_STATS = ("min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99")
STORED_AS = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Read:
    """The data set, read by its own metadata."""

    folder: Path
    info: dict[str, Any]
    stats: dict[str, dict[str, Any]]
    frames: pa.Table
    episodes: pa.Table
    executions: list[dict[str, Any]]

    def of(self, episode: dict[str, Any]) -> pa.Table:
        begin, end = episode["dataset_from_index"], episode["dataset_to_index"]
        return self.frames.slice(begin, end - begin)

    def episode(self, trial_id: str) -> dict[str, Any]:
        (found,) = [e for e in self.episodes.to_pylist() if e["trial/trial_id"] == trial_id]
        return found


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Source, dict[str, Trial]]:
    folder = tmp_path_factory.mktemp("runs") / "run"
    trials = store(folder)
    return open_run(folder), trials


@pytest.fixture(scope="module")
def trials(run: tuple[Source, dict[str, Trial]]) -> dict[str, Trial]:
    return run[1]


@pytest.fixture(scope="module")
def read(run: tuple[Source, dict[str, Trial]], tmp_path_factory: pytest.TempPathFactory) -> Read:
    folder = tmp_path_factory.mktemp("exports") / "data"
    assert lerobot.write(run[0], folder, fps=FPS, workers=2) == {"train": 2, "test": 1}
    info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    place = {"chunk_index": 0, "file_index": 0}
    return Read(
        folder=folder,
        info=info,
        stats=json.loads((folder / "meta/stats.json").read_text(encoding="utf-8")),
        frames=pq.read_table(folder / info["data_path"].format(**place)),
        episodes=pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet"),
        executions=pq.read_table(folder / "meta/executions.parquet").to_pylist(),
    )


def column(table: pa.Table, name: str) -> NDArray[Any]:
    return np.array(table[name].to_pylist())


# --- the layout --------------------------------------------------------------------------------


def test_the_metadata_are_as_lerobot_publishes_them(read: Read) -> None:
    info = read.info
    assert set(info) == PUBLISHED_INFO
    assert info["codebase_version"] == "v3.0"
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    assert info["splits"] == {"train": "0:2", "test": "2:3"}
    for name, feature in info["features"].items():
        assert {"dtype", "shape", "names"} <= set(feature), name
        if feature["dtype"] == "video":
            assert feature["shape"] == [480, 640, 3]
            assert feature["names"] == ["height", "width", "channels"]
            continue
        (size,) = feature["shape"]
        assert feature["names"] is None or len(feature["names"]) == size
        one = STORED_AS[feature["dtype"]]
        assert read.frames.schema.field(name).type == (one if size == 1 else pa.list_(one, size))
    assert {n: read.frames.schema.field(n).type for n in PUBLISHED_INDEX} == PUBLISHED_INDEX
    assert len(read.frames.schema) == len(info["features"]) - 1  # the film stands apart


def test_the_statistics_of_pictures_are_those_of_their_values() -> None:
    random = np.random.default_rng(1)
    pictures = [random.integers(3, 200, (12, 16, 3)).astype(np.uint8) for _ in range(7)]
    expected = of_values(np.concatenate([p.reshape(-1, 3) for p in pictures]) / 255)
    found = of_pictures(pictures)
    assert found.pop("count") == [7]
    for name, value in found.items():
        assert value.shape == (3, 1, 1)
        assert value.ravel() == pytest.approx(expected[name], abs=1e-9), name


def test_the_episodes_table_has_every_published_column(read: Read) -> None:
    schema = read.episodes.schema
    for name, kind in PUBLISHED_EPISODE.items():
        found = schema.field(name).type
        same = found.value_type == kind.value_type if pa.types.is_list(kind) else found == kind
        assert same, name
    for feature, stats in read.stats.items():
        assert tuple(sorted(stats)) == tuple(sorted(PUBLISHED_STATS))
        shape = (3, 1, 1) if feature == KEY else tuple(read.info["features"][feature]["shape"])
        for name in PUBLISHED_STATS:
            value = read.episodes[f"stats/{feature}/{name}"][0].as_py()
            assert np.shape(value) == ((1,) if name == "count" else shape)
            assert np.shape(stats[name]) == np.shape(value)
    assert set(read.stats) == set(read.info["features"])


@pytest.mark.parametrize("name", ["task", "subtask"])
def test_the_texts_are_the_index_that_pandas_restores(read: Read, name: str) -> None:
    table = pq.read_table(read.folder / f"meta/{name}s.parquet")
    assert table.column_names == [f"{name}_index", name]
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == [name]
    assert table[f"{name}_index"].to_pylist() == list(range(len(table)))


def test_indices_count_frames_and_episodes_without_a_gap(read: Read) -> None:
    frames, episodes = read.frames, read.episodes.to_pylist()
    assert column(frames, "index").tolist() == list(range(read.info["total_frames"]))
    assert [e["episode_index"] for e in episodes] == list(range(read.info["total_episodes"]))
    for episode in episodes:
        own = read.of(episode)
        assert set(column(own, "episode_index")) == {episode["episode_index"]}
        assert column(own, "frame_index").tolist() == list(range(episode["length"]))
        assert column(own, "timestamp") == pytest.approx(np.arange(episode["length"]) / FPS)
        assert column(own, "next.done").tolist() == [False] * (len(own) - 1) + [True]


# --- what it holds -----------------------------------------------------------------------------


def test_counts_match_the_run_and_failures_and_retries_are_in(
    read: Read, trials: dict[str, Trial]
) -> None:
    stored = [t for name in (RECOVERED, FAILED, HELD_OUT) for t in [trials[name]]]
    assert read.info["total_episodes"] == len(stored)
    assert len(read.executions) == sum(len(t.executions) for t in stored)
    assert [e["verdict"] for e in read.executions] == [
        e.verdict.success for t in stored for e in t.executions
    ]
    assert any(e["is_retry"] for e in read.executions)
    assert {e["failure_kind"] for e in read.executions} > {None}
    assert read.episode(FAILED)["trial/inserted"] is False
    assert read.episode(FAILED)["trial/failure_kind"] is not None
    assert read.episode(RECOVERED)["trial/inserted"] is True
    assert read.episode(HELD_OUT)["episode_index"] == 2


def test_states_are_the_poses_that_the_robot_measured(read: Read, trials: dict[str, Trial]) -> None:
    for trial_id, trial in trials.items():
        own = read.of(read.episode(trial_id))
        states, times = column(own, "observation.state"), column(own, "timestamp")
        for execution in trial.executions:
            look = execution.outcome.looks[-1].observation
            state = states[np.searchsorted(times, look.time_s + 1e-6) - 1]  # at rest since
            assert state[:6] == pytest.approx([look.pose[a] for a in Axis], abs=2e-4)
            assert state[6] == pytest.approx(look.compression_m, abs=6e-4)


def test_every_frame_carries_the_labels_of_the_execution_it_is_in(
    read: Read, trials: dict[str, Trial]
) -> None:
    order = list(Formation)
    for trial_id, trial in trials.items():
        own = read.of(read.episode(trial_id))
        times = column(own, "timestamp")
        begin = 0.0
        for n, execution in enumerate(trial.executions):
            end = execution.outcome.looks[-1].observation.time_s
            during = own.filter(pa.array((times > begin + 1e-4) & (times < end - 1e-4)))
            formation = execution.formation
            seen = [e.formation for e in trial.executions[:n]]
            assert set(column(during, "execution_index")) == {n}
            assert set(column(during, "subtask_index")) == {order.index(formation)}
            assert set(column(during, "verdict_success")) == {execution.verdict.success}
            assert set(column(during, "is_retry")) == {formation in seen}
            if formation is Formation.INSERTION:
                assert set(column(during, "execution_success")) == {trial.truths[n].inserted}
            motion = execution.outcome.motions[-1]
            moving = during.filter(
                pa.array(column(during, "timestamp") > motion.started_s + 1e-3)
            ).slice(0, 2)
            expected = [motion.commanded[a] for a in Axis]
            assert column(moving, "action")[0] == pytest.approx(expected, abs=1e-6)
            begin = end
        assert column(own, "next.success")[-1] == trial.inserted


def test_films_decode_to_one_picture_per_frame_like_the_one_that_was_judged(
    read: Read, trials: dict[str, Trial]
) -> None:
    path = read.folder / read.info["video_path"].format(video_key=KEY, chunk_index=0, file_index=0)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.average_rate == FPS
        decoded = [(f.time, f.to_ndarray(format="rgb24")) for f in container.decode(stream)]
    assert len(decoded) == read.info["total_frames"]
    assert [t for t, _ in decoded] == pytest.approx(np.arange(len(decoded)) / FPS)
    last: dict[str, NDArray[np.uint8]] = {}
    for trial_id, trial in trials.items():
        episode = read.episode(trial_id)
        begin, end = (episode[f"videos/{KEY}/{side}_timestamp"] for side in ("from", "to"))
        assert round((end - begin) * FPS) == episode["length"]
        last[trial_id] = decoded[round(end * FPS) - 1][1]
        judged = trial.executions[-1].outcome.looks[-1].observation.views["side"].image
        assert difference(last[trial_id], judged) < 3.0
    assert difference(last[RECOVERED], last[FAILED]) > 6.0


def difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    return float(np.abs(one.astype(float) - other).mean())


def test_statistics_are_those_of_the_frames(read: Read) -> None:
    for name in ("observation.state", "action", "timestamp"):
        values = column(read.frames, name).reshape(len(read.frames), -1)
        stats = read.stats[name]
        for key, expected in (
            ("min", values.min(axis=0)),
            ("max", values.max(axis=0)),
            ("mean", values.mean(axis=0)),
            ("std", values.std(axis=0)),
            ("count", [len(values)]),
        ):
            assert stats[key] == pytest.approx(np.asarray(expected), rel=1e-4, abs=1e-7), key


def test_a_trial_alone_made_in_this_process_is_the_same_episode(
    run: tuple[Source, dict[str, Trial]], read: Read, tmp_path: Path
) -> None:
    alone = open_run(run[0].folder, RECOVERED)
    assert lerobot.write(alone, tmp_path / "data", fps=FPS) == {"train": 1, "test": 0}
    frames = pq.read_table(tmp_path / "data/data/chunk-000/file-000.parquet")
    assert frames.equals(read.of(read.episode(RECOVERED)))  # the first of the whole data set
    info = json.loads((tmp_path / "data/meta/info.json").read_text(encoding="utf-8"))
    assert info["splits"] == {"train": "0:1"}


def test_a_file_that_is_full_is_followed_by_another(
    run: tuple[Source, dict[str, Trial]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lerobot, "_DATA_MB", 0)
    monkeypatch.setattr(lerobot, "_VIDEO_MB", 0)
    monkeypatch.setattr(lerobot, "_FILES_IN_CHUNK", 2)
    out = tmp_path / "data"
    lerobot.write(run[0], out, fps=1, workers=1)
    episodes = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for episode, place in zip(
        episodes, ("000/file-000", "000/file-001", "001/file-000"), strict=True
    ):
        frames = pq.read_table(out / f"data/chunk-{place}.parquet")
        assert set(column(frames, "episode_index")) == {episode["episode_index"]}
        with av.open(str(out / f"videos/{KEY}/chunk-{place}.mp4")) as container:
            assert sum(1 for _ in container.decode(video=0)) == episode["length"] == len(frames)
        assert episode[f"videos/{KEY}/from_timestamp"] == 0.0
        numbers = f"{episode['data/chunk_index']:03d}/file-{episode['data/file_index']:03d}"
        assert numbers == place


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"fps": 0}, "fps is 0"),
        ({"fps": 26}, "1 to 25"),
        ({"cameras": ["top"]}, "unknown camera 'top'"),
        ({"cameras": ["side", "side"]}, "each once"),
        ({"workers": 0}, "workers is 0"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_written(
    run: tuple[Source, dict[str, Trial]], tmp_path: Path, options: dict[str, Any], word: str
) -> None:
    with pytest.raises(InputError, match=word):
        lerobot.write(run[0], tmp_path / "data", **options)
    assert list(tmp_path.iterdir()) == []


def test_the_documents_snippet_reads_the_failed_executions(read: Read, tmp_path: Path) -> None:
    text = (Path(__file__).parent.parent / "docs/datasets.md").read_text(encoding="utf-8")
    code = text.split("```python\n")[1].split("```")[0]
    (tmp_path / "exports").mkdir()
    (tmp_path / "exports/lerobot").symlink_to(read.folder)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    failed = [e for e in read.executions if not e["success"]]
    assert done.stdout.count("(480, 640, 3)") == len(failed) > 0
