"""Measures a picture as a Scene: colour segmentation, the largest contours, and what they measure
(Sec. V-A).

The pixel quantities are the paper's: HSV thresholds, largest contour, `cv2.minAreaRect`, P_center,
P_edge, H_center, tilt. The metric ones use the camera's calibration and the peg's known size: lines
fitted to the peg's two long edges give its tilt and axis, its visible top edge plus its length the
tip, and the block's two vertical edges the hole.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera, View
from pliant.task import Peg, Place, Task
from pliant.vision.block import FRONT_X, upright_edges
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Pixel, Scene, peg_at

Hsv = tuple[int, int, int]
Points = NDArray[np.float64]  # (n, 2) pixels, column and row


@dataclass(frozen=True, kw_only=True)
class Colours:
    """HSV ranges in OpenCV's units (hue 0-179). Red wraps around zero, so the block has two."""

    peg: tuple[tuple[Hsv, Hsv], ...] = (((80, 110, 40), (97, 255, 255)),)
    block: tuple[tuple[Hsv, Hsv], ...] = (
        ((0, 110, 40), (8, 255, 255)),
        ((172, 110, 40), (179, 255, 255)),
    )

    @property
    def peg_word(self) -> str:
        """The peg's colour in a word, such as "cyan"."""
        return _word(self.peg)

    @property
    def block_word(self) -> str:
        """The block's colour in a word, such as "red"."""
        return _word(self.block)


SIMULATED = Colours()
"""The colours of the simulation: a cyan peg, a red block."""

PAPER = Colours(peg=(((40, 80, 40), (78, 255, 255)),))
"""The colours of the paper's cell: a green peg, a red block."""

_HUES = {
    9: "red",
    22: "orange",
    34: "yellow",
    79: "green",
    99: "cyan",
    130: "blue",
    149: "violet",
    170: "pink",
    180: "red",
}
"""Words for hues, each up to its key (exclusive) in OpenCV's units."""
_GREYISH = 60  # a saturation up to which there is no hue to name
_LEAST_AREA = 400.0  # [px2] a smaller region is not the peg or the block
_EDGE_MARGIN = 6.0  # [px] kept clear of corners when lines are fitted
_FINGERS_M = 0.048  # [m] that the fingers reach below the peg's top
_BARE = 45.0  # [px] of bare edge that suffice
_TURNED = math.radians(1)  # a hand at a smaller angle looks as one at none
_LEAST_EDGE = 15  # points a long edge needs
_SAMPLED = 40  # of an edge's points, through pairs of which lines are tried
_HIDDEN = 0.8  # [px] further in than the edge: hidden by something
_PIXEL_SD = 0.35  # [px] of one edge's place: the width of a mask's staircase
_SEEN_FROM_ABOVE = 0.001  # [m] so far below the camera, the board's top face is seen
_LENGTH_SD = 0.001  # [m] of a peg in the air
_WIDTH_SD = 0.0005  # [m] of a peg, and what a mask leaves out of its edges
_TILT_SD = math.radians(0.17)  # [rad] of a fully visible 90 mm peg


def measure(
    view: View,
    task: Task,
    colours: Colours = SIMULATED,
    *,
    board_yaw: float = 0.0,
    hand_yaw: float = 0.0,
) -> Scene:
    """Measure the peg and the hole in a side picture. Not found is None, with the reason.

    `board_yaw` and `hand_yaw` [rad] are the angles of board and hand about z, which a side picture
    alone does not tell.
    """
    if abs(hand_yaw) < _TURNED:
        hand_yaw = 0.0
    hsv = hsv_of(view.image)
    problems: list[str] = []
    hole = _hole(hsv, view.camera, colours, board_yaw, problems)
    peg = _peg(hsv, view.camera, task, hole, colours, hand_yaw, problems)
    return Scene(peg=peg, hole=hole, problems=tuple(problems), time_s=view.time_s)


def _word(ranges: tuple[tuple[Hsv, Hsv], ...]) -> str:
    """The word for the colour in the middle of HSV ranges; of several, such as red's two, for the
    widest."""
    low, high = max(ranges, key=lambda r: r[1][0] - r[0][0])
    hue, _, value = ((a + b) // 2 for a, b in zip(low, high, strict=True))
    if high[1] <= _GREYISH:
        return "black" if value < 60 else "white" if value > 190 else "grey"
    return next(word for end, word in _HUES.items() if hue < end)


def hsv_of(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture in HSV, in OpenCV's units."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2HSV).astype(np.uint8, copy=False)


def mask_of(hsv: NDArray[np.uint8], ranges: tuple[tuple[Hsv, Hsv], ...]) -> NDArray[np.uint8]:
    """The mask of a picture in HSV: 255 where it is within the ranges, else 0."""
    mask = np.zeros(hsv.shape[:2], np.uint8)
    for low, high in ranges:
        mask |= cv2.inRange(hsv, np.array(low), np.array(high)).astype(np.uint8)
    return mask


def largest_contour(hsv: NDArray[np.uint8], ranges: tuple[tuple[Hsv, Hsv], ...]) -> Points | None:
    """The boundary's pixel centres of the largest region within the ranges; None: none is large."""
    mask = mask_of(hsv, ranges)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    largest = max(contours, key=cv2.contourArea)
    if cv2.contourArea(largest) < _LEAST_AREA:
        return None
    return largest.reshape(-1, 2).astype(np.float64) + 0.5  # pixel centres


def box_around(contour: Points) -> tuple[tuple[Pixel, Pixel, Pixel, Pixel], Pixel, float]:
    """Corners and centre of the minimum-area rectangle, and its tilt to the left [deg]."""
    rectangle = cv2.minAreaRect(contour.astype(np.float32))
    corners = cv2.boxPoints(rectangle).astype(float)
    sides = [corners[1] - corners[0], corners[2] - corners[1]]
    along = max(sides, key=lambda s: abs(s[1]))  # the side nearest to vertical
    up = -along if along[1] > 0 else along
    tilt = math.degrees(math.atan2(-up[0], -up[1]))
    a, b, c, d = ((float(u), float(v)) for u, v in corners)
    center = rectangle[0]
    return (a, b, c, d), (float(center[0]), float(center[1])), tilt


# --- the block ---------------------------------------------------------------------------------


def _hole(
    hsv: NDArray[np.uint8],
    camera: Camera,
    colours: Colours,
    board_yaw: float,
    problems: list[str],
) -> HoleSeen | None:
    contour = largest_contour(hsv, colours.block)
    if contour is None:
        problems.append("no hole: no red region in the picture")
        return None
    box, center, _ = box_around(contour)
    u, v = contour[:, 0], contour[:, 1]
    top = float(np.min(v))
    rows = (v > top + _EDGE_MARGIN) & (v < np.max(v) - _EDGE_MARGIN)
    left, right = u[rows & (u < center[0])], u[rows & (u > center[0])]
    if len(left) < _LEAST_EDGE or len(right) < _LEAST_EDGE:
        problems.append("no hole: the block's edges are not visible")
        return None
    if min(left) < 1 or max(right) > camera.width - 1:
        problems.append("no hole: the block is cut off by the picture's border")
        return None
    y = _middle_of_block(camera, float(np.median(left)), float(np.median(right)), board_yaw)
    columns = (u > np.median(left) + _EDGE_MARGIN) & (u < np.median(right) - _EDGE_MARGIN)
    upper = v[columns & (v < center[1])]
    _, surface = camera.on_plane_x(camera.width / 2, float(np.median(upper)) - 0.5, FRONT_X)
    if surface < camera.position[2] - _SEEN_FROM_ABOVE:  # the far edge is then the highest
        _, surface = camera.on_plane_x(camera.width / 2, float(np.median(upper)) - 0.5, -FRONT_X)
    sd = _PIXEL_SD * camera.metres_per_pixel(FRONT_X)
    return HoleSeen(
        box_px=box,
        center_px=center,
        y=Measured(value=y, sd=sd),
        surface_z=Measured(value=surface, sd=sd),
    )


def _middle_of_block(camera: Camera, left_u: float, right_u: float, yaw: float) -> float:
    """The y [m] of the block's axis from the columns of its outermost vertical edges: of the near
    face where the block faces the camera, of opposite corners where it is turned."""
    distance = abs(float(camera.position[0]))
    ordered = sorted(upright_edges(0.0, 0.0, yaw), key=lambda edge: edge[1] / (distance - edge[0]))
    middles = []
    for u, (x, y) in ((left_u, ordered[0]), (right_u, ordered[-1])):
        at, _ = camera.on_plane_x(u, camera.height / 2, x)
        middles.append(at - y)
    return sum(middles) / 2


# --- the peg -----------------------------------------------------------------------------------


def _peg(
    hsv: NDArray[np.uint8],
    camera: Camera,
    task: Task,
    hole: HoleSeen | None,
    colours: Colours,
    hand_yaw: float,
    problems: list[str],
) -> PegSeen | None:
    contour = largest_contour(hsv, colours.peg)
    if contour is None:
        problems.append("no peg: no cyan region in the picture")
        return None
    if np.min(contour) < 1 or np.any(contour.max(axis=0) > (camera.width - 1, camera.height - 1)):
        problems.append("no peg: it is cut off by the picture's border")
        return None
    box, center, tilt_deg = box_around(contour)
    bottom = sorted(box, key=lambda p: p[1])[2:]
    edge = max(bottom)

    sides = long_edges(contour, center, tilt_deg, camera, hole, hand_yaw)
    if sides is None:
        problems.append("no peg: its long edges are not visible")
        return None
    left_point, right_point, tilt, visible_px = sides
    axis = np.array([-math.sin(tilt), -math.cos(tilt)])  # up along the peg, in pixels
    across = np.array([math.cos(tilt), -math.sin(tilt)])  # to the right
    middle = (left_point + right_point) / 2

    # The top edge: the near side's.
    relative = contour - middle
    near_axis = np.abs(relative @ across) < 0.3 * abs((right_point - left_point) @ across) / 2
    top_px = middle + np.max((relative @ axis)[near_axis]) * axis
    near_x = task.peg.front(0.3 * task.peg.half_extents[1], hand_yaw)
    _, top_z = camera.on_plane_x(float(top_px[0]), float(top_px[1]), near_x)
    lowest_px = middle + np.min((relative @ axis)[near_axis]) * axis
    longer = None
    if hole is not None and lowest_px[1] < min(v for _, v in hole.box_px) - _EDGE_MARGIN:
        _, lowest_z = camera.on_plane_x(float(lowest_px[0]), float(lowest_px[1]), near_x)
        seen = (top_z - lowest_z) / math.cos(tilt)
        longer = Measured(value=seen - task.peg.length, sd=_LENGTH_SD)
    # Its place along y: where the axis, measured on the silhouette's plane, reaches that height.
    edges = outermost(camera, left_point, right_point, task.peg, hand_yaw)
    y0, z0, width = between(camera, left_point, right_point, tilt, edges)
    lean = math.tan(tilt)
    tip_z = top_z - task.peg.length * math.cos(tilt)
    tip_y = y0 - (tip_z - z0) * lean

    mpp = camera.metres_per_pixel(task.peg.silhouette_x)
    full_px = task.peg.length / mpp
    tilt_sd = _TILT_SD * (full_px / visible_px) ** 1.5
    middle_to_tip = abs(tip_z - z0)
    return peg_at(
        Measured(value=tip_y, sd=math.hypot(_PIXEL_SD * mpp, middle_to_tip * tilt_sd)),
        Measured(value=tip_z, sd=_PIXEL_SD * mpp * 1.5),
        Measured(value=tilt, sd=tilt_sd),
        task.peg.silhouette(),
        box_px=box,
        center_px=center,
        edge_px=edge,
        tilt_deg=tilt_deg,
        longer=longer,
        wider=wider_than(task.peg, width, edges, camera),
    )


def outermost(
    camera: Camera, left: Points, right: Points, peg: Peg, yaw: float
) -> tuple[Place, Place]:
    """The edges of a peg turned by `yaw` [rad] that a camera sees through a pixel on its left and
    one on its right."""
    slopes = [(point[0] - camera.width / 2) / camera.focal_px for point in (left, right)]
    return peg.silhouette(yaw, slopes=(slopes[0], slopes[1]))


def between(
    camera: Camera, left: Points, right: Points, tilt: float, edges: tuple[Place, Place]
) -> tuple[float, float, float]:  # (y, z), width [m]
    """A point on the axis of a peg that leans by `tilt` [rad] to the left, and how wide it looks,
    from a pixel on each of two edges that lie at these places from the axis."""
    (left_y, left_x), (right_y, right_x) = edges
    y_left, z_left = camera.on_plane_x(left[0], left[1], left_x)
    y_right, z_right = camera.on_plane_x(right[0], right[1], right_x)
    cos, sin = math.cos(tilt), math.sin(tilt)
    off = (left_y + right_y) / 2  # of the middle from the axis
    y, z = (y_left + y_right) / 2, (z_left + z_right) / 2
    return y - off * cos, z - off * sin, (y_right - y_left) * cos + (z_right - z_left) * sin


def wider_than(
    peg: Peg, seen: float, edges: tuple[Place, Place], camera: Camera, *, nearer: float = 0.0
) -> Measured:
    """By how much [m] a peg is wider than the task's, from the width that is `seen` of its mask
    between two edges. It stands `nearer` [m] to the camera than the plane of insertion."""
    (left_y, _), (right_y, _) = edges
    seen += camera.metres_per_pixel(peg.silhouette_x)  # a mask's outline runs through pixel centres
    seen *= 1 - nearer / float(camera.position[0])
    return Measured(value=seen - (right_y - left_y), sd=_WIDTH_SD)


def long_edges(
    contour: Points,
    center: Pixel,
    tilt_deg: float,
    camera: Camera,
    hole: HoleSeen | None,
    hand_yaw: float,
) -> tuple[Points, Points, float, float] | None:
    """A point on the peg's left and on its right edge, their tilt [rad], and their visible length
    [px]. The fingers of a turned hand may hide some of an edge, down from the peg's top; what is
    below is used where it is long enough.

    The second pass selects the points again with the first pass's tilt: the rectangle's own tilt is
    off by degrees where the board cuts the peg at an angle.
    """
    covered = _FINGERS_M / camera.metres_per_pixel(0.0) if hand_yaw else 0.0
    tilt, result = math.radians(tilt_deg), None
    lowest = hole.box_px if hole else None
    floor = min(p[1] for p in lowest) - _EDGE_MARGIN if lowest else math.inf
    for _ in range(2):
        axis = np.array([-math.sin(tilt), -math.cos(tilt)])
        across = np.array([math.cos(tilt), -math.sin(tilt)])
        relative = contour - np.array(center)
        along, side = relative @ axis, relative @ across
        left_at, right_at = np.percentile(side, 3), np.percentile(side, 97)
        inside = (
            (along < np.max(along) - _EDGE_MARGIN)
            & (along > np.min(along) + _EDGE_MARGIN)
            & (contour[:, 1] < floor)
        )
        width = right_at - left_at
        at_left, at_right = side < left_at + 0.2 * width, side > right_at - 0.2 * width
        left, right = contour[inside & at_left], contour[inside & at_right]
        if len(left) < _LEAST_EDGE or len(right) < _LEAST_EDGE:
            return None
        fit = _outermost_line if covered else _line
        bare = inside & (along < np.max(along) - covered)
        if covered and np.any(bare) and np.ptp(contour[bare, 1]) > _BARE:
            left, right, fit = contour[bare & at_left], contour[bare & at_right], _line
        (left_point, left_tilt), (right_point, right_tilt) = fit(left, -across), fit(right, across)
        tilt = (left_tilt + right_tilt) / 2
        visible_px = float(np.ptp(left[:, 1]) + np.ptp(right[:, 1])) / 2
        result = left_point, right_point, tilt, visible_px
    return result


def _line(points: Points, outward: Points) -> tuple[Points, float]:
    """A point on the line through edge points, and the line's tilt to the left [rad].

    Fingers may hide part of an edge; the mask then ends further in. Such points are left out.
    """
    kept = points
    for _ in range(3):
        line = cv2.fitLine(kept.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel()
        vx, vy, x, y = (float(w) for w in line)
        if vy > 0:
            vx, vy = -vx, -vy
        normal = np.array([-vy, vx])
        normal *= math.copysign(1.0, normal @ outward)
        outside = (points - (x, y)) @ normal
        closer = points[outside > -_HIDDEN]
        if len(closer) < _LEAST_EDGE:
            break
        kept = closer
    return np.array([x, y]), math.atan2(-vx, -vy)


def _outermost_line(points: Points, outward: Points) -> tuple[Points, float]:
    """A line as `_line` finds it, where most of an edge may be hidden: of the lines through two of
    the points the one that most points lie on and that none lies beyond."""
    sampled = points[np.argsort(points[:, 1])][:: max(1, len(points) // _SAMPLED)]
    first, second = np.triu_indices(len(sampled), k=max(2, len(sampled) // 3))
    along = sampled[second] - sampled[first]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign(normals @ outward)[:, None]
    beyond = points @ normals.T - np.sum(sampled[first] * normals, axis=1)  # (points, lines)
    score = np.sum(np.abs(beyond) < _HIDDEN, axis=0) - 3 * np.sum(beyond > 2 * _HIDDEN, axis=0)
    best = int(np.argmax(score))
    return _line(points[np.abs(beyond[:, best]) < 1.5 * _HIDDEN], outward)
