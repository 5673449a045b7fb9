"""A measurement drawn on its picture: Table I's points, and the peg's corners in metres."""

import math

import cv2
import numpy as np

from pliant.cell import View
from pliant.pictures import Picture
from pliant.report.canvas import WHITE, Colour, Point, cross, dot, lines, text
from pliant.task import Task
from pliant.vision.scene import HoleSeen, PegSeen, Scene

SCALE = 2  # drawn at twice the camera's resolution, so that lines and words are fine
_PEG: Colour = (255, 214, 10)
_HOLE: Colour = (250, 250, 250)
_METRIC: Colour = (255, 145, 220)
_WORDS = 1.15
_TILT_LINE = 85.0  # [px] length of the lines that show the tilt, from P_center


def draw(view: View, scene: Scene, task: Task) -> Picture:
    """The picture at `SCALE` times its size, RGB, with everything that was measured in it drawn on
    it.

    Yellow: the peg's minimum-area rectangle with P_center, P_edge and its tilt against the
    vertical. White: the block's rectangle with H_center. Pink: the whole peg's bottom corners and
    tip, as the calibration and the peg's length give them, also where the hole hides them.
    """
    size = (view.camera.width * SCALE, view.camera.height * SCALE)
    picture = cv2.resize(view.image, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8)
    if scene.hole is not None:
        _draw_hole(picture, scene.hole)
    if scene.peg is not None:
        _draw_metric(picture, view, scene.peg, task)
        _draw_peg(picture, scene.peg)
    for row, problem in enumerate((*scene.problems, *scene.doubts)):
        _label(picture, problem, (20, 44 + 44 * row))
    return picture


def _draw_hole(picture: Picture, hole: HoleSeen) -> None:
    lines(picture, [_up(p) for p in hole.box_px], _HOLE)
    u, v = _up(hole.center_px)
    cross(picture, (u, v), _HOLE)
    _label(picture, "H_center", (u, v + 56), colour=_HOLE, align="center")


def _draw_peg(picture: Picture, peg: PegSeen) -> None:
    lines(picture, [_up(p) for p in peg.box_px], _PEG)
    (u, v), edge = _up(peg.center_px), _up(peg.edge_px)
    tilt = math.radians(peg.tilt_deg)
    length = _TILT_LINE * SCALE
    top = (u - length * math.sin(tilt), v - length * math.cos(tilt))
    for row in range(0, round(length), 16):  # the vertical, dashed
        lines(picture, [(u, v - row), (u, v - row - 8)], WHITE, closed=False)
    lines(picture, [(u, v), top], _PEG, width=3, closed=False)
    dot(picture, (u, v), _PEG)
    dot(picture, edge, _PEG)
    left = min(p[0] for p in map(_up, peg.box_px)) - 14
    right = max(p[0] for p in map(_up, peg.box_px)) + 14
    _label(picture, "P_center", (left, v + 8), align="right")
    _label(picture, f"tilt {peg.tilt_deg:+.1f} deg", (left, v + 52), align="right")
    _label(picture, "P_edge", (right, edge[1] - 4))


def _draw_metric(picture: Picture, view: View, peg: PegSeen, task: Task) -> None:
    def seen(y: float, z: float) -> Point:
        return _up(view.camera.project(np.array([task.peg.silhouette_x, y, z])))

    left, right = seen(peg.left_y, peg.left_z), seen(peg.right_y, peg.right_z)
    tip = seen(peg.tip_y.value, peg.tip_z.value)
    lines(picture, [left, right], _METRIC, closed=False)
    for corner in (left, right):
        dot(picture, corner, _METRIC, radius=4.0)
    dot(picture, tip, _METRIC, radius=6.0)
    _label(picture, "tip", (tip[0], tip[1] + 42), colour=_METRIC, align="center")


def _label(
    picture: Picture, words: str, at: Point, *, colour: Colour = _PEG, align: str = "left"
) -> None:
    text(picture, words, at, scale=_WORDS, colour=colour, align=align, rim=True)


def _up(point: Point) -> Point:
    return point[0] * SCALE, point[1] * SCALE
