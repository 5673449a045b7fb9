"""The draft of the goals that are being taught, on the disk after every record, so that teaching
can be resumed."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pliant import files, pictures
from pliant.cell import Camera, View
from pliant.commissioning.session import Record
from pliant.errors import InputError
from pliant.formations import Formation
from pliant.paths import located, seen_from
from pliant.pose import Axis, Pose
from pliant.task import shipped_pegs

SCHEMA = 1
_FILE = "draft.yaml"
_ANEW = "remove its folder to begin anew"


@dataclass(frozen=True, kw_only=True)
class Draft:
    """A draft of goals, in a folder beside the goals file to be: YAML and a picture per record,
    lengths in metres. Files that it names count from the goals file's folder, so that all can be
    moved together."""

    folder: Path
    cell: Path | None
    peg: str

    @property
    def _made_with(self) -> dict[str, str]:
        """The cell and the peg as the draft names them."""
        beside = located(self.folder).parent
        is_shipped = self.peg in shipped_pegs()
        return {
            "cell": "sim" if self.cell is None else seen_from(located(self.cell), beside),
            "peg": self.peg if is_shipped else seen_from(located(self.peg), beside),
        }

    def load(self) -> tuple[Record, ...]:
        """The records that the draft holds, oldest first; none if there is no draft.

        Raises:
            InputError: the draft is broken, or of another cell or peg.
        """
        path = self.folder / _FILE
        if not path.exists():
            return ()
        try:
            document = files.read_yaml(path, "the draft", _ANEW).fields()
            if document["schema"] != SCHEMA:
                raise ValueError(f"its schema is not {SCHEMA}")
            for name, mine in self._made_with.items():
                if document[name] != mine:
                    raise InputError(
                        f"the draft '{self.folder}' has {name} '{document[name]}', not '{mine}': go"
                        " on with that, or remove the folder"
                    )
            return tuple(self._record(entry) for entry in document["records"])
        except InputError:
            raise
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the draft '{path}' cannot be used ({' '.join(str(error).split())}): {_ANEW}"
            ) from error

    def save(self, log: tuple[Record, ...]) -> None:
        """Keep these records in the draft, all or nothing.

        Raises:
            InputError: they cannot be written.
        """
        path = self.folder / _FILE
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            entries = [self._entry(index, record) for index, record in enumerate(log)]
            document = {"schema": SCHEMA, **self._made_with, "records": entries}
            files.write_bytes(path, files.yaml_text(document).encode())
        except OSError as error:
            raise InputError(
                f"the draft '{path}' cannot be written ({error.strerror}): choose another folder"
            ) from error

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _entry(self, index: int, record: Record) -> dict[str, Any]:
        picture = f"{index}-{record.formation}.png"
        files.write_bytes(self.folder / picture, pictures.encoded(record.view.image))
        camera = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in vars(record.view.camera).items()
        }
        return {
            "formation": str(record.formation),
            "goal": [record.goal[axis] for axis in Axis],
            "pose": [record.pose[axis] for axis in Axis],
            "picture": picture,
            "camera": camera,
        }

    def _record(self, entry: dict[str, Any]) -> Record:
        image = pictures.read(self.folder / Path(entry["picture"]).name)
        return Record(
            formation=Formation(entry["formation"]),
            goal=_pose(entry["goal"]),
            pose=_pose(entry["pose"]),
            view=View(camera=_camera(entry["camera"]), time_s=0.0, image=image),
        )


def _pose(values: list[float]) -> Pose:
    return Pose().updated(dict(zip(Axis, values, strict=True)))


def _camera(entry: dict[str, Any]) -> Camera:
    arrays = {name: np.array(entry[name], dtype=float) for name in ("position", "rotation")}
    return Camera(**{**entry, **arrays})
