"""The belief of a guided skill: soft evidence, of which one wrong reading poisons nothing, of a
board that may move."""

import math
from dataclasses import replace
from statistics import fmean, median
from typing import Any

import numpy as np

from pliant.belief import JUMP_M, Belief, Seen, hang_share
from pliant.formations import Formation
from pliant.methods.guided.touch import hangs
from pliant.pose import Axis
from pliant.teaching import Teaching
from pliant.vision.scene import Measured, PegSeen

_JUMP_RAD = math.radians(3)  # as `JUMP_M`, of the board's yaw
_AGREE = 3  # readings in a row that must agree with each other against the belief
MEMORY = 5  # readings that the median is taken of
_FREE_M = 0.008  # a tip this far above the board hangs freely


def softly(belief: Belief, look: Seen, teaching: Teaching, memory: int = MEMORY) -> Belief:
    """The belief after one more look, of which one wrong reading must not poison it.

    The hole and the board are medians of the last readings; one that jumps is believed when others
    agree with it. Where the peg hangs freely, its angles tell how the hand must turn for it to hang
    upright. From Fit on the hole is looked for where its step says, counted from where it is read.
    """
    scene, step = look.scene, look.step
    if step.formation is Formation.FIT:
        taught = teaching.goals.formations[Formation.FIT]
        belief = replace(belief, hole_shift=step.goal[Axis.Y] - taught[Axis.Y])
    new: dict[str, Measured | None] = {}
    if scene.hole is not None:
        new |= {"hole_y": scene.hole.y, "surface_z": scene.hole.surface_z}
    if scene.across is not None:
        new["hole_x"] = scene.across.hole_x
    new["board_yaw"] = scene.board_yaw
    for name, reading in new.items():
        if reading is not None:
            belief = _weighed(belief, name, reading, memory)
    free = (
        scene.peg is not None
        and belief.surface_z is not None
        and scene.peg.tip_z.value - belief.surface_z.value > _FREE_M
    )
    if free and scene.peg is not None:
        share = hang_share(teaching)
        tilt, pitch = in_hand(look)
        upright = look.pose.roll - tilt.value / share
        belief = _swung(belief, "upright_roll", upright, tilt.sd / share)
        if belief.upright_roll is not None:
            angle = Measured(value=-share * belief.upright_roll.value, sd=tilt.sd)
            belief = replace(belief, grasp_roll=angle)
        if pitch is not None:
            upright = look.pose.pitch - pitch.value / share
            belief = _swung(belief, "upright_pitch", upright, pitch.sd / share)
            belief = _hanging(belief, look, scene.peg, tilt.value, pitch.value)
    return belief


def _swung(belief: Belief, name: str, reading: float, sd: float) -> Belief:
    """The mean of the last two readings, which are taken half a swing apart."""
    kept = (*belief.readings.get(name, ()), reading)[-2:]
    readings = {**belief.readings, name: kept}
    value = Measured(value=fmean(kept), sd=sd)
    changed: dict[str, Any] = {"readings": readings, name: value}
    return replace(belief, **changed)


def _hanging(belief: Belief, look: Seen, peg: PegSeen, tilt: float, pitch: float) -> Belief:
    """Where the tip hangs in the hand: the mean of the last two readings, as `_swung`'s."""
    across = look.scene.across
    if across is None or across.tip_x is None:
        return belief
    tip = np.array([across.tip_x.value, peg.tip_y.value, peg.tip_z.value])
    readings, means = dict(belief.readings), []
    for axis, reading in zip("xyz", hangs(look.pose, tip, tilt, pitch), strict=True):
        name = f"tip_{axis}"
        readings[name] = (*readings.get(name, ()), reading)[-2:]
        means.append(fmean(readings[name]))
    x, y, z = means
    return replace(belief, readings=readings, tip_in_hand=(x, y, z))


def in_hand(look: Seen) -> tuple[Measured, Measured | None]:
    """The peg's tilt and, where the front camera saw it, its pitch [rad], about the axes of the
    hand, which is turned by its yaw from those of the cameras."""
    peg, across = look.scene.peg, look.scene.across
    assert peg is not None
    cos, sin = math.cos(look.pose.yaw), math.sin(look.pose.yaw)
    y = -math.tan(peg.tilt.value)  # of the peg's axis, where it rises by 1
    if across is None or across.pitch is None:
        return replace(peg.tilt, value=-math.atan(y / cos)), None
    x = math.tan(across.pitch.value)
    tilt = replace(peg.tilt, value=-math.atan(cos * y - sin * x))
    return tilt, replace(across.pitch, value=math.atan(cos * x + sin * y))


def _weighed(belief: Belief, name: str, reading: Measured, memory: int) -> Belief:
    jump = _JUMP_RAD if name == "board_yaw" else JUMP_M
    kept = (*belief.readings.get(name, ()), reading.value)[-memory:]
    last = kept[-_AGREE:]
    agree = len(last) == _AGREE and max(last) - min(last) < jump / 2
    if agree and abs(median(last) - median(kept)) > jump / 2:
        kept = last  # it has moved
    off = belief.hole_shift if name == "hole_y" else 0.0
    value = Measured(value=median(kept) + off, sd=reading.sd)
    changed: dict[str, Any] = {"readings": {**belief.readings, name: kept}, name: value}
    return replace(belief, **changed)
