"""The peg by touch: where a picture shows nothing at all, the arm, the wrist's compression and how
the peg was seen to hang before tell where its tip must be."""

import math
from dataclasses import replace

import numpy as np

from pliant.belief import Belief, hang_share
from pliant.cell import Observation
from pliant.pose import Pose, rotation_matrix
from pliant.records import Look
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.scene import Across, HoleSeen, Measured, PegSeen, Scene, peg_at

_TILT_SD, _TIP_SD, _HEIGHT_SD = math.radians(1.0), 0.001, 0.0005  # [rad, m, m]
SLIDES_M = 0.005
"""How far [m] a peg may have slid up in the grasp unseen: so much deeper it must be by touch."""

_NO_PIXEL = (math.nan, math.nan)
_NO_BOX = (_NO_PIXEL,) * 4


def shows_nothing(scene: Scene) -> bool:
    """Whether a picture shows neither peg nor board, as that of a covered lens."""
    return scene.peg is None and scene.hole is None


def hangs(pose: Pose, tip: np.ndarray, tilt: float, pitch: float) -> tuple[float, float, float]:
    """The tip (3,) [m] of a peg that hangs freely with this tilt and pitch [rad] about the hand's
    axes, from the hinge, in axes that turn with the peg."""
    x, y, z = rotation_matrix(tilt, pitch, pose.yaw).T @ (tip - pose.position())
    return float(x), float(y), float(z)


def placed(task: Task, teaching: Teaching, look: Look, belief: Belief) -> Scene:
    """What a look shows, with the hole where it is believed to be; where its pictures show nothing,
    the peg is where touch says. Nothing of that has pixels."""
    scene = look.scene
    if belief.hole_y is None or belief.surface_z is None:
        return scene
    if shows_nothing(scene) and belief.tip_in_hand is not None:
        hole = HoleSeen(
            box_px=_NO_BOX, center_px=_NO_PIXEL, y=belief.hole_y, surface_z=belief.surface_z
        )
        peg, tip_x = _peg(task, teaching, look.observation, belief)
        across = Across(tip_x=tip_x, pitch=None, hole_x=belief.hole_x)
        return replace(scene, peg=peg, hole=hole, across=across)
    if scene.hole is None:
        return scene
    hole = replace(scene.hole, y=belief.hole_y, surface_z=belief.surface_z)
    return replace(scene, hole=hole)


def _peg(
    task: Task, teaching: Teaching, observation: Observation, belief: Belief
) -> tuple[PegSeen, Measured]:
    """The peg below the hand, and its tip's x: it leans as it would hang, pushed up along the hand
    by the wrist's compression. How it turns in the wrist under load is not known."""
    assert belief.tip_in_hand is not None
    assert belief.upright_roll is not None
    assert belief.upright_pitch is not None
    pose, share = observation.pose, hang_share(teaching)
    lean = share * (pose.roll - belief.upright_roll.value)
    turn = rotation_matrix(lean, share * (pose.pitch - belief.upright_pitch.value), pose.yaw)
    tip = pose.position() + turn @ np.array(belief.tip_in_hand)
    tip += observation.compression_m * pose.rotation()[:, 2]
    x, y, z = (float(v) for v in tip)
    half = task.peg.half_extents[1]
    peg = peg_at(
        Measured(value=y, sd=_TIP_SD),
        Measured(value=z, sd=_HEIGHT_SD),
        Measured(value=lean, sd=_TILT_SD),
        ((-half, 0.0), (half, 0.0)),
        box_px=_NO_BOX,
        center_px=_NO_PIXEL,
        edge_px=_NO_PIXEL,
        tilt_deg=math.degrees(lean),
    )
    return peg, Measured(value=x, sd=_TIP_SD)
