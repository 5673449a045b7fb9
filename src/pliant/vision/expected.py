"""A thing of known outline where it is expected in a picture, and the small picture around it that
a network is shown: upright, at a scale of its own, with the expected silhouettes beside the
colours.

So a network never needs to know which peg or which camera it is for: it says how what it sees is
shifted and turned from a silhouette.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera
from pliant.pose import Pose
from pliant.task import BLOCK_SIZE, Peg, Task
from pliant.vision.lines import Points, cut, turn
from pliant.vision.offset import tip_in_line

SIZE = 128  # [px] of a small picture's sides
CHANNELS = 5  # red, green, blue, the silhouette, the other thing's
_SIDES = 24  # of a disc
_SHIFT = 4  # fractional bits of a polygon's corners
_LONG, _WIDE = 84.0, 64.0  # [px] that a thing is at most, along and across
_FARTHER_OUT = 1.65  # how much more a first look takes in
_BLOCK_AT = -0.15  # of SIZE from the middle: where the block's top is looked for
_HALVED = 1.4  # [px] of the picture in one of a small one, from which it is shrunk first

Image = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class Outlined:
    """A straight thing where it is expected: its `outline` (n, 2) [m] about its axis, from the foot
    at (x, y, z) [m] up by `length` [m], or down if that is negative. Its axis leans by `tilt` [rad]
    to the left of a camera at +x and comes nearer by `lean` where it rises by 1; `yaw` [rad] is how
    it is turned about it."""

    outline: Points
    length: float
    x: float
    y: float
    z: float
    tilt: float
    lean: float
    yaw: float

    def corners(self) -> NDArray[np.float64]:  # (2 n, 3) [m]
        flat = self.outline @ turn(self.yaw)
        foot = np.column_stack([flat, np.zeros(len(flat))])
        top = foot + (0.0, 0.0, self.length)
        up = np.array([self.lean, -math.tan(self.tilt), 1.0])
        leaning = _from_upright(up / np.linalg.norm(up))
        return np.vstack([foot, top]) @ leaning.T + (self.x, self.y, self.z)

    def seen(self, camera: Camera) -> "Silhouette":
        """Its silhouette in a camera's picture."""
        n = len(self.outline)
        corners = self.corners()
        ends = np.stack([corners[:n].mean(axis=0), corners[n:].mean(axis=0)])
        ends += np.array([self.x, self.y, self.z]) - ends[0]
        foot, top = _projected(camera, ends)
        hull = cv2.convexHull(_projected(camera, corners).astype(np.float32))
        up = (top - foot) * math.copysign(1.0, self.length)
        return Silhouette(
            foot=foot,
            middle=(foot + top) / 2,
            tilt=math.atan2(-up[0], -up[1]),
            hull=hull.reshape(-1, 2).astype(np.float64),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Silhouette:
    """A silhouette in a picture [px]: its foot and its middle (2,), its axis' tilt to the left
    [rad], its corners (n, 2)."""

    foot: Points
    middle: Points
    tilt: float
    hull: Points


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The frame of a small picture in a picture: its middle is at `centre` (2,) [px], it is turned
    by `tilt` [rad], and one of its pixels is `scale` of the picture's."""

    centre: Points
    tilt: float
    scale: float

    def inside(self, points: Points) -> Points:
        """Points (n, 2) of the picture in the small one."""
        return (points - self.centre) @ turn(self.tilt) / self.scale + SIZE / 2

    def way_back(self, step: Points) -> Points:
        """A step (2,) in the small picture as one in the picture."""
        return self.scale * (turn(self.tilt) @ step)

    def way_in(self, step: Points) -> Points:
        """A step (2,) in the picture as one in the small picture."""
        return step @ turn(self.tilt) / self.scale

    def cut(self, pictures: "Pictures") -> Image:  # (SIZE, SIZE, 3)
        """The small picture."""
        halved = self.scale > _HALVED
        image, factor = (pictures.half, 0.5) if halved else (pictures.whole, 1.0)
        axes, middle = factor * self.scale * turn(self.tilt), np.full(2, SIZE / 2)
        found = cut(image, factor * self.centre, axes, middle, (SIZE, SIZE))
        return found.astype(np.uint8, copy=False)

    def drawn(self, silhouette: Silhouette) -> Image:  # (SIZE, SIZE)
        """A silhouette in the small picture: 255 inside."""
        mask = np.zeros((SIZE, SIZE), np.uint8)
        corners = np.round((self.inside(silhouette.hull) - 0.5) * (1 << _SHIFT))
        cv2.fillConvexPoly(mask, corners.astype(np.int32), 255, cv2.LINE_AA, _SHIFT)
        return mask


@dataclass(frozen=True, kw_only=True, eq=False)
class Pictures:
    """A picture, and the same at half the size."""

    whole: Image
    half: Image

    @classmethod
    def of(cls, image: Image) -> Self:
        half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        return cls(whole=image, half=half.astype(np.uint8, copy=False))


def shown(pictures: Pictures, frame: Frame, thing: Silhouette, other: Silhouette) -> Image:
    """What the network is shown of a thing (CHANNELS, SIZE, SIZE)."""
    colours = frame.cut(pictures).transpose(2, 0, 1)
    return np.concatenate([colours, frame.drawn(thing)[None], frame.drawn(other)[None]])


def peg_frame(camera: Camera, peg: Outlined, seen: Silhouette, *, first: bool) -> Frame:
    """The frame around a peg; a `first` look takes in more."""
    across = float(np.ptp(peg.outline[:, 1]))
    metres = max(peg.length / _LONG, across / _WIDE) * (_FARTHER_OUT if first else 1.0)
    scale = metres / camera.metres_per_pixel(peg.x)
    return Frame(centre=seen.middle, tilt=seen.tilt, scale=scale)


def block_frame(camera: Camera, block: Outlined, seen: Silhouette, *, first: bool) -> Frame:
    """The frame around the block's upper part; a `first` look takes in more."""
    metres = BLOCK_SIZE[1] / _WIDE / 1.45 * (1.45 if first else 1.0)
    scale = metres / camera.metres_per_pixel(block.x)
    down = np.array([math.sin(seen.tilt), math.cos(seen.tilt)])
    return Frame(centre=seen.foot - _BLOCK_AT * SIZE * scale * down, tilt=seen.tilt, scale=scale)


def outlined_peg(peg: Peg, **at: float) -> Outlined:
    """A peg, with its tip at x, y, z."""
    return Outlined(outline=_outline(peg), length=peg.length, **at)


def outlined_block(**at: float) -> Outlined:
    """The block, with its hole's centre on the surface at x, y, z."""
    half_x, half_y = BLOCK_SIZE[0] / 2, BLOCK_SIZE[1] / 2
    face = np.array([(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)])
    return Outlined(outline=face, length=-BLOCK_SIZE[2], **at)


def hanging_peg(task: Task, pose: Pose, pressed: float, *, x: float, lean: float) -> Outlined:
    """The peg where it is expected before anything was seen: in a line with the tool, which takes
    on half of the hand's roll, the wrist shorter by `pressed` [m] than unloaded."""
    tilt = pose.roll / 2
    y, z = tip_in_line(task, pose, tilt, pressed)
    return outlined_peg(task.peg, x=x, y=y, z=z, tilt=tilt, lean=lean, yaw=pose.yaw)


def moved(thing: Outlined, camera: Camera, foot: Points, turn: float) -> Outlined:
    """A thing with its foot at another place of the picture (2,) [px], turned by `turn` [rad]."""
    y, z = camera.on_plane_x(float(foot[0]), float(foot[1]), thing.x)
    return replace(thing, y=y, z=z, tilt=thing.tilt + turn)


def _outline(peg: Peg) -> Points:
    if peg.radius is None:
        return np.array(peg.outline)
    angles = math.tau * np.arange(_SIDES) / _SIDES
    return peg.radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _projected(camera: Camera, points: NDArray[np.float64]) -> Points:
    seen = (points - camera.position) @ camera.rotation
    middle = np.array([camera.width / 2, camera.height / 2])
    return np.asarray(middle + camera.focal_px * seen[:, :2] / seen[:, 2:])


def _from_upright(axis: NDArray[np.float64]) -> NDArray[np.float64]:  # (3, 3)
    """The shortest turn that brings an upright axis to this one."""
    x, y, z = axis
    k = 1.0 / (1.0 + z)
    return np.array([[1 - k * x * x, -k * x * y, x], [-k * x * y, 1 - k * y * y, y], [-x, -y, z]])
