"""A trial drawn again from its stored joint positions, after it has ended.

Asking for a video thus does not slow a trial. Edges are smoothed by drawing larger and shrinking.
"""

import io
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant import files, folders
from pliant.conditions import Setup
from pliant.errors import InputError
from pliant.sim import constants as c
from pliant.sim import model as m
from pliant.sim.cell import Trajectory
from pliant.sim.render import Cameras
from pliant.sim.setup import apply, place
from pliant.task import Task

FILE = "trajectory.npz"
_ENLARGED = 2  # times as wide and high, before it is shrunk
_SETUP = "setup_"
_NPY = ".npy"
_MOST_BYTES = 1 << 27  # of a trajectory, packed or not: an hour's is a tenth of it
_BROKEN = (
    *(OSError, EOFError, ValueError, KeyError, TypeError, RuntimeError, NotImplementedError),
    *(MemoryError, zipfile.BadZipFile, zlib.error),
)


def save(folder: Path, trajectory: Trajectory) -> None:
    """Write a trajectory as `trajectory.npz`, whole or not at all.

    Raises:
        InputError: the folder cannot be written.
    """
    arrays: dict[str, NDArray[Any]] = {"time_s": trajectory.time_s, "qpos": trajectory.qpos}
    arrays |= {f"{_SETUP}{name}": np.array(v) for name, v in asdict(trajectory.setup).items()}
    with files.whole(folder / FILE) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def load(folder: Path) -> Trajectory:
    """Read a trajectory that `save` wrote.

    Raises:
        InputError: there is none, or it is broken.
    """
    path = folder / FILE
    if not path.is_file():
        raise InputError(f"'{path}' does not exist: only simulated trials have a trajectory")
    try:
        with zipfile.ZipFile(io.BytesIO(folders.read(path, _MOST_BYTES))) as archive:
            if sum(member.file_size for member in archive.infolist()) > _MOST_BYTES:
                raise ValueError(f"it holds more than {_MOST_BYTES / 1e6:.0f} MB")
            # A file that holds Python's own objects, which could run code, is not read.
            arrays: dict[str, NDArray[Any]] = {
                name: np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)
                for name in archive.namelist()
            }
        setup = {
            name.removeprefix(_SETUP).removesuffix(_NPY): array.item()
            for name, array in arrays.items()
            if name.startswith(_SETUP)
        }
        time_s, qpos = arrays[f"time_s{_NPY}"], arrays[f"qpos{_NPY}"]
        if time_s.ndim != 1 or qpos.ndim != 2 or len(qpos) != len(time_s) or not len(qpos):
            raise ValueError("times and joint positions do not match")
        if not all(a.dtype.kind == "f" and np.isfinite(a).all() for a in (time_s, qpos)):
            raise ValueError("a time or a joint position is not a number")
        return Trajectory(time_s=time_s, qpos=qpos, setup=Setup(**setup))
    except _BROKEN as error:
        raise InputError(f"'{path}' is broken: {error}; run the trial again") from error


class Replay:
    """Draws any moment of a trajectory. Close its cameras to free the renderer.

    `is_smooth`: pictures are drawn larger and shrunk, which smooths edges and takes twice as long.

    Raises:
        InputError: the trajectory belongs to another task.
    """

    def __init__(self, task: Task, trajectory: Trajectory, *, is_smooth: bool = True) -> None:
        enlarged = _ENLARGED if is_smooth else 1
        self._model = m.build(task)
        _hasten(self._model)
        size = self._model.vis.global_
        size.offwidth, size.offheight = (n * enlarged for n in c.IMAGE_SIZE)
        self._data = mujoco.MjData(self._model)
        self._slide = int(self._model.joint("wrist_z").qposadr[0])
        self.cameras = Cameras(self._model, enlarged=enlarged)
        self.turn_to(trajectory)

    def turn_to(self, trajectory: Trajectory) -> None:
        """Draw another trajectory of the same task from here on.

        Raises:
            InputError: the trajectory belongs to another task.
        """
        if trajectory.qpos.shape[1:] != (self._model.nq,):
            raise InputError(
                f"the trajectory has {trajectory.qpos.shape[1]} joints and the task's cell"
                f" {self._model.nq}: it belongs to another task"
            )
        self.trajectory = trajectory
        apply(self._model, trajectory.setup)
        self.cameras.dress(trajectory.setup)

    def __len__(self) -> int:
        return len(self.trajectory.time_s)

    def image(self, camera: str, index: int) -> NDArray[np.uint8]:  # (height, width, 3) RGB
        """The picture that `camera` sees at the trajectory's sample `index`."""
        place(self._model, self.trajectory.setup, float(self.trajectory.time_s[index]))
        large = self.cameras.image_at(camera, self._data, self.trajectory.qpos[index])
        if large.shape[1::-1] == c.IMAGE_SIZE:
            return large
        shrunk = cv2.resize(large, c.IMAGE_SIZE, interpolation=cv2.INTER_AREA)
        return shrunk.astype(np.uint8, copy=False)

    def compression(self, index: int) -> float:
        """The compression of the wrist, from free hang, where every trial starts [m]."""
        slide = self.trajectory.qpos[:, self._slide]
        return float(slide[index] - slide[0])


def _hasten(model: mujoco.MjModel) -> None:
    """Have a model drawn larger instead of multi-sampled, and with fewer triangles."""
    quality, size = model.vis.quality, model.vis.global_
    quality.offsamples, quality.numslices, quality.numstacks = 0, 20, 4
    size.offwidth, size.offheight = (n * _ENLARGED for n in c.IMAGE_SIZE)
