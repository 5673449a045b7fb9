"""The folder of one trial: everything that is kept and shown of it."""

import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import cv2

from pliant import folders, pictures
from pliant.conditions import CONDITIONS, NOMINAL
from pliant.console import Told, untold
from pliant.errors import InputError
from pliant.experiment import growth
from pliant.files import write_bytes
from pliant.formations import Formation
from pliant.records import Execution, Trial
from pliant.report import overlay, page, strip, video
from pliant.report.card import Media
from pliant.report.document import ASSETS, LIBRARY, library_file, stamp_of
from pliant.sim import replay
from pliant.sim.cell import Trajectory
from pliant.store import (
    MOST_JSON,
    PICTURES,
    RUN,
    TRIAL,
    TRIALS,
    Pictures,
    save_trial,
)
from pliant.task import load_task
from pliant.teaching import Teaching

PAGE, STRIP, VIDEO, OVERLAYS = "index.html", "strip.png", "video.mp4", "overlays"

_FINE = (
    *(cv2.IMWRITE_JPEG_QUALITY, 88),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
)
_HEAD = 1000  # [characters] of a page in which its stamp is


def write(
    folder: Path,
    trial: Trial,
    teaching: Teaching,
    *,
    trajectory: Trajectory | None = None,
    video: bool = False,
    progress: Told = untold,
) -> None:
    """Write a trial's record, pictures, strip and page; its trajectory and video where it has them.
    What another trial left in the folder goes. `progress` is told of the video's frames.

    Raises:
        InputError: the folder cannot be written, or a video was asked for and cannot be made.
    """
    if video and trajectory is None:
        raise InputError(
            f"no video can be made of trial '{trial.trial_id}': it has no trajectory, which only"
            " simulated trials have"
        )
    for name in (PAGE, STRIP, VIDEO, replay.FILE):  # of another trial
        _remove(folder / name)
    save_trial(folder, trial)
    if trajectory is not None:
        replay.save(folder, trajectory)
    if trial.executions:
        write_bytes(folder / STRIP, pictures.encoded(strip.draw(trial.executions)))
    show(folder, trial, teaching, film=video, progress=progress)


def show(
    folder: Path,
    trial: Trial,
    teaching: Teaching | None,
    *,
    film: bool = False,
    home: str | None = None,
    progress: Told = untold,
) -> None:
    """Make the page of a trial that is stored in `folder`, with its overlays; with `film` its video
    too, unless it is there. `teaching` None: the goal pictures are not known. `home` is the way to
    the experiment's page.

    Raises:
        InputError: the folder cannot be written, or the video cannot be made.
    """
    spans = _film(folder, trial, film, progress)
    shared = _shared(folder)
    write_library(folder / shared)
    goals = _goal_overlays(folder, shared, teaching) if teaching is not None else {}
    shown = Pictures(folder / PICTURES)
    media = [
        Media(
            snapshot=f"{PICTURES}/{shown.path(strip.snapshot(execution)).name}",
            overlay=_overlay(folder, trial, execution),
            goal=goals.get(execution.formation),
            filmed=spans is not None,
        )
        for execution in trial.executions
    ]
    _drop_overlays(folder, {file.overlay for file in media})
    text = page.render(
        trial,
        media,
        shown,
        video=None if spans is None else VIDEO,
        spans=spans,
        library=shared,
        home=home,
        stamp=_stamp(folder, has_goals=teaching is not None, home=home),
        own_ranges=_own_ranges(folder, trial),
    )
    write_bytes(folder / PAGE, text.encode())


def is_shown(folder: Path, home: str | None = None) -> bool:
    """Whether a trial's page is there, made by this pliant from what is there now. One that lacks
    its goal pictures is not: they may be known by now."""
    try:
        with (folder / PAGE).open(encoding="utf-8") as file:
            found = stamp_of(file.read(_HEAD))
        has_library = (folder / _shared(folder) / LIBRARY[0]).is_file()
        return has_library and found == _stamp(folder, has_goals=True, home=home)
    except (OSError, UnicodeDecodeError):
        return False


def _stamp(folder: Path, *, has_goals: bool, home: str | None) -> str:
    """A short hash of what a page is made from: record, goals, video, and the code that makes
    it."""
    total = hashlib.sha256(_code_digest())
    total.update(folders.read(folder / TRIAL, MOST_JSON))
    filmed = (folder / VIDEO).is_file() and (folder / replay.FILE).is_file()
    total.update(f"{has_goals} {filmed} {home}".encode())
    return total.hexdigest()[:32]


def write_library(folder: Path) -> None:
    """Put the plotting library into `folder`, if it is not there.

    Raises:
        InputError: the folder cannot be written.
    """
    for name in LIBRARY:
        path, content = folder / name, library_file(name)
        if not path.is_file() or path.read_bytes() != content:
            write_bytes(path, content)


def run_of(folder: Path) -> Path | None:
    """The run that a trial's folder lies in, with which its page shares files; None: it lies by
    itself."""
    place = folder.resolve().parent
    return place.parent if place.name == TRIALS else None


def _own_ranges(folder: Path, trial: Trial) -> dict[str, tuple[float, float]]:
    """The ranges that were given in place of the condition's own, as far as its run says them."""
    run, named = run_of(folder), trial.condition.removesuffix("-own")
    if run is None or named not in CONDITIONS or named == trial.condition:
        return {}
    try:
        document = json.loads(folders.read(run / RUN, MOST_JSON))
        (ranges,) = [
            cell["condition"]["ranges"]
            for cell in document["configuration"]["cells"]
            if growth.names(cell)
            == (trial.level, trial.task.peg.name, trial.condition, trial.reasoner)
        ]
        known = CONDITIONS[named].ranges
        found = {q: (float(low), float(high)) for q, (low, high) in ranges.items()}
        return {q: r for q, r in found.items() if q in NOMINAL and r != known.get(q)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _shared(folder: Path) -> str:
    """The way from a trial's folder to what its page shares with others of the run."""
    return ASSETS if run_of(folder) is None else f"../../{ASSETS}"


def _film(folder: Path, trial: Trial, film: bool, progress: Told) -> list[video.Span] | None:
    """Each execution's place in the video, drawn if it is wanted and missing; None: no video."""
    path = folder / VIDEO
    if not path.is_file() and not film:
        return None
    if not film and not (folder / replay.FILE).is_file():
        return None
    trajectory = replay.load(folder)
    if not path.is_file():
        video.write(path, trial, trajectory, progress)
    return video.spans(video.storyboard(trial, trajectory))


def _overlay(folder: Path, trial: Trial, execution: Execution) -> str:
    outcome = execution.outcome
    view = outcome.looks[-1].observation.views["side"]
    name = f"{OVERLAYS}/{execution.index + 1:02d}-{execution.formation}.jpg"
    _write_drawn(folder / name, overlay.draw(view, outcome.scene, trial.task))
    return name


def _goal_overlays(folder: Path, shared: str, teaching: Teaching) -> Mapping[Formation, str]:
    """Each formation's goal picture with its measurement: drawn once for all trials of a run."""
    digest = _goals_digest(teaching).hex()[:8]
    names = {}
    for formation, shown in teaching.demonstrations.items():
        names[formation] = f"{shared}/goal-{formation}-{digest}.jpg"
        path = folder / names[formation]
        if not path.is_file():
            drawn = overlay.draw(shown.view, teaching.scenes[formation], load_task(shown.peg))
            _write_drawn(path, drawn)
    return names


def _write_drawn(path: Path, picture: pictures.Picture) -> None:
    """Write a drawn-on picture, which need not be kept to the bit."""
    write_bytes(path, pictures.encoded(picture, "jpg", _FINE))


def _drop_overlays(folder: Path, kept: set[str]) -> None:
    for path in (folder / OVERLAYS).glob("*.jpg"):
        if f"{OVERLAYS}/{path.name}" not in kept:
            _remove(path)


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be replaced: {error.strerror}; choose another folder"
        ) from error


@lru_cache(maxsize=1)
def _code_digest() -> bytes:
    """A digest of the files that make pages."""
    total = hashlib.sha256()
    for file in sorted((files("pliant.report")).iterdir(), key=lambda f: f.name):
        if file.is_file() and not file.name.endswith(".pyc"):
            total.update(file.read_bytes())
    return total.digest()


@lru_cache(maxsize=4)
def _goals_digest(teaching: Teaching) -> bytes:
    total = hashlib.sha256(repr(teaching.goals).encode())
    for shown in teaching.demonstrations.values():
        total.update(shown.view.image.tobytes())
    return total.digest()
