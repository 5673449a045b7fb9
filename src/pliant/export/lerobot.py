"""A run as a LeRobot data set, version 3.0 of its published layout: Parquet, MP4 and metadata.

One trial is one episode; failed and retried executions are in it, and labelled.
"""

import json
import multiprocessing
import os
from collections import Counter
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pliant import signals
from pliant.console import Told, untold
from pliant.errors import InputError, unknown
from pliant.experiment.columns import EXECUTIONS, TRIALS, schema
from pliant.experiment.film import Reel
from pliant.experiment.rows import Row
from pliant.export import lerobot_card as card
from pliant.export.lerobot_episode import Episode, EpisodeJob, episode, features
from pliant.export.lerobot_stats import Stats, merged, of_values
from pliant.export.output import CARD, filling
from pliant.export.source import TEST, TRAIN, Source, counts, replayable
from pliant.export.track import check_rate
from pliant.files import write_json
from pliant.formations import Formation
from pliant.sim.render import CAMERAS

VERSION = "v3.0"
SUBTASKS = {
    Formation.APPROACH: "Approach: bring the leaning peg above the board, before the hole.",
    Formation.CONTACT: "Contact: lower the peg until it touches the board.",
    Formation.FIT: "Fit: slide along the board until the peg's low edge drops into the hole.",
    Formation.ALIGN: "Align: stand the peg upright in the hole.",
    Formation.INSERTION: "Insertion: push the peg down into the hole.",
}
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_DATA = f"data/{_FILE}.parquet"
_VIDEO = f"videos/{{video_key}}/{_FILE}.mp4"
_EPISODES = f"meta/episodes/{_FILE}.parquet"
_FILES_IN_CHUNK, _DATA_MB, _VIDEO_MB = 1000, 100, 200  # LeRobot's own
_TYPES = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
_INDICES = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def write(
    source: Source,
    out: Path,
    *,
    fps: int = 10,
    cameras: Sequence[str] = ("side",),
    workers: int | None = None,
    progress: Told = untold,
) -> dict[str, int]:
    """Write the data set; return how many episodes each split has.

    `fps` [Hz] is the rate of the frames; `workers` None: every core. `progress` is told how many
    of how many episodes are written.

    Raises:
        InputError: an option is not valid, `out` holds something, a trial's record is broken or
            cannot be replayed, or there is no OpenGL.
    """
    check_rate(fps)
    for camera in cameras:
        if camera not in CAMERAS:
            raise unknown("camera", camera, CAMERAS)
    if not cameras or len(set(cameras)) < len(cameras):
        raise InputError("cameras must name one camera or more, each once")
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}: it must be at least 1")
    chosen = replayable(source)
    jobs = [EpisodeJob(saved=saved, fps=fps, cameras=tuple(cameras)) for saved in chosen]
    with filling(out) as folder:
        with ExitStack() as stack:
            writer = _Writer(folder, fps, tuple(cameras), stack)
            episodes = stack.enter_context(closing(drawn(jobs, workers or os.cpu_count() or 1)))
            for n, made in enumerate(episodes, start=1):
                writer.add(made)
                progress(n, len(jobs))
        writer.finish(counts(chosen))
        text = card.text(source, chosen, writer.tally, fps=fps, subtasks=SUBTASKS)
        (folder / CARD).write_text(text, encoding="utf-8")
    return counts(chosen)


def drawn(jobs: Sequence[EpisodeJob], workers: int) -> Generator[Episode, None, None]:
    """The episodes in order, made in this process or in several, which are ended with it."""
    if workers == 1 or len(jobs) == 1:
        yield from map(episode, jobs)
        return
    spawn = multiprocessing.get_context("spawn")  # OpenGL does not outlive a fork
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(
        min(workers, len(jobs)), mp_context=spawn, initializer=signals.work_for_parent
    ) as pool:
        unwanted = True  # what is drawn, where this is left early: also between two episodes
        try:
            yield from pool.map(episode, jobs)
            unwanted = False
        except BrokenProcessPool as error:
            raise InputError(
                "a worker process died while it drew a trial: try again with --workers 1"
            ) from error
        finally:
            if unwanted:
                for worker in set(multiprocessing.active_children()) - others:
                    worker.kill()
            pool.shutdown(cancel_futures=True)


class _Writer:
    """Writer of the files of a data set while episodes are added."""

    def __init__(self, folder: Path, fps: int, cameras: tuple[str, ...], stack: ExitStack) -> None:
        self._folder, self._fps, self._stack = folder, fps, stack
        self._features = features(cameras, fps)
        self._data = _Data(folder, self._features, stack)
        self._videos = {
            name: _Videos(folder, name, fps, stack)
            for name, feature in self._features.items()
            if feature["dtype"] == "video"
        }
        self._tasks: dict[str, int] = {}
        self._rows: list[Row] = []
        self._executions: list[Row] = []
        self._stats: list[dict[str, Stats]] = []
        self.frames = 0
        self.tally: Counter[tuple[str, str]] = Counter()

    def add(self, made: Episode) -> None:
        number, n = len(self._rows), len(made)
        task = self._tasks.setdefault(made.task, len(self._tasks))
        index: dict[str, NDArray[np.generic]] = {
            "timestamp": (np.arange(n) / self._fps).astype(np.float32),
            "frame_index": np.arange(n),
            "episode_index": np.full(n, number),
            "index": np.arange(self.frames, self.frames + n),
            "task_index": np.full(n, task),
        }
        stats = made.stats | {name: of_values(values) for name, values in index.items()}
        self._rows.append(
            {
                "episode_index": number,
                "tasks": [made.task],
                "length": n,
                **self._data.add(made.frames | index),
                "dataset_from_index": self.frames,
                "dataset_to_index": self.frames + n,
                **{
                    k: v for name, video in self._videos.items() for k, v in video.add(made).items()
                },
                **{
                    f"stats/{feature}/{name}": value.tolist()
                    for feature, found in stats.items()
                    for name, value in found.items()
                },
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                "trial/split": made.saved.split,
                **{f"trial/{name}": value for name, value in made.saved.row.items()},
            }
        )
        self._executions += [{"episode_index": number, **row} for row in made.executions]
        self._stats.append(stats)
        self._count(made)
        self.frames += n

    def finish(self, splits: dict[str, int]) -> None:
        """Write the data set's metadata."""
        folder = self._folder
        episodes = folder / _EPISODES.format(chunk_index=0, file_index=0)
        episodes.parent.mkdir(parents=True)
        pq.write_table(_episodes_table(self._rows), episodes)
        pq.write_table(_executions_table(self._executions), folder / "meta/executions.parquet")
        _write_names(folder / "meta/tasks.parquet", "task", self._tasks)
        subtasks = {text: n for n, text in enumerate(SUBTASKS.values())}
        _write_names(folder / "meta/subtasks.parquet", "subtask", subtasks)
        stats = {name: merged([part[name] for part in self._stats]) for name in self._stats[0]}
        listed = {f: {name: v.tolist() for name, v in s.items()} for f, s in stats.items()}
        write_json(folder / "meta/stats.json", listed, indent=4)
        write_json(folder / "meta/info.json", self._info(splits), indent=4)

    def _info(self, splits: dict[str, int]) -> dict[str, Any]:
        train, every = splits[TRAIN], len(self._rows)
        ranges = {TRAIN: f"0:{train}", TEST: f"{train}:{every}"}
        indices = {
            name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in _INDICES.items()
        }
        return {
            "codebase_version": VERSION,
            "robot_type": "ur5e_soft_wrist",
            "total_episodes": every,
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": _FILES_IN_CHUNK,
            "data_files_size_in_mb": _DATA_MB,
            "video_files_size_in_mb": _VIDEO_MB,
            "fps": self._fps,
            "splits": {split: ranges[split] for split in (TRAIN, TEST) if splits[split]},
            "data_path": _DATA,
            "video_path": _VIDEO,
            "features": self._features | indices,
        }

    def _count(self, made: Episode) -> None:
        tally, row = self.tally, made.saved.row
        tally["frames", made.saved.split] += len(made)
        tally["trials", row["failure_kind"] or "inserted, and judged so"] += 1
        for execution in made.executions:
            tally["executions", execution["failure_kind"] or "success"] += 1
            tally["retries", made.saved.split] += execution["is_retry"]


@dataclass
class _Place:
    """The numbered file that is being filled, and how much it holds [bytes]."""

    chunk: int = 0
    file: int = 0
    filled: int = 0

    def is_full(self, more: int, limit_mb: int) -> bool:
        return self.filled > 0 and self.filled + more > limit_mb * 1024**2

    def advance(self) -> None:
        self.file += 1
        if self.file == _FILES_IN_CHUNK:
            self.chunk, self.file = self.chunk + 1, 0
        self.filled = 0

    @property
    def numbers(self) -> dict[str, int]:
        return {"chunk_index": self.chunk, "file_index": self.file}


class _Data:
    """Writer of data/: one row group per episode."""

    def __init__(self, folder: Path, known: dict[str, dict[str, Any]], stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self._schema = pa.schema(
            [
                pa.field(name, _type(feature))
                for name, feature in known.items()
                if feature["dtype"] != "video"
            ]
            + [pa.field(name, _TYPES[dtype]) for name, dtype in _INDICES.items()]
        )
        self._place = _Place()
        self._writer: pq.ParquetWriter | None = None

    def add(self, frames: dict[str, NDArray[np.generic]]) -> dict[str, int]:
        """Append an episode's frames; return where it stands."""
        table = pa.table(
            [_column(frames[field.name], field.type) for field in self._schema], self._schema
        )
        if self._place.is_full(table.nbytes, _DATA_MB):
            self._place.advance()
            self._writer = None
        if self._writer is None:
            path = self._folder / _DATA.format(**self._place.numbers)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = self._stack.enter_context(pq.ParquetWriter(path, self._schema))
        self._writer.write_table(table)
        self._place.filled += table.nbytes
        return {f"data/{name}": n for name, n in self._place.numbers.items()}


class _Videos:
    """Writer of videos/<key>/: the episodes' films, joined."""

    def __init__(self, folder: Path, key: str, fps: int, stack: ExitStack) -> None:
        self._folder, self._key, self._fps, self._stack = folder, key, fps, stack
        self._place = _Place()
        self._reel: Reel | None = None

    def add(self, made: Episode) -> dict[str, float]:
        """Append an episode's film; return where it stands."""
        film = made.films[self._key]
        if self._place.is_full(len(film), _VIDEO_MB):
            self._place.advance()
            self._reel = None
        if self._reel is None:
            path = self._folder / _VIDEO.format(video_key=self._key, **self._place.numbers)
            self._reel = Reel(path, self._fps)
            self._stack.callback(self._reel.close)
        begins = self._reel.add(film)
        self._place.filled += len(film)
        where: dict[str, float] = {
            **self._place.numbers,
            "from_timestamp": begins / self._fps,
            "to_timestamp": (begins + len(made)) / self._fps,
        }
        return {f"videos/{self._key}/{name}": value for name, value in where.items()}


def _type(feature: dict[str, Any]) -> pa.DataType:
    one, size = _TYPES[feature["dtype"]], feature["shape"][0]
    return one if size == 1 else pa.list_(one, size)


def _column(values: NDArray[np.generic], kind: pa.DataType) -> pa.Array:
    if values.ndim == 1:
        return pa.array(values, kind)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), type=kind)


def _episodes_table(rows: Sequence[Row]) -> pa.Table:
    """The table of episodes: LeRobot's columns with the types that their values have, the trial's
    with their own."""
    known = {f"trial/{column.name}": column.type for column in TRIALS}
    return pa.table({name: pa.array([r[name] for r in rows], known.get(name)) for name in rows[0]})


def _executions_table(rows: Sequence[Row]) -> pa.Table:
    own = [
        pa.field("episode_index", pa.int64()),
        *schema(EXECUTIONS),
        pa.field("is_retry", pa.bool_()),
        pa.field("success", pa.bool_()),
        pa.field("failure_kind", pa.string()),
        pa.field("frame_from", pa.int64()),
        pa.field("frame_to", pa.int64()),
    ]
    return pa.Table.from_pylist(list(rows), schema=pa.schema(own))


def _write_names(path: Path, name: str, numbered: dict[str, int]) -> None:
    """Write a table of texts by number, with the text as the index that pandas restores."""
    number = f"{name}_index"
    table = pa.table({number: list(numbered.values()), name: list(numbered)})
    pandas = {
        "index_columns": [name],
        "column_indexes": [_pandas_column(None, "unicode", {"encoding": "UTF-8"})],
        "columns": [_pandas_column(number, "int64"), _pandas_column(name, "unicode")],
    }
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def _pandas_column(
    name: str | None, kind: str, metadata: dict[str, str] | None = None
) -> dict[str, Any]:
    numpy_type = "int64" if kind == "int64" else "object"
    return {
        "name": name,
        "field_name": name,
        "pandas_type": kind,
        "numpy_type": numpy_type,
        "metadata": metadata,
    }
