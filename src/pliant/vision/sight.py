"""What turns the pictures of one moment into a Scene: by colour, as the paper does, or by edges.

A learned segmentation takes the same place: anything that is called like these, once per look.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from statistics import fmean
from typing import Protocol

from pliant.cell import View
from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.edges import measure_edges
from pliant.vision.measure import SIMULATED, Colours
from pliant.vision.offset import UNKNOWN, Offset, hanging_tip, offset_between
from pliant.vision.scene import Across, Measured, Scene
from pliant.vision.surround import FRONT, SIDE, quarter_turned, see

_FREE_M = 0.012  # a tip this far above the board hangs freely
_CALIBRATIONS = 2  # looks, half a swing apart, that calibrate a camera


class Sight(Protocol):
    """Measures the pictures of one moment, taken at the arm's measured pose."""

    def __call__(self, views: Mapping[str, View], pose: Pose) -> Scene: ...


class ByColour:
    """The paper's segmentation by colour, from up to three cameras."""

    def __init__(self, task: Task, colours: Colours = SIMULATED) -> None:
        self._task, self._colours = task, colours
        self._board_yaw = 0.0  # last seen

    def __call__(self, views: Mapping[str, View], pose: Pose) -> Scene:
        scene = see(views, self._task, self._colours, board_yaw=self._board_yaw, hand_yaw=pose.yaw)
        if scene.board_yaw is not None:
            self._board_yaw = scene.board_yaw.value
        return scene


class ByEdges:
    """Edges of known geometry, whatever the colours; one for each trial.

    Each camera is calibrated by the first looks at the freely hanging peg, whose tip the arm knows:
    there the tool takes on `hang_share` of the hand's angle, and the wrist is stretched by `sag_m`
    [m]. The board's yaw is not measured.
    """

    def __init__(self, task: Task, *, hang_share: float, sag_m: float) -> None:
        self._task, self._hang_share, self._sag_m = task, hang_share, sag_m
        self._offsets: dict[str, list[Offset]] = {SIDE: [], FRONT: []}

    def __call__(self, views: Mapping[str, View], pose: Pose) -> Scene:
        scene = self._measured(SIDE, views[SIDE], pose)
        if FRONT not in views:
            return scene
        view = replace(views[FRONT], camera=quarter_turned(views[FRONT].camera))
        turned = Pose(
            x=pose.y,
            y=-pose.x,
            z=pose.z,
            roll=pose.pitch,
            pitch=-pose.roll,
            yaw=pose.yaw - math.pi / 2,
        )
        seen = self._measured(FRONT, view, turned)
        across = Across(
            tip_x=None if seen.peg is None else _mirrored(seen.peg.tip_y),
            pitch=None if seen.peg is None else seen.peg.tilt,
            hole_x=None if seen.hole is None else _mirrored(seen.hole.y),
        )
        return replace(scene, across=across)

    def _measured(self, camera: str, view: View, pose: Pose) -> Scene:
        known, task = self._offsets[camera], self._task
        scene = measure_edges(view, task, pose, offset=_mean(known))
        free = pose.z - task.tip_below_hinge - self._sag_m > _FREE_M
        if len(known) < _CALIBRATIONS and free and scene.peg is not None:
            raw = measure_edges(view, task, pose)
            if raw.peg is not None:
                tip = hanging_tip(
                    task, pose, raw.peg.tilt, hang_share=self._hang_share, sag_m=self._sag_m
                )
                known.append(offset_between(tip, raw.peg))
            scene = measure_edges(view, task, pose, offset=_mean(known))
        return scene


def _mean(offsets: list[Offset]) -> Offset:
    if not offsets:
        return UNKNOWN
    return Offset(
        y=replace(offsets[-1].y, value=fmean(o.y.value for o in offsets)),
        z=replace(offsets[-1].z, value=fmean(o.z.value for o in offsets)),
    )


def _mirrored(measured: Measured) -> Measured:
    return replace(measured, value=-measured.value)
