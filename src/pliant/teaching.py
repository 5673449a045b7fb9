"""What was taught: a goal, a pose and a picture per contact formation (Sec. III: p_g and I_g).

Goals are taught once, with the circular peg in the nominal cell, and used unchanged for every other
peg, which is thereby unseen. They are kept as a YAML file with its pictures beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from pliant import pictures
from pliant.cell import Camera, View
from pliant.envelope import Limits
from pliant.errors import InputError, unknown
from pliant.formations import Formation, Goals
from pliant.paths import located, seen_from
from pliant.pose import Axis, Partial, Pose
from pliant.task import Task, load_task, located_peg, shipped_pegs
from pliant.vision.measure import SIMULATED, Colours, measure
from pliant.vision.scene import Scene

SCHEMA = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """What was recorded when a goal was taught: the pose that was reached, the picture, the peg:
    its name, or the absolute path of its file."""

    formation: Formation
    pose: Pose
    peg: str
    view: View = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Teaching:
    """Goals, what was recorded as they were taught, and the goal pictures' measurements."""

    goals: Goals
    demonstrations: Mapping[Formation, Demonstration] = field(repr=False)
    scenes: Mapping[Formation, Scene] = field(repr=False)

    def for_task(self, task: Task) -> "Teaching":
        """The same teaching for a peg of another length: every height moves by the difference."""
        if not self.demonstrations:
            return self
        peg = next(iter(self.demonstrations.values())).peg
        longer = task.tip_below_hinge - load_task(peg).tip_below_hinge
        if longer == 0.0:
            return self
        shifted = {
            formation: {a: v + longer if a is Axis.Z else v for a, v in goal.items()}
            for formation, goal in self.goals.formations.items()
        }
        return replace(self, goals=Goals(formations=shifted))


@lru_cache(maxsize=4)
def shipped() -> Teaching:
    """The goals that come with pliant, taught by `reproduce/teach_goals.py`."""
    with as_file(files("pliant") / "goals") as folder:
        return load(folder / "goals.yaml")


def load(path: Path, limits: Limits | None = None, colours: Colours = SIMULATED) -> Teaching:
    """Read taught goals. `colours` are those of their pictures. A peg file and pictures that the
    file names count from its folder.

    Raises:
        InputError: the file or a picture is missing or broken, or a goal is out of the workspace.
    """
    document = _document(path)
    path = located(path)
    peg = located_peg(str(document.get("peg", "")), path.parent)
    camera = _camera(document.get("camera"), path)
    entries = document.get("formations")
    if not isinstance(entries, dict):
        raise InputError(f"goal file '{path}' must list 'formations'")
    goals: dict[Formation, Partial] = {}
    demonstrations: dict[Formation, Demonstration] = {}
    for name, entry in entries.items():
        if name not in list(Formation):
            raise unknown("formation", name, Formation, f"in goal file '{path}'")
        formation = Formation(name)
        if not isinstance(entry, dict):
            raise InputError(f"goal file '{path}': {name} must have a goal, a pose and a picture")
        goals[formation] = _partial(entry.get("goal"), path, name)
        outside = (limits or Limits()).outside(goals[formation], margin=True)
        if outside is not None:
            raise InputError(f"goal file '{path}': {name} {outside}")
        demonstrations[formation] = Demonstration(
            formation=formation,
            pose=Pose().updated(_partial(entry.get("pose"), path, name)),
            peg=peg,
            view=View(
                camera=camera, time_s=0.0, image=_picture(path, entry.get("picture"), name, camera)
            ),
        )
    try:
        return taught(Goals(formations=goals), demonstrations, colours)
    except InputError as error:
        raise InputError(f"goal file '{path}': {error}") from error


def taught(
    goals: Goals,
    demonstrations: Mapping[Formation, Demonstration],
    colours: Colours = SIMULATED,
) -> Teaching:
    """Goals with their demonstrations, whose pictures are measured here."""
    scenes = {
        formation: measure(shown.view, load_task(shown.peg), colours)
        for formation, shown in demonstrations.items()
    }
    return Teaching(goals=goals, demonstrations=demonstrations, scenes=scenes)


def save(path: Path, teaching: Teaching) -> None:
    """Write taught goals as `load` reads them: YAML, and a PNG per formation beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    entries: dict[str, Any] = {}
    for formation in Formation:
        shown = teaching.demonstrations[formation]
        picture = f"{formation}.png"
        bgr = cv2.cvtColor(shown.view.image, cv2.COLOR_RGB2BGR)
        if not cv2.imwrite(str(path.parent / picture), bgr):
            raise InputError(f"the picture '{path.parent / picture}' cannot be written")
        entries[str(formation)] = {
            "goal": _report(teaching.goals.formations[formation]),
            "pose": _report({axis: shown.pose[axis] for axis in Axis}),
            "picture": picture,
        }
    camera, is_shipped = shown.view.camera, shown.peg in shipped_pegs()
    document = {
        "schema": SCHEMA,
        "peg": shown.peg if is_shipped else seen_from(located(shown.peg), path.parent),
        "frame": "task",
        "camera": {
            "name": camera.name,
            "size_px": [camera.width, camera.height],
            "focal_px": round(camera.focal_px, 3),
            "position_m": [round(float(v), 6) for v in camera.position],
            "rotation": [[round(float(v), 9) + 0.0 for v in row] for row in camera.rotation],
        },
        "formations": entries,
    }
    path.write_text(yaml.safe_dump(document, sort_keys=False, default_flow_style=None))


def _document(path: Path) -> dict[str, Any]:
    try:
        document = yaml.safe_load(path.read_text())
    except OSError as error:
        raise InputError(
            f"goal file '{path}' cannot be read: {error.strerror}; leave it out to use the shipped"
            " goals"
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"goal file '{path}' is not YAML: {str(error).splitlines()[0]}") from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(f"goal file '{path}' must say 'schema: {SCHEMA}'")
    return document


def _camera(entry: Any, path: Path) -> Camera:
    try:
        width, height = entry["size_px"]
        return Camera(
            name=str(entry["name"]),
            width=int(width),
            height=int(height),
            focal_px=float(entry["focal_px"]),
            position=np.array(entry["position_m"], float).reshape(3),
            rotation=np.array(entry["rotation"], float).reshape(3, 3),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"goal file '{path}': 'camera' must give name, size_px, focal_px, position_m and"
            " rotation"
        ) from error


def _picture(path: Path, name: Any, formation: str, camera: Camera) -> Any:
    picture = path.parent / str(name)
    what = f"goal file '{path}': the picture '{picture}' of {formation}"
    if picture.parent != path.parent or picture.name == "..":
        raise InputError(f"{what} is in another folder: it must lie beside the file")
    if not picture.is_file():
        raise InputError(f"{what} is missing")
    try:
        image = pictures.read(picture)
    except OSError as error:
        raise InputError(f"{what} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{what} {error}") from error
    if image.shape[:2] != (camera.height, camera.width):
        raise InputError(
            f"{what} is {image.shape[1]} x {image.shape[0]} pixels, its camera's are"
            f" {camera.width} x {camera.height}"
        )
    return image


def _partial(entry: Any, path: Path, name: str) -> dict[Axis, float]:
    """{"y_mm": 26} to {Axis.Y: 0.026}."""
    if not isinstance(entry, dict) or not entry:
        raise InputError(f"goal file '{path}': {name} lacks its goal or pose")
    units = {f"{axis}_{axis.report_unit}": axis for axis in Axis}
    result = {}
    for key, value in entry.items():
        if key not in units:
            raise unknown("goal field", key, units, f"in goal file '{path}'")
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e4:
            raise InputError(f"goal file '{path}': {name} {key} is {value!r}; it must be a number")
        result[units[key]] = units[key].from_report(float(value))
    return result


def _report(goal: Partial) -> dict[str, float]:
    return {f"{a}_{a.report_unit}": round(a.to_report(v), 3) + 0.0 for a, v in goal.items()}
