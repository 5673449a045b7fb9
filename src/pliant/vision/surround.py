"""The front and the oblique camera: where the peg and the hole are across the plane of insertion,
and how the board is turned.

The front camera stands at +y and looks along -y. Turned by a quarter about z its picture is one
from the side, so the same segmentation measures it. The oblique camera looks down on the block.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera, View
from pliant.task import Peg, Task
from pliant.vision.block import FRONT_X, corners_px
from pliant.vision.least_squares import Unknown, minimise
from pliant.vision.measure import (
    SIMULATED,
    Colours,
    between,
    box_around,
    hsv_of,
    largest_contour,
    long_edges,
    measure,
    outermost,
    wider_than,
)
from pliant.vision.scene import Across, Measured, PegSeen, Scene

SIDE, FRONT, OBLIQUE = "side", "front", "oblique"
ALL = (SIDE, FRONT, OBLIQUE)

_QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # +y becomes +x
_TILT_SD = math.radians(0.25)
_PLACE_SD = 0.0003  # [m]
_YAW_SD = math.radians(0.2)
_CONTOUR_STEP = 3  # every third point of the outline is enough
_ROBUST_PX = (20.0, 6.0, 2.0)
_MOST_YAW = math.radians(20)


def see(
    views: Mapping[str, View],
    task: Task,
    colours: Colours = SIMULATED,
    *,
    board_yaw: float = 0.0,
    hand_yaw: float = 0.0,
) -> Scene:
    """Measure the pictures of one moment. `board_yaw` [rad] is the last that was seen; an oblique
    picture among these gives a new one. `hand_yaw` [rad] is the arm's."""
    scene = measure(views[SIDE], task, colours, board_yaw=board_yaw, hand_yaw=hand_yaw)
    turned = None
    if OBLIQUE in views and scene.hole is not None:
        height = scene.hole.surface_z.value
        turned = _board_yaw(views[OBLIQUE], colours, scene.hole.y.value, height)
    if turned is not None:
        board_yaw = turned.value
        scene = measure(views[SIDE], task, colours, board_yaw=board_yaw, hand_yaw=hand_yaw)
    across = None
    if FRONT in views:
        across = _across(views[FRONT], task, scene.peg, colours, board_yaw, hand_yaw)
    return replace(scene, across=across, board_yaw=turned)


def _across(
    view: View,
    task: Task,
    beside: PegSeen | None,
    colours: Colours,
    board_yaw: float,
    hand_yaw: float,
) -> Across:
    camera = quarter_turned(view.camera)
    hole = measure(replace(view, camera=camera), task, colours, board_yaw=board_yaw).hole
    hole_x = None if hole is None else -hole.y
    peg = largest_contour(hsv_of(view.image), colours.peg)
    if peg is None or beside is None:
        return Across(tip_x=None, pitch=None, hole_x=hole_x)
    _, center, tilt_deg = box_around(peg)
    sides = long_edges(peg, center, tilt_deg, camera, hole, hand_yaw)
    if sides is None:
        return Across(tip_x=None, pitch=None, hole_x=hole_x)
    left, right, tilt, _ = sides
    yaw = hand_yaw - math.pi / 2
    edges = outermost(camera, left, right, task.peg, yaw)
    y, z, width = between(camera, left, right, tilt, edges)
    tip = y - (beside.tip_z.value - z) * math.tan(tilt)
    return Across(
        tip_x=Measured(value=-tip, sd=_PLACE_SD),
        pitch=Measured(value=tilt, sd=_TILT_SD),
        hole_x=hole_x,
        wider=wider_than(task.peg, width, edges, camera, nearer=beside.tip_y.value),
    )


def at_distance(scene: Scene, across: Across, camera: Camera, peg: Peg, hand_yaw: float) -> Scene:
    """A scene measured as if peg and board were at the plane of insertion, with both as far from
    the side camera as the front one shows them: what is nearer looks larger, and the top edge of a
    peg that leans towards the camera is its lower one."""
    eye_x, eye_y, eye_z = (float(value) for value in camera.position)
    seen, hole = scene.peg, scene.hole
    if seen is not None and across.tip_x is not None and across.pitch is not None:
        pitch, tilt, near = across.pitch.value, seen.tilt.value, peg.front(0.0, hand_yaw)
        upright = peg.length * math.cos(tilt)
        tip_x = across.tip_x.value
        top_x = tip_x + upright * math.tan(pitch)
        top_z = seen.tip_z.value + upright
        nearer = eye_z + (top_z - eye_z) * (1 - top_x / (eye_x - near)) + near * math.sin(pitch)
        z = nearer - upright * math.cos(pitch) - seen.tip_z.value
        y = (eye_y - seen.tip_y.value) * tip_x / (eye_x - peg.silhouette_x)
        seen = replace(
            seen,
            tip_y=seen.tip_y.plus(y),
            tip_z=seen.tip_z.plus(z),
            left_y=seen.left_y + y,
            left_z=seen.left_z + z,
            right_y=seen.right_y + y,
            right_z=seen.right_z + z,
        )
    if hole is not None and across.hole_x is not None:
        share = across.hole_x.value / (eye_x - FRONT_X)
        hole = replace(
            hole,
            y=hole.y.plus((eye_y - hole.y.value) * share),
            surface_z=hole.surface_z.plus((eye_z - hole.surface_z.value) * share),
        )
    return replace(scene, peg=seen, hole=hole)


def quarter_turned(camera: Camera) -> Camera:
    return replace(camera, position=_QUARTER @ camera.position, rotation=_QUARTER @ camera.rotation)


def _board_yaw(view: View, colours: Colours, y: float, surface: float) -> Measured | None:
    """The block's angle about z, by fitting its silhouette to the outline of its region."""
    contour = largest_contour(hsv_of(view.image), colours.block)
    if contour is None:
        return None
    points = contour[::_CONTOUR_STEP]

    def distances(at: NDArray[np.float64]) -> NDArray[np.float64]:
        corners = corners_px(view.camera, at[0], y + at[1], surface, at[2])
        outline = cv2.convexHull(corners.astype(np.float32))
        return np.array(
            [cv2.pointPolygonTest(outline, (float(u), float(v)), True) for u, v in points]
        )

    at = minimise(
        distances,
        [Unknown(start=0.0, step=1e-4)] * 3,
        sds=np.ones(len(points)),
        robust=_ROBUST_PX,
    )
    fits = np.abs(distances(at)) < _ROBUST_PX[-1]
    if abs(at[2]) > _MOST_YAW or np.mean(fits) < 0.5:
        return None
    return Measured(value=float(at[2]), sd=_YAW_SD)
