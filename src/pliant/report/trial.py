"""Everything that is kept and shown of one trial, in one folder."""

from collections.abc import Mapping
from pathlib import Path

from pliant.formations import Formation
from pliant.records import Execution, Trial
from pliant.report import overlay, page, strip
from pliant.report.card import Media
from pliant.report.video import write as write_video
from pliant.sim import replay
from pliant.sim.cell import Trajectory
from pliant.store import PICTURES, Pictures, save_trial, write_bytes, write_jpeg, write_png
from pliant.task import load_task
from pliant.teaching import Teaching

PAGE, STRIP, VIDEO, OVERLAYS = "index.html", "strip.png", "video.mp4", "overlays"


def write(
    folder: Path,
    trial: Trial,
    teaching: Teaching,
    *,
    trajectory: Trajectory | None = None,
    video: bool = False,
) -> None:
    """Write a trial's record, pictures, strip and page; its trajectory and video where it has them.

    Raises:
        InputError: the folder cannot be written, or a video was asked for and cannot be made.
    """
    save_trial(folder, trial)
    if trajectory is not None:
        replay.save(folder, trajectory)
    if trial.executions:
        write_png(folder / STRIP, strip.draw(trial.executions))
    starts = _video(folder, trial, trajectory) if video else None
    goals = _goal_overlays(folder, trial, teaching)
    media = [
        Media(
            snapshot=f"{PICTURES}/{Pictures(folder).path(strip.snapshot(execution)).name}",
            overlay=_overlay(folder, trial, execution),
            goal=goals.get(execution.formation),
            start_s=None if starts is None else starts[execution.index],
        )
        for execution in trial.executions
    ]
    text = page.render(trial, media, video=None if starts is None else VIDEO)
    write_bytes(folder / PAGE, text.encode())


def _video(folder: Path, trial: Trial, trajectory: Trajectory | None) -> list[float] | None:
    """When each execution begins in the video [s]; None where there is nothing to draw it from."""
    return None if trajectory is None else write_video(folder / VIDEO, trial, trajectory)


def _overlay(folder: Path, trial: Trial, execution: Execution) -> str:
    outcome = execution.outcome
    view = outcome.looks[-1].observation.views["side"]
    name = f"{OVERLAYS}/{execution.index + 1:02d}-{execution.formation}.jpg"
    write_jpeg(folder / name, overlay.draw(view, outcome.scene, trial.task))
    return name


def _goal_overlays(folder: Path, trial: Trial, teaching: Teaching) -> Mapping[Formation, str]:
    """The goal picture of each formation that was executed, with its measurement."""
    names = {}
    for formation in {execution.formation for execution in trial.executions}:
        shown = teaching.demonstrations.get(formation)
        if shown is None:
            continue
        name = f"{OVERLAYS}/goal-{formation}.jpg"
        picture = overlay.draw(shown.view, teaching.scenes[formation], load_task(shown.peg))
        write_jpeg(folder / name, picture)
        names[formation] = name
    return names
