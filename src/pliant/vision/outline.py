"""Measures how the board is turned: by the edges of its block in the oblique picture, whatever its
colours.

The block's outline is a polygon of known size. It is searched for over its turn and its place in
the picture, by how strong an edge there is along its sides, and then fitted to the edges found.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera, View
from pliant.vision.block import corners_px
from pliant.vision.least_squares import Unknown, minimise
from pliant.vision.lines import Floats, derivative, peaks, strength, unrolled, weight
from pliant.vision.scene import Measured

_BLUR = 0.8  # [px] against noise
_PIECE = 7  # [px] of an edge that is averaged, at half the picture's size
_MOST_YAW, _YAW_STEP = math.radians(13), math.radians(1)
_DIRECTION = math.radians(3)  # edges closer than that in direction share their strengths
_REACH = (0.028, 0.022)  # [m] how far the block may be from nominal, across the picture and along
_NEAR_PX = (6.0, 3.0)  # from the outline, edges are looked for, first and again
_LEAST_SCORE = 0.2  # of at most 1
_FIT_PIECE, _MOST_EMPTY = 10.0, 0.5  # [px] of an edge in the fit; share of those without one
_ROBUST_PX = (4.0, 1.5)
_YAW_SD = math.radians(0.35)

# What the block's place, and the camera's roll, may differ from nominal by, as standard deviations.
_PRIOR = np.array([0.010, 0.015, 0.008, 10.0, math.radians(0.3)])  # x, y, z [m], yaw, roll [rad]


@dataclass(frozen=True, kw_only=True)
class Outline:
    """The place of the block: its angle about z [rad], and about where its axis is [m]."""

    yaw: Measured
    x: float
    y: float


def board_outline(view: View) -> Outline | None:
    """The block in a picture of the oblique camera; None: its outline is not found."""
    camera = view.camera
    smooth = np.asarray(cv2.GaussianBlur(view.image.astype(np.float32), (0, 0), _BLUR), np.float32)
    at = _search(smooth, camera)
    for near in _NEAR_PX:
        if at is None:
            return None
        at = _fit(smooth, camera, at, near)
    if at is None or abs(at[3]) > _MOST_YAW:
        return None
    x, y, _, yaw, _ = (float(value) for value in at)
    return Outline(yaw=Measured(value=yaw, sd=_YAW_SD), x=x, y=y)


@dataclass(frozen=True, kw_only=True)
class _Side:
    """A side of the outline: between which corners it lies, points (n, 2) [px] at the middles of
    its pieces, its unit normal (2,)."""

    ends: tuple[int, int]
    points: NDArray[np.float64]
    normal: NDArray[np.float64]


def _corners(camera: Camera, at: NDArray[np.float64]) -> NDArray[np.float64]:  # (8, 2) [px]
    """The corners of a block at (x, y, z, yaw, roll of the camera)."""
    x, y, z, yaw, roll = at
    return unrolled(camera, corners_px(camera, x, y, z, yaw), -roll)


def _sides(corners: NDArray[np.float64], piece: float) -> list[_Side]:
    """The outline of the block with these corners, in pieces [px]."""
    around = cv2.convexHull(corners.astype(np.float32), returnPoints=False)[:, 0].tolist()
    sides = []
    for i, j in zip(around, around[1:] + around[:1], strict=True):
        a, b = corners[i], corners[j]
        length = float(np.linalg.norm(b - a))
        pieces = int(length / piece)
        if pieces < 2:
            continue
        shares = (np.arange(pieces) + 0.5) / pieces
        points = a + shares[:, None] * (b - a)
        sides.append(_Side(ends=(i, j), points=points, normal=_normal(a, b)))
    return sides


def _normal(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    along = (b - a) / np.linalg.norm(b - a)
    return np.array([-along[1], along[0]])


def _search(picture: Floats, camera: Camera) -> NDArray[np.float64] | None:
    """The (x, y, z, yaw, roll) of the outline that most edges lie along, at half the picture's
    size."""
    strengths = _Strengths(picture)
    across, along = _REACH
    nominal, ahead, aside = (
        np.array(camera.project(np.array(place)))
        for place in ((0.0, 0.0, 0.0), (along, 0.0, 0.0), (0.0, across, 0.0))
    )
    reach = np.array([aside[0] - nominal[0], ahead[1] - nominal[1]])  # [px] right and down
    half = np.ceil(np.abs(reach) / 2).astype(int)
    best, found = _LEAST_SCORE, None
    for yaw in np.arange(-_MOST_YAW, _MOST_YAW + 1e-9, _YAW_STEP):
        at = np.array([0.0, 0.0, 0.0, yaw, 0.0])
        sides = _sides(_corners(camera, at), 2.0 * _PIECE)
        pieces = sum(len(side.points) for side in sides)
        total = np.sum([strengths.around(side, half) for side in sides], axis=0) / pieces
        n = int(np.argmax(total))
        if total.flat[n] > best:
            best = float(total.flat[n])
            row, column = divmod(n, total.shape[1])
            right, down = 2 * np.array([column - half[0], row - half[1]]) / reach
            found = np.array([down * along, right * across, 0.0, yaw, 0.0])
    return found


class _Strengths:
    """The strength of edges of some direction around each pixel, at half the size."""

    def __init__(self, picture: Floats) -> None:
        small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        self._steps = [derivative(np.asarray(small, np.float32), *d) for d in ((1, 0), (0, 1))]
        self._maps: dict[int, Floats] = {}

    def around(self, side: _Side, half: NDArray[np.int_]) -> Floats:
        """The sum over a side's pieces, for the side shifted by up to `half` (right, down) [px] to
        each side (2 half[1] + 1, 2 half[0] + 1)."""
        edges = self._across(side.normal)
        total = np.zeros((2 * half[1] + 1, 2 * half[0] + 1), np.float32)
        for point in side.points / 2:
            column, row = (round(value) for value in point.tolist())
            rows = np.arange(row - half[1], row + half[1] + 1)
            columns = np.arange(column - half[0], column + half[0] + 1)
            total += edges.take(rows, axis=0, mode="clip").take(columns, axis=1, mode="clip")
        return total

    def _across(self, normal: NDArray[np.float64]) -> Floats:
        angle = round(math.atan2(normal[1], normal[0]) % math.pi / _DIRECTION)
        if angle not in self._maps:
            cos, sin = math.cos(angle * _DIRECTION), math.sin(angle * _DIRECTION)
            mid = (_PIECE - 1) / 2
            piece = np.zeros((_PIECE, _PIECE), np.float32)
            for t in np.linspace(-mid, mid, 4 * _PIECE).tolist():
                piece[round(mid + cos * t), round(mid - sin * t)] = 1.0
            mean = cv2.filter2D(
                cos * self._steps[0] + sin * self._steps[1], -1, piece / piece.sum()
            )
            near = cv2.dilate(strength(mean), np.ones((3, 3), np.uint8))
            self._maps[angle] = np.asarray(near, np.float32)
        return self._maps[angle]


def _fit(
    picture: Floats, camera: Camera, start: NDArray[np.float64], near: float
) -> NDArray[np.float64] | None:
    """The outline refined by the edges within `near` [px] of it."""
    sides = _sides(_corners(camera, start), _FIT_PIECE)
    reach = math.ceil(near) + 3
    offsets, wide = np.arange(-reach, reach + 1), np.arange(-4, 5)
    found: list[NDArray[np.float64]] = []
    which: list[NDArray[np.int_]] = []
    steps: list[NDArray[np.float64]] = []
    empty = 0
    for number, side in enumerate(sides):
        along = np.array([side.normal[1], -side.normal[0]])
        strip = offsets[:, None, None] * side.normal + wide[None, :, None] * along
        grid = (side.points[:, None, None] - 0.5 + strip).astype(np.float32)
        flat = grid.reshape(-1, len(wide), 2)
        profiles = cv2.remap(picture, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR).mean(axis=1)
        seen = peaks(profiles.reshape(len(side.points), len(offsets), -1), reach, near)
        empty += len(side.points) - len(np.unique(seen.profile))
        found.append(side.points[seen.profile] + (seen.place - reach)[:, None] * side.normal)
        which.append(np.full(len(seen.profile), number))
        steps.append(seen.step)
    if empty > _MOST_EMPTY * sum(len(side.points) for side in sides):
        return None
    points, lines, counts = (
        np.concatenate(found),
        np.concatenate(which),
        weight(np.concatenate(steps)),
    )

    def off(at: NDArray[np.float64]) -> NDArray[np.float64]:
        corners = _corners(camera, at)
        distance = np.empty(len(points))
        for number, side in enumerate(sides):
            a, b = (corners[end] for end in side.ends)
            mine = lines == number
            distance[mine] = (points[mine] - a) @ _normal(a, b)
        return distance

    unknowns = [
        Unknown(start=float(value), prior=0.0, prior_sd=sd, step=1e-4)
        for value, sd in zip(start, _PRIOR, strict=True)
    ]
    return minimise(off, unknowns, sds=1 / np.sqrt(np.maximum(counts, 0.05)), robust=_ROBUST_PX)
