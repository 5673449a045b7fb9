"""The teaching: a goal, a pose and a picture per contact formation (Sec. III: p_g and I_g).

Goals are taught once, with the circular peg in the nominal cell, and used unchanged for every other
peg, which is thereby unseen. They are kept as a YAML file with its pictures beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter

from pliant import files, pictures
from pliant.cell import Camera, View
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.files import Fields
from pliant.formations import Formation, Goals
from pliant.paths import located, seen_from
from pliant.pose import Axis, Partial, Pose
from pliant.task import Task, load_task, located_peg, shipped_pegs
from pliant.vision.measure import SIMULATED, Colours, measure
from pliant.vision.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """The record of how a goal was taught: the pose that was reached, the picture, the peg: its
    name, or the absolute path of its file."""

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
    with resources.as_file(resources.files("pliant") / "goals") as folder:
        return load(folder / "goals.yaml")


def load(path: Path, limits: Limits | None = None, colours: Colours = SIMULATED) -> Teaching:
    """Read taught goals. `colours` are those of their pictures. A peg file and pictures that the
    file names count from its folder.

    Raises:
        InputError: the file or a picture is missing or broken, or a goal is out of the workspace.
    """
    document = files.read_yaml(located(path), "goal file", "leave it out to use the shipped goals")
    document.fields()
    found = files.checked(document, _FILE)
    folder = located(path).parent
    with document.at(("peg",)):
        peg = located_peg(found.peg, folder)
        load_task(peg)
    camera = found.camera.camera
    goals: dict[Formation, Partial] = {}
    demonstrations: dict[Formation, Demonstration] = {}
    for formation, entry in found.formations.items():
        goals[formation] = entry.goal.partial
        outside = (limits or Limits()).outside(goals[formation], margin=True)
        if outside is not None:
            raise document.error(("formations", formation, "goal"), f"{formation} {outside}")
        with document.at(("formations", formation, "picture")):
            image = _picture(folder, entry.picture, formation, camera)
        demonstrations[formation] = Demonstration(
            formation=formation,
            pose=Pose().updated(entry.pose.partial),
            peg=peg,
            view=View(camera=camera, time_s=0.0, image=image),
        )
    with document.at(("formations",)):
        return taught(Goals(formations=goals), demonstrations, colours)


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
        files.write_bytes(path.parent / picture, pictures.encoded(shown.view.image))
        entries[str(formation)] = {
            "goal": _report(teaching.goals.formations[formation]),
            "pose": _report({axis: shown.pose[axis] for axis in Axis}),
            "picture": picture,
        }
    camera, is_shipped = shown.view.camera, shown.peg in shipped_pegs()
    document = {
        "schema": 1,
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
    files.write_text(path, files.yaml_text(document))


_Number = Annotated[float, Field(gt=-10_000, lt=10_000)]


class _Values(Fields):
    """Some axes' values, in millimetres and degrees."""

    x_mm: _Number = 0.0
    y_mm: _Number = 0.0
    z_mm: _Number = 0.0
    roll_deg: _Number = 0.0
    pitch_deg: _Number = 0.0
    yaw_deg: _Number = 0.0

    @property
    def partial(self) -> dict[Axis, float]:
        """The values that are given, by their axes: {"y_mm": 26} is {Axis.Y: 0.026}."""
        units = {f"{axis}_{axis.report_unit}": axis for axis in Axis}
        given = [name for name in units if name in self.model_fields_set]
        return {units[name]: units[name].from_report(getattr(self, name)) for name in given}


class _Entry(Fields):
    goal: _Values
    pose: _Values
    picture: str


_Row = tuple[_Number, _Number, _Number]


class _Camera(Fields):
    name: str
    size_px: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    focal_px: Annotated[float, Field(gt=0)]
    position_m: _Row
    rotation: tuple[_Row, _Row, _Row]

    @property
    def camera(self) -> Camera:
        return Camera(
            name=self.name,
            width=self.size_px[0],
            height=self.size_px[1],
            focal_px=self.focal_px,
            position=np.array(self.position_m),
            rotation=np.array(self.rotation),
        )


class _File(Fields):
    format: Literal[1] = Field(alias="schema")
    peg: str
    frame: Literal["task"] = "task"
    camera: _Camera
    formations: dict[Formation, _Entry]


_FILE = TypeAdapter(_File)


def _picture(folder: Path, name: str, formation: str, camera: Camera) -> Any:
    picture = folder / name
    what = f"the picture '{picture}' of {formation}"
    if picture.parent != folder or picture.name == "..":
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


def _report(goal: Partial) -> dict[str, float]:
    return {f"{a}_{a.report_unit}": round(a.to_report(v), 3) + 0.0 for a, v in goal.items()}
