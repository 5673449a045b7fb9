"""Measures a picture as a Scene without colour, by a small learned network.

The network is shown what is around the place where a thing of known outline is expected, with that
outline drawn in (`expected.py`), and says how the thing is shifted and turned from there, each with
a standard deviation, and whether it is there at all. It looks again where it then is expected, and
closer. It was trained outside this package (`training/sight`, docs/learned-sight.md) and is run by
OpenCV.
"""

import math
import threading
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera, View
from pliant.errors import InputError
from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.edges import NOMINAL, Aside
from pliant.vision.expected import (
    Frame,
    Outlined,
    Pictures,
    Silhouette,
    block_frame,
    hanging_peg,
    moved,
    outlined_block,
    peg_frame,
    shown,
)
from pliant.vision.lines import Points, unrolled
from pliant.vision.offset import UNKNOWN, Offset
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Scene
from pliant.vision.seen import hole_seen, peg_seen, shifted

FILE = "learned_sight.onnx"
_LOOKS = 3  # each closer to the thing than the one before
_SURE = 0.5  # that it is there
_MOST_SD = 0.004  # [m] of a place: a wider one tells nothing
_PLACE_SD = 0.00015  # [m] of any place, by a camera that is turned and nearer than it says
_ROLL_SD = math.radians(0.17)  # of a camera whose roll is not seen
_ANY_PRESSED = 0.005  # [m] where the compression is not known
_LOCK = threading.Lock()  # a network of OpenCV answers one question at a time


def measure_learned(
    view: View,
    task: Task,
    pose: Pose,
    *,
    aside: Aside = NOMINAL,
    offset: Offset = UNKNOWN,
    pressed: float | None = None,
) -> Scene:
    """Measure the peg and the hole in a picture from +x, as `measure_edges` does, with its
    arguments. Not found is None, with the reason."""
    camera, pictures = view.camera, Pictures.of(view.image)
    x = pose.x if aside.tip_x is None else aside.tip_x
    hangs = hanging_peg(
        task, pose, _ANY_PRESSED if pressed is None else pressed, x=x, lean=aside.lean
    )
    peg = replace(hangs, y=hangs.y - offset.y.value, z=hangs.z - offset.z.value)
    block = outlined_block(
        x=aside.board_x,
        y=-offset.y.value,
        z=-offset.z.value,
        tilt=0.0,
        lean=0.0,
        yaw=aside.board_yaw,
    )
    for look in range(_LOOKS):
        seen_peg, seen_block = peg.seen(camera), block.seen(camera)
        frames = (
            peg_frame(camera, peg, seen_peg, first=look == 0),
            block_frame(camera, block, seen_block, first=look == 0),
        )
        answers = _asked(
            [
                shown(pictures, frames[0], seen_peg, seen_block),
                shown(pictures, frames[1], seen_block, seen_peg),
            ]
        )
        found_peg = _found(answers[0], frames[0], peg, seen_peg, camera)
        found_block = _found(answers[1], frames[1], block, seen_block, camera)
        peg, block = found_peg.thing, found_block.thing
    problems = []
    hole = roll = None
    if found_block.is_clear:
        roll = Measured(value=block.tilt, sd=found_block.turn_sd)
        hole = _hole(found_block, camera, offset)
    else:
        problems.append("no hole: the learned sight is not sure of the block")
    seen = None
    if found_peg.is_clear:
        seen = _peg(found_peg, camera, task, pose, offset, roll or Measured(value=0.0, sd=_ROLL_SD))
    else:
        problems.append("no peg: the learned sight is not sure of it")
    return Scene(peg=seen, hole=hole, problems=tuple(problems), time_s=view.time_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """A thing where the network finds it: its foot (2,) [px], standard deviations across, along [m]
    and of its turn [rad], and how sure it is that it is there."""

    thing: Outlined
    foot: Points
    across_sd: float
    along_sd: float
    turn_sd: float
    sure: float

    @property
    def is_clear(self) -> bool:
        return self.sure > _SURE and max(self.across_sd, self.along_sd) < _MOST_SD


def _found(
    answer: NDArray[np.float64],
    frame: Frame,
    thing: Outlined,
    silhouette: Silhouette,
    camera: Camera,
) -> _Found:
    across, along, turn, across_sd, along_sd, turn_sd, sure = (float(v) for v in answer)
    foot = silhouette.foot + frame.way_back(np.array([across, along]))
    small = frame.scale * camera.metres_per_pixel(thing.x)  # [m] of a small picture's pixel
    return _Found(
        thing=moved(thing, camera, foot, turn),
        foot=foot,
        across_sd=math.hypot(across_sd * small, _PLACE_SD),
        along_sd=math.hypot(along_sd * small, _PLACE_SD),
        turn_sd=turn_sd,
        sure=sure,
    )


def _asked(pictures: list[NDArray[np.uint8]]) -> NDArray[np.float64]:  # (n, 7)
    """The network's answer to each small picture."""
    batch = np.stack(pictures).astype(np.float32) / 255.0
    with _LOCK:
        loaded = network()
        loaded.setInput(batch)
        return np.asarray(loaded.forward(), np.float64)


@cache
def network() -> cv2.dnn.Net:
    """The network, loaded once: when a sight is made, so that nothing has moved if it cannot be.

    Raises:
        InputError: its file is missing or broken.
    """
    file = resources.files("pliant") / "vision" / FILE
    again = "install pliant again"
    try:
        return cv2.dnn.readNetFromONNX(np.frombuffer(file.read_bytes(), np.uint8))
    except OSError as error:
        raise InputError(
            f"the learned sight '{file}' cannot be read: {error.strerror}; {again}"
        ) from error
    except cv2.error as error:
        raise InputError(
            f"the learned sight '{file}' is broken: OpenCV cannot load it; {again}"
        ) from error


def _hole(found: _Found, camera: Camera, offset: Offset) -> HoleSeen:
    block = found.thing
    foot = unrolled(camera, found.foot[None], block.tilt)[0]
    y, z = camera.on_plane_x(float(foot[0]), float(foot[1]), block.x)
    straight = replace(block, y=y, z=z, tilt=0.0).seen(camera).hull
    (left, top), (right, bottom) = straight.min(axis=0), straight.max(axis=0)
    return hole_seen(
        left=float(left),
        right=float(right),
        top=float(top),
        bottom=min(float(bottom), camera.height - 6.0),
        y=shifted(y, found.across_sd, offset.y),
        surface_z=shifted(z, found.along_sd, offset.z),
    )


def _peg(
    found: _Found, camera: Camera, task: Task, pose: Pose, offset: Offset, roll: Measured
) -> PegSeen:
    peg = found.thing
    tip = unrolled(camera, found.foot[None], roll.value)[0]
    tilt = peg.tilt - roll.value
    y, z = camera.on_plane_x(float(tip[0]), float(tip[1]), peg.x)
    cos, sin = math.cos(tilt), math.sin(tilt)
    y_sd = math.hypot(cos * found.across_sd, sin * found.along_sd)
    z_sd = math.hypot(sin * found.across_sd, cos * found.along_sd)
    length = peg.length / camera.metres_per_pixel(task.peg.silhouette_x)
    return peg_seen(
        camera,
        task.peg,
        pose.yaw,
        top=tip - length * np.array([sin, cos]),
        tilt=Measured(value=tilt, sd=math.hypot(found.turn_sd, roll.sd)),
        y=shifted(y, y_sd, offset.y),
        z=shifted(z, z_sd, offset.z),
    )
