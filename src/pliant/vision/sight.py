"""Sights, which turn the pictures of one moment into a Scene: by colour, as the paper does, or by
shape, whatever the colours.

A segmentation of the user's own takes the same place: anything that is called like these, once per
look.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from statistics import fmean
from typing import Protocol

from pliant.cell import Observation, View
from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.edges import NOMINAL, Aside
from pliant.vision.fused import measure_fused
from pliant.vision.measure import SIMULATED, Colours
from pliant.vision.offset import UNKNOWN, Offset, hanging_tip, offset_between
from pliant.vision.outline import board_outline
from pliant.vision.scene import Across, Scene
from pliant.vision.surround import FRONT, OBLIQUE, SIDE, at_distance, quarter_turned, see

_FREE_M = 0.012  # a tip this far above the board hangs freely
_FARTHER, _LEANING = 0.003, 0.01  # [m], and of an axis by its length: what the other camera saw
_CALIBRATIONS = 2  # looks, half a swing apart, that calibrate a camera


class Sight(Protocol):
    """Measures the pictures of one moment; the arm's measured pose and the wrist's compression
    belong to it."""

    @property
    def colours(self) -> Colours | None:
        """The colours that it tells peg and block by; None: by something else, and they may be
        anything."""
        ...

    def __call__(self, observation: Observation) -> Scene: ...


class ByColour:
    """The paper's segmentation by colour, from up to three cameras."""

    def __init__(self, task: Task, colours: Colours = SIMULATED) -> None:
        self._task, self.colours = task, colours
        self._board_yaw = 0.0  # last seen
        self._across: Across | None = None

    def __call__(self, observation: Observation) -> Scene:
        views, pose = observation.views, observation.pose
        scene = see(views, self._task, self.colours, board_yaw=self._board_yaw, hand_yaw=pose.yaw)
        if scene.board_yaw is not None:
            self._board_yaw = scene.board_yaw.value
        if scene.across is not None:
            self._across = scene.across
        if self._across is None:
            return scene
        return at_distance(scene, self._across, views[SIDE].camera, self._task.peg, pose.yaw)


class Measure(Protocol):
    """Measures one picture from +x by the known shapes of peg and block (`measure_edges`,
    `measure_learned`, `measure_fused`)."""

    def __call__(
        self,
        view: View,
        task: Task,
        pose: Pose,
        *,
        aside: Aside = ...,
        offset: Offset = ...,
        pressed: float | None = ...,
    ) -> Scene: ...


class ByShape:
    """Known shapes, whatever the colours, each picture measured by `measure`; one for each trial.

    Each camera is calibrated by the first looks at the freely hanging peg, whose tip the arm knows:
    there the tool takes on `hang_share` of the hand's angle, and the wrist is stretched by `sag_m`
    [m]. The block's outline in the oblique picture shows how the board is turned.
    """

    colours = None

    def __init__(
        self,
        task: Task,
        *,
        hang_share: float,
        sag_m: float,
        calibrates: bool = True,
        measure: Measure = measure_fused,
    ) -> None:
        self._measure_one = measure
        self._task, self._hang_share, self._sag_m = task, hang_share, sag_m
        self._calibrations = _CALIBRATIONS if calibrates else 0
        self._offsets: dict[str, list[Offset]] = {SIDE: [], FRONT: []}
        self._board_yaw = 0.0  # last seen
        self._from = {SIDE: NOMINAL, FRONT: NOMINAL}
        self._pressed = -sag_m  # [m] now, from the unloaded spring

    def __call__(self, observation: Observation) -> Scene:
        views, pose = observation.views, observation.pose
        self._pressed = observation.compression_m - self._sag_m
        board = board_outline(views[OBLIQUE]) if OBLIQUE in views else None
        if board is not None:
            self._board_yaw = board.yaw.value
        if FRONT in views and not self._offsets[FRONT]:
            if board is not None:
                self._from = {SIDE: Aside(board_x=board.x), FRONT: Aside(board_x=board.y)}
            self._measure(views, pose)  # for what each camera shows of the other's depth
            self._offsets = {SIDE: [], FRONT: []}
        return replace(self._measure(views, pose), board_yaw=None if board is None else board.yaw)

    def _measure(self, views: Mapping[str, View], pose: Pose) -> Scene:
        scene = self._measured(SIDE, views[SIDE], pose)
        self._from[FRONT] = self._past(scene, self._from[FRONT], 1.0)
        if FRONT not in views:
            return scene
        beside = Pose(
            x=pose.y,
            y=-pose.x,
            z=pose.z,
            roll=pose.pitch,
            pitch=-pose.roll,
            yaw=pose.yaw - math.pi / 2,
        )
        view = replace(views[FRONT], camera=quarter_turned(views[FRONT].camera))
        seen = self._measured(FRONT, view, beside)
        before = self._from[SIDE]
        self._from[SIDE] = self._past(seen, before, -1.0)
        if _differ(before, self._from[SIDE]):
            scene = self._measured(SIDE, views[SIDE], pose)
        across = Across(
            tip_x=None if seen.peg is None else -seen.peg.tip_y,
            pitch=None if seen.peg is None else seen.peg.tilt,
            hole_x=None if seen.hole is None else -seen.hole.y,
        )
        doubts = (*scene.doubts, *(f"front camera: {d}" for d in seen.doubts if not _of_height(d)))
        return replace(scene, across=across, doubts=doubts)

    def _past(self, seen: Scene, before: Aside, sign: float) -> Aside:
        """The facts about one camera's view that the other camera shows: how near things are to
        it."""
        aside = replace(before, board_yaw=self._board_yaw)
        if seen.hole is not None:
            aside = replace(aside, board_x=sign * seen.hole.y.value)
        if seen.peg is not None:
            lean = -sign * math.tan(seen.peg.tilt.value)
            aside = replace(aside, tip_x=sign * seen.peg.tip_y.value, lean=lean)
        return aside

    def _measured(self, camera: str, view: View, pose: Pose) -> Scene:
        known, task = self._offsets[camera], self._task
        aside = replace(self._from[camera], board_yaw=self._board_yaw)

        def measured(offset: Offset) -> Scene:
            return self._measure_one(
                view, task, pose, aside=aside, offset=offset, pressed=self._pressed
            )

        scene = measured(_mean(known))
        free = pose.z - task.tip_below_hinge - self._sag_m > _FREE_M
        if len(known) < self._calibrations and free and scene.peg is not None:
            raw = measured(UNKNOWN) if known else scene
            if raw.peg is not None:
                tip = hanging_tip(
                    task, pose, raw.peg.tilt, hang_share=self._hang_share, sag_m=self._sag_m
                )
                known.append(offset_between(tip, raw.peg))
            scene = measured(_mean(known))
        return scene


def _differ(one: Aside, other: Aside) -> bool:
    """Whether two differ by enough to measure again."""
    if one.tip_x is None or other.tip_x is None:
        return one.tip_x is not other.tip_x
    return abs(one.tip_x - other.tip_x) > _FARTHER or abs(one.lean - other.lean) > _LEANING


def _mean(offsets: list[Offset]) -> Offset:
    if not offsets:
        return UNKNOWN
    return Offset(
        y=replace(offsets[-1].y, value=fmean(o.y.value for o in offsets)),
        z=replace(offsets[-1].z, value=fmean(o.z.value for o in offsets)),
    )


def _of_height(doubt: str) -> bool:
    """Whether a doubt is of heights alone, of which the front camera tells nothing that is used."""
    return " y " not in doubt and "tilt" not in doubt
