"""Skills guided by what is seen and felt, for the levels above the paper's grid.

Each formation is a composition of short straight motions, every one through the envelope. They own
more axes than the paper's single motions: x, pitch and yaw follow the hole and the peg that the
cameras show, roll turns the peg upright. Two things that the paper does not do: the wrist's
compression is read, for guarded contact and light loads, where the paper has it as a limit only;
and pictures are taken within a skill.

Motions are commanded in the hole's frame: origin at the believed centre of the hole on the board's
surface, turned by the board's yaw. Fit travels toward its -y; the far wall is the one there.

A pressed tip is dragged by friction while the hinge moves on. What is pressed therefore does not
travel: the peg is unloaded, moved, and loaded again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pliant.belief import Belief, Seen, hang_share, in_hand, softly
from pliant.cell import Motion, Robot, Stop
from pliant.envelope import Limits
from pliant.formations import Formation, Step
from pliant.pose import Axis, Pose
from pliant.records import Look, Looking, Outcome
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.scene import Measured
from pliant.vision.surround import ALL, FRONT, SIDE

_LEAN = math.radians(10)  # of the hand, past upright: the far corner hangs lowest
_HOLD = math.radians(15)  # of the hand, the other way: the wrist's torque holds the far wall
_BEFORE_WALL = 0.005  # [m] before the far wall the low corner touches down
_ABOVE = 0.020  # [m] of the tip above the board, at Approach
_TOUCH = 0.004  # [m] of compression that is a touch
_PRESSED, _LIGHT, _UNLOADED = 0.003, 0.0012, 0.0004  # [m] of compression
_WORKED = 0.005  # [m] of compression while a stuck peg is shaken
_TRIMMED = 0.0003  # [m] a load this close is trimmed
_IN_HOLE = 0.0015  # [m] the low corner is this deep when it is in the hole
_AT_WALL = (-0.0055, 0.0015)  # [m] of the low corner from the far wall, when it touches that
_ON_HOLE = 0.003  # [m] from the far wall, where a corner that is not in the hole belongs
_ASTRAY = 0.002  # [m] from there
_UPRIGHT_DEPTH, _UPRIGHT_TILT = 0.0025, math.radians(4)
_LIFTS = 40  # short lifts and shakes out of the hole, at most
_RECENTRED = 0.004  # [m] that Insertion moves the hinge from where Align left it
_SLICE = 0.005  # [m] of one step of Insertion
_MARGIN = 0.0015  # [m] beyond the depth that is asked for
_HALF_SWING_S = 0.19  # of the tool that hangs from the soft wrist
_NEAR_ENOUGH = 0.001  # [m] of the tip, before it goes down
_TURNED_ENOUGH = math.radians(0.5)


@dataclass(frozen=True, kw_only=True)
class Guided:
    """How the guided skills move: speeds [m/s], limit [m], waits [s]."""

    task: Task
    teaching: Teaching
    limits: Limits = field(default_factory=Limits)
    free_speed_m_s: float = 0.05
    contact_speed_m_s: float = 0.02
    guarded_speed_m_s: float = 0.03
    compression_limit_m: float = 0.020  # from free hang
    swing_s: float = 0.8  # until a free-hanging peg is at rest
    rest_s: float = 0.3

    def __call__(
        self, robot: Robot, look: Looking, target: Pose, step: Step, belief: Belief
    ) -> Outcome:
        """Execute a step. What a recovery changed in its goal shifts where the skill aims; a
        compression stop ends it at once."""
        taught = self.teaching.goals.formations[step.formation]
        shift = {axis: value - taught[axis] for axis, value in step.goal.items() if axis in taught}
        hand = _Hand(self, robot, look, step.formation, belief)
        try:
            if step.retreat:
                hand.lift(hand.frame.z + self.task.tip_below_hinge + _ABOVE + 0.01)
                self._approach(hand, shift.get(Axis.Y, 0.0))
                self._contact(hand)
            match step.formation:
                case Formation.APPROACH:
                    hand.to(target, self.free_speed_m_s)
                    self._approach(hand, 0.0)
                case Formation.CONTACT:
                    self._contact(hand)
                case Formation.FIT:
                    self._fit(hand)
                case Formation.ALIGN:
                    self._align(hand, shift.get(Axis.Y, 0.0))
                case Formation.INSERTION:
                    self._insert(hand, -min(0.0, shift.get(Axis.Z, 0.0)))
        except _Stopped:
            robot.settle(self.rest_s)
        hand.see((SIDE, FRONT))
        return Outcome(
            step=step, target=hand.at, motions=tuple(hand.motions), looks=tuple(hand.looks)
        )

    # --- the formations --------------------------------------------------------------------------

    def _approach(self, hand: "_Hand", shift: float) -> None:
        """Hang leaning above the hole, the low corner over its far wall, as the cameras show it."""
        robot, share = hand.robot, hang_share(self.teaching)
        for attempt in range(5):
            robot.settle(self.swing_s)
            tip = hand.hanging_tip(ALL if attempt == 0 else (SIDE, FRONT))
            if tip is None:
                return
            goal, off = self._above_hole(hand, tip, shift)
            turned = max(
                abs(goal.roll - hand.at.roll),
                abs(goal.pitch - hand.at.pitch),
                abs(goal.yaw - hand.at.yaw),
            )
            if off < _NEAR_ENOUGH and turned * share < _TURNED_ENOUGH:
                return
            hand.to(goal, self.free_speed_m_s)

    def _above_hole(
        self, hand: "_Hand", tip: tuple[float, float, float], shift: float
    ) -> tuple[Pose, float]:
        """Where the hinge must be for the tip to hang where it should, and how far off that is."""
        frame, belief = hand.frame, hand.belief
        lean = hang_share(self.teaching) * _LEAN  # about; what it is will be seen
        half = self.task.peg.half_extents[1]
        wall = half + self.task.hole.clearance / 2
        aim = np.array(
            [
                0.0,
                -wall + _BEFORE_WALL + shift + half * math.cos(lean),
                _ABOVE + half * math.sin(lean),
            ]
        )
        error = frame.point(aim) - np.array(tip)
        roll = belief.upright_roll.value + _LEAN if belief.upright_roll else hand.at.roll
        pitch = belief.upright_pitch.value if belief.upright_pitch else hand.at.pitch
        turned = self.limits.within(replace(hand.at, roll=roll, pitch=pitch))
        roll, pitch = turned.roll, turned.pitch
        # What turning the hand will move the tip by is left out beforehand.
        lever = self.task.tip_below_hinge * hang_share(self.teaching)
        ahead, aside = lever * (roll - hand.at.roll), lever * (pitch - hand.at.pitch)
        cos, sin = math.cos(frame.yaw), math.sin(frame.yaw)
        error[:2] += (cos * aside + sin * ahead, sin * aside - cos * ahead)
        x, y, z = (float(v) for v in hand.at.position() + error)
        goal = Pose(x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=frame.yaw)
        return goal, math.dist(frame.point(aim)[:2], tip[:2])

    def _contact(self, hand: "_Hand") -> None:
        """Down until the wrist gives way, then a steady load, both counted from free hang with the
        hand turned as it is now: gravity pulls less along a leaning wrist."""
        hand.robot.tare()
        hand.down(2 * _ABOVE + 0.02, _TOUCH)
        hand.load(_PRESSED)

    def _fit(self, hand: "_Hand") -> None:
        """The low corner to the far wall of the hole."""
        for attempt in range(10):
            corner = hand.corner((SIDE,) if attempt == 0 else (SIDE, FRONT))
            if corner is None:
                return
            at_wall = _AT_WALL[0] < corner.y < _AT_WALL[1]
            inside = corner.depth > _IN_HOLE
            if inside and (at_wall or corner.trailing_depth > 0.0):
                return
            hand.load(_UNLOADED)
            beside = corner.y - _ON_HOLE
            if inside:
                hand.shift(y=-max(0.003, min(0.010, corner.y + 0.003)))
            elif abs(beside) > _ASTRAY or abs(corner.x) > _ASTRAY:
                hand.shift(x=-_bounded(corner.x, 0.010), y=-_bounded(beside, 0.010))
            else:
                self._search(hand, attempt)
            hand.load(_PRESSED)

    def _search(self, hand: "_Hand", attempt: int) -> None:
        """Over the hole but not in it: across by a little more each time, with a turn of the
        hand."""
        reach = 0.0008 * (1 + attempt // 2) * (1 if attempt % 2 == 0 else -1)
        hand.load(_LIGHT)
        hand.shift(x=reach)
        hand.dither(math.radians(2.5))
        hand.shift(x=-reach)

    def _align(self, hand: "_Hand", shift: float) -> None:
        """Turn the peg upright under a light load, its tip held at the far wall."""
        belief = hand.belief
        upright = belief.upright_roll.value if belief.upright_roll else 0.0
        over = self._hinge_over_hole(hand) + shift
        here = hand.frame.inside(hand.at)
        hand.load(_LIGHT)
        parts = 5
        for k in range(1, parts + 1):
            part = k / parts
            y = here.y + part * (over - here.y)
            roll = here.roll + part * (upright - _HOLD - here.roll)
            hand.inside(y=y, roll=roll)
            hand.load(_LIGHT)
            hand.dither(math.radians(2.5))
        for attempt in range(4):
            seen = hand.tip()
            if seen is None:
                return
            depth, tilt = seen
            if depth > _UPRIGHT_DEPTH and abs(tilt.value) < _UPRIGHT_TILT:
                break
            if attempt == 3:
                break
            hand.load(0.002 + 0.001 * attempt)
            for sweep in (-0.004, 0.003, 0.0):
                hand.inside(y=over + sweep)
                hand.dither(math.radians(3.0))
            hand.load(_LIGHT)
        hand.inside(roll=upright)
        hand.dither(math.radians(2.5))

    def _hinge_over_hole(self, hand: "_Hand") -> float:
        """y of the hinge for an upright peg in the hole [m], in the hole's frame."""
        angle = hand.belief.grasp_roll.value if hand.belief.grasp_roll else 0.0
        return self.task.grasp_below_hinge * math.sin(angle)

    def _insert(self, hand: "_Hand", deeper: float) -> None:
        """Down in short steps, straightened after each by what the picture shows; where there is
        no progress, back off and shake."""
        deepest = self.task.depth + _MARGIN + deeper
        over = self._hinge_over_hole(hand)
        before, stuck = -math.inf, 0
        for _ in range(40):
            seen = hand.tip()
            if seen is None:
                return
            depth, tilt = seen
            if depth >= deepest:
                return
            if depth - before < 0.3 * _SLICE:
                stuck += 1
                if stuck > 6:
                    return
                hand.load(_WORKED)
                hand.shake(stuck)
                hand.load(_WORKED)
                continue
            stuck = 0
            before = depth
            if abs(tilt.value) > 2 * tilt.sd:
                lean = self.task.tip_below_hinge * math.sin(tilt.value)
                here = hand.frame.inside(hand.at).y
                straight = _bounded(lean, 0.004)
                hand.inside(y=max(over - _RECENTRED, min(over + _RECENTRED, here + straight)))
            hand.shift(z=-min(_SLICE, deepest - depth + 0.001))


class _Stopped(Exception):
    """The compression limit ended a motion."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """The hole's frame in the task frame: its origin [m] and its yaw [rad]."""

    x: float
    y: float
    z: float
    yaw: float

    def point(self, inside: np.ndarray) -> np.ndarray:  # (3,) [m]
        """A point in the hole's frame, in the task frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        a, b, c = inside
        return np.array([self.x + cos * a - sin * b, self.y + sin * a + cos * b, self.z + c])

    def inside(self, pose: Pose) -> Pose:
        """A pose of the task frame, in the hole's."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        a, b = pose.x - self.x, pose.y - self.y
        return replace(
            pose,
            x=cos * a + sin * b,
            y=cos * b - sin * a,
            z=pose.z - self.z,
            yaw=pose.yaw - self.yaw,
        )

    def outside(self, pose: Pose) -> Pose:
        """The inverse of `inside`."""
        x, y, z = (float(v) for v in self.point(np.array([pose.x, pose.y, pose.z])))
        return replace(pose, x=x, y=y, z=z, yaw=pose.yaw + self.yaw)


@dataclass(frozen=True, kw_only=True)
class _Peg:
    tip: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class _Corner:
    """The low corner in the hole's frame [m]: x of the peg's axis (0 where it was not looked for),
    y from the far wall, its depth, and the trailing corner's."""

    x: float
    y: float
    depth: float
    trailing_depth: float


def _bounded(value: float, most: float) -> float:
    return max(-most, min(most, value))


class _Hand:
    """The robot during one execution: where it was sent, what it did, saw, and now believes."""

    def __init__(
        self, skill: Guided, robot: Robot, look: Looking, formation: Formation, belief: Belief
    ) -> None:
        self.robot, self.belief = robot, belief
        self.motions: list[Motion] = []
        self.looks: list[Look] = []
        self.at = robot.observe(cameras=()).pose
        self._skill, self._look, self._formation = skill, look, formation

    # --- motion ----------------------------------------------------------------------------------

    def to(self, pose: Pose, speed: float) -> None:
        """A straight motion [task frame]."""
        self._move(pose, speed, self._skill.compression_limit_m)

    def shift(self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        """By so much [m] along the hole's axes."""
        here = self.frame.inside(self.at)
        there = replace(here, x=here.x + x, y=here.y + y, z=here.z + z)
        self.to(self.frame.outside(there), self._skill.contact_speed_m_s)

    def inside(self, **axes: float) -> None:
        """To these values of the hole's frame [m, rad]; the others stay."""
        there = replace(self.frame.inside(self.at), **axes)
        self.to(self.frame.outside(there), self._skill.contact_speed_m_s)

    def dither(self, angle: float) -> None:
        """Turn the hand about z by so much to either side [rad], and back."""
        here = self.at
        for yaw in (here.yaw + angle, here.yaw - angle, here.yaw):
            self.to(replace(here, yaw=yaw), self._skill.free_speed_m_s)

    def lift(self, clear: float) -> None:
        """Straight up to the height `clear` [m], out of the hole; a peg that holds on is shaken."""
        for attempt in range(_LIFTS):
            if self.at.z >= clear:
                return
            if self.compression() < -_WORKED:
                self.shake(1 + attempt % 5)
            else:
                up = replace(self.at, z=min(clear, self.at.z + 2 * _SLICE))
                self.to(up, self._skill.free_speed_m_s)

    def shake(self, times: int) -> None:
        """Turn and shift the hand, further each time: friction then acts sideways."""
        self.dither(math.radians(2.0 + times))
        here = self.frame.inside(self.at)
        turn, size = math.radians(1.0 + times), 0.0005 * times
        for side in (1, -1):
            self.inside(roll=here.roll + side * turn, y=here.y + side * size)
            self.inside(pitch=here.pitch + side * turn / 2, x=here.x + side * size)
        self.inside(roll=here.roll, pitch=here.pitch, x=here.x, y=here.y)
        self.dither(math.radians(2.0 + times))

    def down(self, most: float, touch: float) -> None:
        """Down by at most `most` [m], ended by `touch` [m] of compression."""
        goal = replace(self.at, z=self.at.z - most)
        self._move(goal, self._skill.guarded_speed_m_s, touch)

    def load(self, compression: float) -> None:
        """Up or down until the wrist is pressed by about so much [m]."""
        for _ in range(4):
            error = compression - self.compression()
            if abs(error) < _TRIMMED:
                return
            z = self.at.z - _bounded(error, 0.008)
            self.to(replace(self.at, z=z), self._skill.contact_speed_m_s)
            self.robot.settle(0.1)

    def _move(self, pose: Pose, speed: float, limit: float) -> None:
        pose = self._skill.limits.within(pose)
        motion = self.robot.move_to(pose, speed_m_s=speed, stop_at_compression_m=limit)
        guarded = limit < self._skill.compression_limit_m
        if motion.stop is Stop.COMPRESSION and guarded:
            motion = replace(motion, stop=Stop.TOUCH)
        self.motions.append(motion)
        self.at = motion.ended if motion.stop.is_early else pose
        if motion.stop is Stop.COMPRESSION:
            raise _Stopped

    # --- senses ----------------------------------------------------------------------------------

    def compression(self) -> float:
        """Of the wrist, from free hang [m]."""
        return self.robot.observe(cameras=()).compression_m

    def see(self, cameras: Sequence[str]) -> _Peg | None:
        """Look; the tip of the peg [m], or None if the peg or the hole is not seen."""
        look = self._look(cameras)
        self.looks.append(look)
        self.belief = softly(self.belief, self._seen(look), self._skill.teaching)
        peg = look.scene.peg
        if peg is None or self.belief.hole_y is None:
            return None
        across = look.scene.across
        x = across.tip_x.value if across is not None and across.tip_x is not None else self.frame.x
        return _Peg(tip=(x, peg.tip_y.value, peg.tip_z.value))

    def _seen(self, look: Look) -> Seen:
        return Seen(formation=self._formation, pose=look.observation.pose, scene=look.scene)

    def hanging_tip(self, cameras: Sequence[str]) -> tuple[float, float, float] | None:
        """The tip of the hanging peg [m], from two looks half a swing apart, whose mean is where it
        will come to rest."""
        one = self.see(cameras)
        self.robot.settle(_HALF_SWING_S)
        other = self.see((SIDE, FRONT))
        if one is None or other is None:
            return None
        x, y, z = ((a + b) / 2 for a, b in zip(one.tip, other.tip, strict=True))
        return x, y, z

    def corner(self, cameras: Sequence[str]) -> "_Corner | None":
        """Where the low corner of the peg is in the hole's frame."""
        self.robot.settle(self._skill.rest_s)
        seen = self.see(cameras)
        if seen is None:
            return None
        peg = self.looks[-1].scene.peg
        assert peg is not None
        task, frame = self._skill.task, self.frame
        cos, sin = math.cos(frame.yaw), math.sin(frame.yaw)
        x, y = seen.tip[0] - frame.x, seen.tip[1] - frame.y
        half = peg.tip_y.value - peg.left_y
        wall = task.peg.half_extents[1] + task.hole.clearance / 2
        return _Corner(
            x=cos * x + sin * y if FRONT in cameras else 0.0,
            y=y / cos - half + wall if FRONT not in cameras else cos * y - sin * x - half + wall,
            depth=frame.z - peg.left_z,
            trailing_depth=frame.z - peg.right_z,
        )

    def tip(self) -> tuple[float, Measured] | None:
        """The tip's depth [m] and the peg's tilt [rad] about the hand's axis."""
        self.robot.settle(self._skill.rest_s)
        peg = self.see((SIDE,))
        if peg is None:
            return None
        return self.frame.z - peg.tip[2], in_hand(self._seen(self.looks[-1]))[0]

    @property
    def frame(self) -> Frame:
        """Where the hole is believed to be."""
        belief = self.belief
        x, y, z, yaw = (
            m.value if m is not None else 0.0
            for m in (belief.hole_x, belief.hole_y, belief.surface_z, belief.board_yaw)
        )
        return Frame(x=x, y=y, z=z, yaw=yaw)
