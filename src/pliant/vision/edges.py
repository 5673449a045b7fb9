"""Measures a picture as a Scene without colour: by the edges of a block and a peg of known size.

The block is two upright edges a known width apart, with a top edge; its uprights show the camera's
roll. The peg is two parallel lines (`peg_lines.py`). An `Offset` corrects a camera that is not
quite where its calibration says (`offset.py`).
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pliant.cell import Camera, View
from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.block import FRONT_X, upright_edges
from pliant.vision.lines import (
    STRETCH,
    Floats,
    Pair,
    averaged,
    fit_pair,
    in_order,
    level,
    middle_of,
    peaks,
    unrolled,
    upright,
    weight,
)
from pliant.vision.measure import between
from pliant.vision.offset import UNKNOWN, Offset
from pliant.vision.peg_lines import PegLines, peg_lines
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Scene
from pliant.vision.seen import hole_seen, peg_seen, shifted

_BLUR = 0.8  # [px] against noise
_PIECE = 12  # [px] of an edge that is averaged
_ASIDE = 7  # [px] of an edge, where its steps are looked for
_HOLE_REACH = 0.037  # [m] how far the hole's centre may be from nominal along y
_BOARD_REACH = 0.012  # [m] and the surface along z
_MOST_ROLL = math.radians(0.6)  # of the camera
_SURE = 0.15  # by how much stronger edges must be to be preferred
_TURNED_PX = 1.0  # by which an outline is wider than the face
_LEAST_SCORE, _LEAST_SUPPORT = 0.15, 0.35  # of at most 1

# Standard deviations that no fit tells, measured on random looks (tests/test_edges.py).
_PLACE_SD, _HEIGHT_SD, _SURFACE_SD, _TILT_SD = 1.4e-4, 0.8e-4, 3e-4, math.radians(0.12)  # [m, rad]
_WELL_SEEN, _DOUBT_TILT, _DOUBT_PX = 1.55, math.radians(3.5), 1.5  # support; for each 1 below it


@dataclass(frozen=True, kw_only=True)
class Aside:
    """Facts that a camera does not see itself: how the board is turned [rad] and how much nearer
    than nominal it is [m]; where the peg's tip is along the camera's axis [m], which is about where
    the hand is if that is None, and by how much the peg's axis comes nearer where it rises by 1."""

    board_yaw: float = 0.0
    board_x: float = 0.0
    tip_x: float | None = None
    lean: float = 0.0


NOMINAL = Aside()


def measure_edges(
    view: View,
    task: Task,
    pose: Pose,
    *,
    aside: Aside = NOMINAL,
    offset: Offset = UNKNOWN,
    pressed: float | None = None,
) -> Scene:
    """Measure the peg and the hole in a picture from +x, without colour. Not found is None, with
    the reason.

    `pose` is the measured one of the hinge point, `pressed` by how much the wrist is shorter than
    unloaded [m]: they tell where to look for the peg. A picture from another side, with level
    columns, is measured with camera and pose turned about z to +x.
    """
    smooth = cv2.GaussianBlur(view.image.astype(np.float32), (0, 0), _BLUR)
    picture = np.asarray(smooth, np.float32)
    problems: list[str] = []
    from_block = replace(view.camera, position=view.camera.position - (aside.board_x, 0.0, 0.0))
    block = _block(picture, from_block, aside.board_yaw, offset)
    if block is None:
        problems.append("no hole: no pair of upright edges as wide as the block")
    roll, top = (0.0, math.inf) if block is None else (block.roll, block.top)
    peg_x = pose.x if aside.tip_x is None else aside.tip_x + aside.lean * task.peg.length / 2
    from_peg = replace(view.camera, position=view.camera.position - (peg_x, 0.0, 0.0))
    found = peg_lines(picture, from_peg, task, replace(pose, x=0.0), offset, top, pressed)
    if found is None:
        problems.append("no peg: no lines like its sides where the arm holds it")
    return Scene(
        peg=None if found is None else _peg(found, from_peg, task, pose, offset, aside.lean, roll),
        hole=None if block is None else _hole(block, from_block, aside.board_yaw, offset),
        problems=tuple(problems),
        time_s=view.time_s,
    )


# --- the block ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Block:
    """The block's outermost upright edges and its top [px], as if the camera had no roll [rad]."""

    left: float
    right: float
    top: float
    bottom: float
    roll: float
    place_sd: float
    top_sd: float


def _block(picture: Floats, camera: Camera, yaw: float, offset: Offset) -> _Block | None:
    scale = 1.0 / camera.metres_per_pixel(FRONT_X)
    top, up_down = _row(camera, -offset.z.value), (_BOARD_REACH + offset.reach) * scale
    outer, face = _block_at(camera, yaw, -offset.y.value)
    rows = slice(round(top + up_down), camera.height - 6)
    first = max(0, round(top - up_down) - 2 * _PIECE)  # above it nothing is looked at
    uprights = upright(picture[first:], piece=_PIECE)
    column = uprights[rows.start - first : rows.stop - first][_PIECE // 2 :: _PIECE].mean(axis=0)
    slack = round((_HOLE_REACH + offset.reach) * scale)
    pair = _pair(picture, column, rows, outer, slack)
    if outer[1] - outer[0] - (face[1] - face[0]) > _TURNED_PX:
        # Turned, it shows two faces, of which the narrow one may be as dark as what is behind.
        of_face = _pair(picture, column, rows, face, slack)
        if of_face is not None:
            wider = replace(
                of_face,
                left=of_face.left + outer[0] - face[0],
                right=of_face.right + outer[1] - face[1],
            )
            corners = (outer[0], *face, outer[1])
            if pair is None or _seen(column, wider, corners) > _SURE + _seen(column, pair, corners):
                pair = wider
    if pair is None:
        return None
    found = _block_top(picture, uprights, first, pair, top, up_down)
    if found is None:
        return None
    top_row, top_sd = found
    roll = math.atan(pair.slope)  # positive tilts to the left
    rolled = [(pair.left, pair.at), (pair.right, pair.at), ((pair.left + pair.right) / 2, top_row)]
    straight = unrolled(camera, np.array(rolled), roll)
    return _Block(
        left=float(straight[0, 0]),
        right=float(straight[1, 0]),
        top=float(straight[2, 1]),
        bottom=float(rows.stop),
        roll=roll,
        place_sd=pair.place_sd,
        top_sd=top_sd,
    )


def _pair(
    picture: Floats, column: Floats, rows: slice, at: tuple[float, float], slack: int
) -> Pair | None:
    """The best pair of upright edges as far apart as `at` and within `slack` of it [px]."""
    left, right = at
    near = _uprights_at(column, left, right, slack)
    if near is None:
        return None
    pieces = range(rows.start, rows.stop - _PIECE, _PIECE)
    lines = []
    for line, at_column in enumerate(near):
        beside = slice(max(0, at_column - _ASIDE), at_column + _ASIDE + 1)
        profiles = averaged(picture[:, beside], rows.start, len(pieces), _PIECE)
        found = peaks(profiles, at_column - beside.start, 3.5)
        at_row = rows.start + _PIECE * found.profile + _PIECE / 2
        places = found.place + beside.start + 0.5
        which = np.full(len(places), line)
        lines.append(np.column_stack([which, places, at_row, weight(found.step)]))
    pair = fit_pair(in_order(lines), right - left, _MOST_ROLL)
    if pair is None or pair.support < _LEAST_SUPPORT * len(pieces):
        return None
    return pair


def _seen(column: Floats, pair: Pair, corners: tuple[float, ...]) -> float:
    """The strength of the upright edges at all corners [px], if the outermost are that pair."""
    total = 0.0
    for corner in corners:
        at = round(pair.left + corner - corners[0])
        total += float(np.max(column[max(0, at - 2) : at + 3], initial=0.0))
    return total


def _uprights_at(column: Floats, left: float, right: float, slack: int) -> tuple[int, int] | None:
    """The columns of the best pair of upright edges as far apart as `left` and `right` and within
    `slack` of them [px], from how strong an edge each column is."""
    near = np.maximum(column, np.maximum(np.roll(column, 1), np.roll(column, -1)))
    width = right - left
    widths = np.arange(round(width * (1 - STRETCH)), round(width * (1 + STRETCH)) + 1)
    best, at = _LEAST_SCORE, None
    for wide in widths[np.argsort(np.abs(widths - width))].tolist():  # of equals the most likely
        first, last = max(2, round(left) - slack), min(round(left) + slack, len(near) - wide - 2)
        if last <= first:
            continue
        scores = np.minimum(near[first:last], near[first + wide : last + wide])
        n = int(np.argmax(scores))
        if scores[n] > best:
            best, at = float(scores[n]), (first + n, first + n + wide)
    return at


def _block_top(
    picture: Floats, uprights: Floats, first: int, pair: Pair, expected: float, reach: float
) -> tuple[float, float] | None:
    """The (row, sd) [px] of the block's top: a level edge, above which its upright edges end, whose
    strengths are given from a `first` row on."""
    low, high = round(expected - reach), round(expected + reach)
    left, right = round(pair.left), round(pair.right)
    levels = level(picture[low - 1 : high + 1], piece=_PIECE)[1:-1]
    edge = levels[:, left + _PIECE : right - _PIECE : _PIECE].mean(axis=1)
    sides = [uprights[:, c - 1 : c + 2].max(axis=1) for c in (left, right)]
    weaker = np.minimum(sides[0], sides[1])
    rows = np.arange(low - first, high - first)
    ends = weaker[rows + _PIECE // 2 + 2] - weaker[rows - _PIECE // 2 - 2]
    score = edge + 0.5 * ends
    at = low + int(np.argmax(score))
    columns = np.arange(left + 4, right - 4 - _PIECE, _PIECE)
    around = picture[at - 8 : at + 9, columns[:, None] + np.arange(_PIECE)].mean(axis=2)
    places = at - 8 + peaks(around.transpose(1, 0, 2), 8, 3.0).place + 0.5
    return middle_of(places, least_sd=0.2)


def _block_at(
    camera: Camera, yaw: float, y: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Columns of the outermost upright edges of a block with its axis at `y` [m], and of the edges
    of its nearest face."""
    columns = [
        camera.project(np.array([at_x, at_y, camera.position[2]]))[0]
        for at_x, at_y in upright_edges(0.0, y, yaw)
    ]
    return (min(columns), max(columns)), (columns[2], columns[3])


def _row(camera: Camera, z: float) -> float:
    """Row of a level edge of the block at `z` [m]: of the near face, or of the far one where the
    camera looks down on it."""
    x = FRONT_X if z > camera.position[2] else -FRONT_X
    return camera.project(np.array([x, 0.0, z]))[1]


def _hole(block: _Block, camera: Camera, yaw: float, offset: Offset) -> HoleSeen:
    mpp = camera.metres_per_pixel(FRONT_X)
    seen, y = (block.left + block.right) / 2, 0.0
    for _ in range(3):
        left, right = _block_at(camera, yaw, y)[0]
        y += (seen - (left + right) / 2) * mpp
    x = FRONT_X if block.top < camera.height / 2 else -FRONT_X
    _, surface = camera.on_plane_x(camera.width / 2, block.top, x)
    return hole_seen(
        left=block.left,
        right=block.right,
        top=block.top,
        bottom=block.bottom,
        y=shifted(y, math.hypot(block.place_sd * mpp, _PLACE_SD), offset.y),
        surface_z=shifted(surface, math.hypot(block.top_sd * mpp, _SURFACE_SD), offset.z),
    )


# --- the peg -----------------------------------------------------------------------------------


def _peg(
    lines: PegLines,
    camera: Camera,
    task: Task,
    pose: Pose,
    offset: Offset,
    lean: float,
    roll: float,
) -> PegSeen:
    peg = task.peg
    tilt = lines.tilt - roll
    left, right, top = unrolled(camera, np.array([lines.left, lines.right, lines.top]), roll)
    near = peg.front(0.3 * peg.half_extents[1], pose.yaw)
    at_top = near + lean * peg.length / 2
    _, top_z = camera.on_plane_x(float(top[0]), float(top[1]), at_top)
    top_z += near * lean  # its near edge is the lower one where it leans towards the camera
    y, z, _ = between(camera, left, right, tilt, lines.edges)
    tip_z = top_z - peg.length * math.cos(tilt)
    tip_y = y - (tip_z - z) * math.tan(tilt)
    mpp = camera.metres_per_pixel(peg.silhouette_x)
    doubt = max(0.0, _WELL_SEEN - lines.support)
    tilt_sd = math.hypot(lines.tilt_sd, _TILT_SD, doubt * _DOUBT_TILT)
    place_sd = math.hypot(lines.place_sd * mpp, doubt * _DOUBT_PX * mpp, abs(tip_z - z) * tilt_sd)
    return peg_seen(
        camera,
        peg,
        pose.yaw,
        top=top,
        tilt=Measured(value=tilt, sd=tilt_sd),
        y=shifted(tip_y, math.hypot(place_sd, _PLACE_SD), offset.y),
        z=shifted(tip_z, math.hypot(lines.top_sd * mpp, _HEIGHT_SD, doubt * mpp), offset.z),
    )
