"""A trial's video, made after it from the stored joint positions: side and wide view next to each
other over a caption; H.264 at 25 frames a second, which browsers play."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pliant import folders
from pliant.console import Told, untold
from pliant.errors import InputError
from pliant.experiment import film
from pliant.pictures import Picture
from pliant.pose import describe
from pliant.records import Execution, Trial
from pliant.report.canvas import (
    DARK,
    NEUTRAL,
    Colour,
    shortened,
    text,
    text_width,
    tick,
    verdict_colour,
)
from pliant.sim.cell import Trajectory
from pliant.sim.replay import Replay

FRAMES_PER_S = 25
CAPTION = 64  # [px] height of the caption

_CAMERAS = ("side", "wide")
_CODING = {"preset": "superfast", "crf": "22"}
_DRAWN_EVERY = 2  # of the trajectory's samples, at least: drawing takes longer than encoding
_MOST_DRAWN = 150  # moments of a trial; a longer one is drawn at fewer per second
_HOLD_SUCCESS, _HOLD_FAILURE, _HOLD_END = 15, 45, 50  # frames that a verdict stands to be read
_WORDS, _SMALL_WORDS = 0.75, 0.6
_GREY: Colour = (190, 194, 200)


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One frame of the video: which sample of the trajectory it shows, and what is said below
    it."""

    sample: int
    execution: Execution | None
    judged: bool


@dataclass(frozen=True, kw_only=True)
class Span:
    """An execution's place in the video [s]: its motion, then its verdict standing still."""

    begins: float
    judged: float
    ends: float


def write(
    path: Path,
    trial: Trial,
    trajectory: Trajectory,
    progress: Told = untold,
) -> None:
    """Write a trial's video. `progress` is told how many of how many frames are drawn.

    Raises:
        InputError: the trajectory is another task's, or there is no OpenGL, or the file cannot be
            written.
    """
    shots = storyboard(trial, trajectory)
    replay = Replay(trial.task, trajectory)
    try:
        with folders.whole(path) as partial:
            film.write(partial, _frames(replay, trial, shots, progress), FRAMES_PER_S, _CODING)
    except OSError as error:
        raise InputError(f"the video '{path}' cannot be written: {error.strerror}") from error
    finally:
        replay.cameras.close()


def storyboard(trial: Trial, trajectory: Trajectory) -> list[Shot]:
    """The video's frames in order: the trial in its own time, halted at each verdict."""
    shots: list[Shot] = []
    done = 0
    for execution in trial.executions:
        end = int(
            np.searchsorted(
                trajectory.time_s, execution.outcome.looks[-1].observation.time_s, side="right"
            )
        )
        shots += [Shot(sample=s, execution=execution, judged=False) for s in range(done, end)]
        success = execution.verdict.success
        still = Shot(sample=max(0, end - 1), execution=execution, judged=True)
        shots += [still] * (_HOLD_SUCCESS if success else _HOLD_FAILURE)
        done = max(done, end)
    shots += [
        Shot(sample=s, execution=None, judged=False) for s in range(done, len(trajectory.time_s))
    ]
    return shots + [shots[-1]] * _HOLD_END


def spans(shots: Sequence[Shot]) -> list[Span]:
    """Each execution's place in the video."""
    frames: dict[int, list[int]] = {}
    judged: dict[int, int] = {}
    for n, shot in enumerate(shots):
        if shot.execution is not None:
            frames.setdefault(shot.execution.index, []).append(n)
            if shot.judged:
                judged.setdefault(shot.execution.index, n)
    return [
        Span(
            begins=shown[0] / FRAMES_PER_S,
            judged=judged[index] / FRAMES_PER_S,
            ends=(shown[-1] + 1) / FRAMES_PER_S,
        )
        for index, shown in frames.items()
    ]


def _frames(
    replay: Replay, trial: Trial, shots: Sequence[Shot], progress: Told
) -> Iterator[Picture]:
    every = _thinning(replay.trajectory.qpos)
    views = {name: film.Drawn(replay, name) for name in _CAMERAS}
    for n, shot in enumerate(shots, start=1):
        progress(n, len(shots))
        pictures = np.hstack([views[name].at(shot.sample, every) for name in _CAMERAS])
        caption = _caption(pictures.shape[1], replay, trial, shot)
        yield np.vstack([pictures, caption])


def _thinning(qpos: NDArray[np.float32]) -> int:
    """The number of samples of which one is drawn, so that a long trial's video is made in bounded
    time."""
    moving = int(np.count_nonzero(np.abs(np.diff(qpos, axis=0)).max(axis=1) > film.UNMOVED))
    return max(_DRAWN_EVERY, math.ceil(moving / _MOST_DRAWN))


# --- the caption -------------------------------------------------------------------------------


def _caption(width: int, replay: Replay, trial: Trial, shot: Shot) -> Picture:
    """A picture of two lines: what is done with compression and time, and the verdict once it
    stands."""
    caption = np.full((CAPTION, width, 3), DARK, np.uint8)
    time_s = float(replay.trajectory.time_s[shot.sample])
    gauge = f"compression {replay.compression(shot.sample) * 1e3:5.1f} mm    {time_s:5.1f} s"
    text(caption, gauge, (width - 16, 26), scale=_SMALL_WORDS, colour=_GREY, align="right")
    if shot.execution is None:
        text(caption, trial.end_reason, (62, 26), scale=_WORDS)
        return caption
    execution, verdict = shot.execution, shot.execution.verdict
    caption[:, :46] = verdict_colour(verdict.success) if shot.judged else NEUTRAL
    if shot.judged:
        tick(caption, (23, CAPTION / 2), verdict.success, size=20)
    step = execution.outcome.step
    retreat = " after a retreat" if step.retreat else ""
    name = f"{execution.index + 1}  {str(step.formation).capitalize()}"
    text(caption, name, (62, 26), scale=_WORDS, weight=2)
    beside = 62 + text_width(name, _WORDS, 2) + 18
    text(
        caption,
        f"goal {describe(step.goal)}{retreat}",
        (beside, 26),
        scale=_SMALL_WORDS,
        colour=_GREY,
    )
    if shot.judged:
        words = f"{'success' if verdict.success else 'failure'}: {verdict.reason}"
        if execution.recovery is not None:
            words += f" | recovery: {execution.recovery.analysis.how}"
        text(caption, shortened(words, width - 80, _SMALL_WORDS), (62, 52), scale=_SMALL_WORDS)
    return caption
