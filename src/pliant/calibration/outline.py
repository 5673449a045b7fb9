"""The peg and the block in the task frame, and the outline that a camera sees of them.

The arm knows the hinge point; the peg hangs from it on soft springs. Gravity stretches the wrist
along the flange's axis and turns the tool towards the vertical; where the peg sits in the grasp is
not known either. `Hang` holds what a calibration has to find out about all that.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera
from pliant.pose import Pose
from pliant.task import BLOCK_SIZE, Peg, Task

Points = NDArray[np.float64]  # (n, 3) [m] or (n, 2) [px]
_ROUND = 96  # vertices of a disc: 0.01 mm off a circle of 20 mm


@dataclass(frozen=True, kw_only=True)
class Hang:
    """The state of the peg as it hangs below the hinge point: the wrist's sag and droop, and the
    peg's place in the grasp."""

    reach: float = 0.0  # [m] of the peg's tip beyond the task's nominal one
    sag: float = 0.0  # [m] of the wrist along its axis under the tool's weight
    droop: float = 0.0  # the weight's moment over the hinge's stiffness: 0 does not turn
    grasp_roll: float = 0.0  # [rad] of the peg in the grasp
    grasp_pitch: float = 0.0


def peg_points(task: Task, pose: Pose, hang: Hang) -> Points:
    """The corners (n, 3) [m] of the peg, with the hinge point at `pose`."""
    flange = pose.rotation()
    hung = _turned(flange, hang.droop)
    above = task.grasp_below_hinge
    # The spring gives along the flange's axis, by the share of the weight along it.
    hinge = pose.position() - flange[:, 2] * hang.sag * flange[2, 2]
    grasp = hinge - hung[:, 2] * above
    peg = hung @ cv2.Rodrigues(np.array([hang.grasp_roll, hang.grasp_pitch, 0.0]))[0]
    bottom = task.tip_below_grasp + hang.reach
    across = _cross_section(task.peg)
    heights = (-bottom, task.peg.length - bottom)
    ends = [np.column_stack([across, np.full(len(across), z)]) for z in heights]
    return grasp + np.vstack(ends) @ peg.T


def block_points(y: float) -> Points:
    """The corners (8, 3) [m] of the block, its top at z = 0 and its middle at `y` [m]."""
    half_x, half_y = BLOCK_SIZE[0] / 2, BLOCK_SIZE[1] / 2
    return np.array(
        [
            (sx * half_x, y + sy * half_y, z)
            for z in (0.0, -BLOCK_SIZE[2])
            for sx in (-1, 1)
            for sy in (-1, 1)
        ]
    )


def project(camera: Camera, points: Points) -> Points:
    """Pixels (n, 2) of points (n, 3) [m]."""
    right, down, forward = ((points - camera.position) @ camera.rotation).T
    scale = camera.focal_px / forward
    return np.column_stack([camera.width / 2 + right * scale, camera.height / 2 + down * scale])


def outside(points: Points, corners: Points) -> NDArray[np.float64]:
    """The distance [px] by which `points` (n, 2) lie outside the convex hull of `corners` (m, 2);
    inside it is below 0."""
    hull = cv2.convexHull(corners.astype(np.float32)).reshape(-1, 2).astype(np.float64)
    edge = np.roll(hull, -1, axis=0) - hull
    length = np.linalg.norm(edge, axis=1)
    hull, edge = hull[length > 1e-3], edge[length > 1e-3] / length[length > 1e-3, None]
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    if float(np.mean((hull - hull.mean(axis=0)) * normal)) < 0:
        normal = -normal
    return np.max(points @ normal.T - np.sum(hull * normal, axis=1), axis=1)


def _turned(flange: NDArray[np.float64], droop: float) -> NDArray[np.float64]:
    """The hanging tool's rotation: its axis turned towards the vertical until the hinge's spring
    holds the weight's moment."""
    up = flange[:, 2]
    lean = math.acos(max(-1.0, min(1.0, float(up[2]))))
    if lean < 1e-9:
        return flange
    left = lean
    for _ in range(20):  # Newton: left + droop sin(left) = lean
        left -= (left + droop * math.sin(left) - lean) / (1.0 + droop * math.cos(left))
    about = np.cross(up, [0.0, 0.0, 1.0])
    turn = cv2.Rodrigues(about / np.linalg.norm(about) * (lean - left))[0]
    return turn @ flange


@lru_cache(maxsize=4)
def _cross_section(peg: Peg) -> Points:
    if peg.radius is None:
        return np.array(peg.outline)
    angle = np.arange(_ROUND) * math.tau / _ROUND
    return peg.radius * np.column_stack([np.cos(angle), np.sin(angle)])
