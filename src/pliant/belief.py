"""What the looks so far say about the hole and the grasp: a pure fold over measurements."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from statistics import fmean, median

from pliant.envelope import Descent
from pliant.formations import Formation
from pliant.pose import Pose
from pliant.task import Task, load_task
from pliant.teaching import Teaching
from pliant.vision.offset import hanging_tip
from pliant.vision.scene import Measured, Scene

_JUMP_M = 0.003  # a reading so far from the belief is not believed until others agree
_AGREE = 3  # readings in a row that must agree with each other against the belief
MEMORY = 5  # readings that the median is taken of
_FREE_M = 0.008  # a tip this far above the board hangs freely


@dataclass(frozen=True, kw_only=True)
class Belief:
    """Estimates of what the method cannot know beforehand; None until something was seen.

    `hole_y`, `hole_x` and `surface_z` [m] are the hole's centre on the board, `board_yaw` [rad] how
    the board is turned, `grasp_roll` [rad] the peg's angle in the grasp; `upright_roll` and
    `upright_pitch` [rad] those of the hand with which the peg would hang upright. `readings` are
    the last of each, for the soft estimates.
    """

    hole_y: Measured | None = None
    grasp_roll: Measured | None = None
    hole_x: Measured | None = None
    surface_z: Measured | None = None
    board_yaw: Measured | None = None
    upright_roll: Measured | None = None
    upright_pitch: Measured | None = None
    readings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One look: during which formation, from which measured pose, and what was measured."""

    formation: Formation
    pose: Pose
    scene: Scene


def fold(
    looks: Iterable[Seen], teaching: Teaching, *, soft: bool = False, memory: int = MEMORY
) -> Belief:
    """The belief after these looks in order. `soft` is for cells whose board may move and whose
    readings may be wrong: it takes the median of `memory` of them."""
    belief = Belief()
    readings = 0
    for look in looks:
        readings += look.scene.hole is not None
        belief = (
            softly(belief, look, teaching, memory)
            if soft
            else _mean(belief, look, teaching, readings)
        )
    return belief


def _mean(belief: Belief, look: Seen, teaching: Teaching, readings: int) -> Belief:
    """The hole does not move and all its readings share one calibration, so its estimate is their
    mean. The grasp angle is read at Approach, where the peg hangs freely: its tilt less the tilt
    that the same flange angle gave when the goals were taught with an aligned peg.
    """
    scene, taught = look.scene, teaching.scenes.get(Formation.APPROACH)
    if scene.hole is not None:
        seen, before = scene.hole.y, belief.hole_y
        mean = (
            seen.value if before is None else before.value + (seen.value - before.value) / readings
        )
        belief = replace(belief, hole_y=Measured(value=mean, sd=seen.sd))
    if (
        look.formation is Formation.APPROACH
        and scene.peg is not None
        and taught is not None
        and taught.peg is not None
    ):
        tilt, before_tilt = scene.peg.tilt, taught.peg.tilt
        sd = math.hypot(tilt.sd, before_tilt.sd)
        angle = Measured(value=tilt.value - before_tilt.value, sd=sd)
        belief = replace(belief, grasp_roll=angle)
    return belief


def believed(scene: Scene, belief: Belief) -> Scene:
    """A measurement with the hole where it is believed to be."""
    if scene.hole is None or belief.hole_y is None or belief.surface_z is None:
        return scene
    hole = replace(scene.hole, y=belief.hole_y, surface_z=belief.surface_z)
    return replace(scene, hole=hole)


# --- soft evidence -------------------------------------------------------------------------------


def softly(belief: Belief, look: Seen, teaching: Teaching, memory: int = MEMORY) -> Belief:
    """The belief after one more look, of which one wrong reading must not poison it.

    The hole and the board are medians of the last readings; one that jumps is believed when others
    agree with it. Where the peg hangs freely, its angles tell how the hand must turn for it to hang
    upright.
    """
    scene = look.scene
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
    return belief


def _swung(belief: Belief, name: str, reading: float, sd: float) -> Belief:
    """The mean of the last two readings, which are taken half a swing apart."""
    kept = (*belief.readings.get(name, ()), reading)[-2:]
    readings = {**belief.readings, name: kept}
    value = Measured(value=fmean(kept), sd=sd)
    return replace(belief, readings=readings, **{name: value})


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


def hang_share(teaching: Teaching) -> float:
    """What share of the hand's angle a freely hanging peg takes on: gravity turns the soft wrist
    back. Read off the goals, which were taught with an aligned peg."""
    shown = teaching.scenes[Formation.APPROACH].peg
    if shown is None:
        return 0.5
    return shown.tilt.value / teaching.goals.target(Formation.APPROACH).roll


def sag_m(teaching: Teaching) -> float:
    """How far the tool's weight stretches the wrist in free hang [m], read off the goals."""
    shown, seen = teaching.demonstrations[Formation.APPROACH], teaching.scenes[Formation.APPROACH]
    if seen.peg is None:
        return 0.0
    task, share = load_task(shown.peg), hang_share(teaching)
    _, z = hanging_tip(task, shown.pose, seen.peg.tilt, hang_share=share, sag_m=0.0)
    return (z.value - seen.peg.tip_z.value) / math.cos(shown.pose.roll) ** 2


def descent_of(belief: Belief, task: Task, teaching: Teaching) -> Descent:
    """How low the hand may go by what is believed of the board; nominal until it was seen."""
    surface = belief.surface_z.value if belief.surface_z is not None else 0.0
    hang = task.tip_below_hinge + sag_m(teaching)
    return Descent(surface_z=surface, hang_m=hang, depth_m=task.depth)


def _weighed(belief: Belief, name: str, reading: Measured, memory: int) -> Belief:
    jump = _JUMP_M if name != "board_yaw" else math.radians(3)
    kept = (*belief.readings.get(name, ()), reading.value)[-memory:]
    last = kept[-_AGREE:]
    agree = len(last) == _AGREE and max(last) - min(last) < jump / 2
    if agree and abs(median(last) - median(kept)) > jump / 2:
        kept = last  # it has moved
    value = Measured(value=median(kept), sd=reading.sd)
    return replace(belief, readings={**belief.readings, name: kept}, **{name: value})
