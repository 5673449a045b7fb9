"""One trial as an episode of a LeRobot data set: frames at a fixed rate, labels, films, statistics.

Made in a worker process; what comes back holds arrays and bytes only.
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pliant.errors import InputError
from pliant.experiment import film
from pliant.experiment.columns import axis_field
from pliant.experiment.rows import Row, rows_of
from pliant.export.labels import Label, labels
from pliant.export.lerobot_stats import Stats, of_pictures, of_values
from pliant.export.source import Saved
from pliant.export.track import Track, track
from pliant.formations import Formation
from pliant.pictures import Picture
from pliant.pose import Axis
from pliant.records import Trial
from pliant.sim import constants as c
from pliant.sim import replay
from pliant.sim.cell import Trajectory
from pliant.store import load_trial
from pliant.task import Task

_POSE = [axis_field(axis) for axis in Axis]
_SAMPLED = 20  # pictures of an episode that its statistics are taken from, each thinned by 4 x 4


@dataclass(frozen=True, kw_only=True)
class EpisodeJob:
    """A job of making an episode: which trial becomes one, and how."""

    saved: Saved
    fps: int
    cameras: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """An episode of the data set. `frames` maps each feature but the index columns and the films to
    its values (n, …); `executions` are rows of executions.parquet, with labels and the frames they
    span."""

    saved: Saved
    task: str
    frames: dict[str, NDArray[np.generic]]
    films: dict[str, bytes]
    stats: dict[str, Stats]
    executions: list[Row]

    def __len__(self) -> int:
        return len(self.frames["action"])


def features(cameras: tuple[str, ...], fps: int) -> dict[str, dict[str, Any]]:
    """The data set's own features, as meta/info.json lists them; LeRobot's index columns follow."""
    width, height = c.IMAGE_SIZE
    films = {
        "dtype": "video",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": film.PIXELS,
            "video.fps": fps,
            "video.channels": 3,
            "video.g": film.KEYFRAME_EVERY,
            "video.crf": film.QUALITY,
            "has_audio": False,
            "is_depth_map": False,
        },
    }
    return {
        "observation.state": _vector([*_POSE, "compression_m"]),
        "action": _vector(_POSE),
        **{f"observation.images.{camera}": films for camera in cameras},
        "subtask_index": _scalar("int64"),
        "execution_index": _scalar("int64"),
        "is_retry": _scalar("bool"),
        "verdict_success": _scalar("bool"),
        "execution_success": _scalar("bool"),
        "next.success": _scalar("bool"),
        "next.done": _scalar("bool"),
    }


def episode(job: EpisodeJob) -> Episode:
    """Sample, label, draw and encode a trial.

    Raises:
        InputError: its record or trajectory is broken, or there is no OpenGL.
    """
    os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core a worker
    trial = load_trial(job.saved.folder)
    known = labels(trial)
    if len(known) < len(trial.executions):
        raise InputError(
            f"trial '{trial.trial_id}' has no ground truth for every execution: LeRobot's labels"
            " need it"
        )
    sampled = track(trial, replay.load(job.saved.folder), job.fps)
    frames = _frames(trial, known, sampled)
    films, stats = {}, {name: of_values(values) for name, values in frames.items()}
    drawing = _STAGE.set_for(trial.task, sampled.trajectory)
    for camera in job.cameras:
        key = f"observation.images.{camera}"
        sample = _Sample(len(sampled))
        films[key] = film.encoded(sample.of(film.Drawn(drawing, camera)), job.fps)
        stats[key] = of_pictures(sample.kept)
    return Episode(
        saved=job.saved,
        task=f"Insert the {trial.task.peg.name} peg into the hole in the board.",
        frames=frames,
        films=films,
        stats=stats,
        executions=_executions(trial, known, sampled),
    )


def retries(trial: Trial) -> list[bool]:
    """Whether each execution repeats a formation that the trial had executed before."""
    done = [execution.formation for execution in trial.executions]
    return [formation in done[:n] for n, formation in enumerate(done)]


def _frames(trial: Trial, known: list[Label], sampled: Track) -> dict[str, NDArray[np.generic]]:
    running = sampled.execution
    last = np.arange(len(sampled)) == len(sampled) - 1
    order = list(Formation)
    subtasks = np.array([order.index(e.formation) for e in trial.executions])
    return {
        "observation.state": np.column_stack([sampled.pose, sampled.compression_m]).astype(
            np.float32
        ),
        "action": sampled.command.astype(np.float32),
        "subtask_index": subtasks[running],
        "execution_index": running,
        "is_retry": np.array(retries(trial))[running],
        "verdict_success": np.array([e.verdict.success for e in trial.executions])[running],
        "execution_success": np.array([label.success for label in known])[running],
        "next.success": last & bool(trial.inserted),
        "next.done": last,
    }


def _executions(trial: Trial, known: list[Label], sampled: Track) -> list[Row]:
    """Rows of executions.parquet, with the labels and the frames [from, to) of the episode."""
    rows = rows_of(trial).executions
    again = retries(trial)
    return [
        row
        | {
            "is_retry": again[n],
            "success": label.success,
            "failure_kind": label.kind,
            "frame_from": int(np.searchsorted(sampled.execution, n, side="left")),
            "frame_to": int(np.searchsorted(sampled.execution, n, side="right")),
        }
        for n, (row, label) in enumerate(zip(rows, known, strict=True))
    ]


class _Stage:
    """The replay of the last episode, kept for the next of the same task: to make a renderer takes
    as long as to draw fifty pictures. Pictures are as sharp as a trial's own."""

    def __init__(self) -> None:
        self._kept: tuple[Task, replay.Replay] | None = None

    def set_for(self, task: Task, trajectory: Trajectory) -> replay.Replay:
        if self._kept is not None:
            known, drawing = self._kept
            if known == task:
                drawing.turn_to(trajectory)
                return drawing
            drawing.cameras.close()
        drawing = replay.Replay(task, trajectory, is_smooth=False)
        self._kept = task, drawing
        return drawing


_STAGE = _Stage()  # of this process: a worker makes one episode after the other


class _Sample:
    """A sample of the pictures that pass by, thinned, for statistics."""

    def __init__(self, passing: int) -> None:
        self._wanted = set(np.linspace(0, passing - 1, min(_SAMPLED, passing)).astype(int).tolist())
        self.kept: list[Picture] = []

    def of(self, pictures: Iterable[Picture]) -> Iterator[Picture]:
        for n, picture in enumerate(pictures):
            if n in self._wanted:
                self.kept.append(picture[::4, ::4].copy())
            yield picture


def _vector(names: list[str]) -> dict[str, Any]:
    return {"dtype": "float32", "shape": [len(names)], "names": names}


def _scalar(dtype: str) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [1], "names": None}
