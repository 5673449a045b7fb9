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
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pliant.belief import Belief, hang_share
from pliant.cell import Robot, Stop
from pliant.checks import half_hole
from pliant.formations import Formation, Step
from pliant.methods.guided.checks import CORNER_IN_M
from pliant.methods.guided.hand import SLICE, WORKED, Hand, Manner, Stopped, bounded
from pliant.methods.guided.touch import SLIDES_M
from pliant.pose import Axis, Partial, Pose
from pliant.records import Looking, Outcome, Probe, Probed
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.surround import ALL, FRONT, SIDE

SHIFTS = (Axis.X, Axis.PITCH, Axis.YAW)
SHIFTED: Mapping[Formation, tuple[Axis, ...]] = {
    formation: SHIFTS if formation in (Formation.FIT, Formation.ALIGN) else ()
    for formation in Formation
}
"""The axes that a step may name beside those that its formation owns: how far from what is believed
to aim [m, rad]."""

_LEAN = math.radians(10)  # of the hand, past upright: the far corner hangs lowest
_HOLD = math.radians(15)  # of the hand, the other way: the wrist's torque holds the far wall
_BEFORE_WALL = 0.005  # [m] before the far wall the low corner touches down
_NEARER = 0.002  # [m] before it, for another try by touch
_BEYOND_WALL = 0.002  # [m] beyond it the hand goes on, for a corner that friction holds back
_APART = 0.0003  # [m] across, between two drags by touch
_ABOVE = 0.020  # [m] of the tip above the board, at Approach
_STILL_S = 2.5  # until the swing has died down
_HIGHER = 0.030  # [m] up, where nothing is seen from there
_PULL = 0.003  # [m] up, to feel whether a peg is held
_BELOW = 0.008  # [m] below the board's surface, where a probe that feels nothing ends
_TOUCH = 0.004  # [m] of compression that is a touch
_PRESSED, _LIGHT, _UNLOADED = 0.003, 0.0012, 0.0004  # [m] of compression
_HOP = 0.002  # [m] up, to travel further than friction lets go
_AT_WALL = (-0.0055, 0.0015)  # [m] of the low corner from the far wall, when it touches that
_ON_HOLE = 0.003  # [m] from the far wall, where a corner that is not in the hole belongs
_ASTRAY = 0.002  # [m] from there
_ASIDE = 0.0006  # [m] across; the front camera reads it within 0.3 mm
_UPRIGHT_DEPTH, _UPRIGHT_TILT = 0.0025, math.radians(4)
_DEEP = 0.010  # [m] a tip so deep is in the hole, however it leans
_LEANS = math.radians(2.0)  # of the peg, with the hand where it should hang upright
_HELD_TILT = math.radians(1.5)  # a hand so far past upright leaves it to a peg that is in the hole
_RECENTRED = 0.004  # [m] that Insertion moves the hinge from above the hole
_MARGIN = 0.0015  # [m] beyond the depth that is asked for
_NEAR_ENOUGH = 0.001  # [m] of the tip, before it goes down
_TURNED_ENOUGH = math.radians(0.5)


@dataclass(frozen=True, kw_only=True)
class Felt:
    """What a touch came to: the height of the low corner [m], or a note on why there is none."""

    z: float | None = None
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class GuidedSkills:
    """The guided skills for a task, with the goals that were taught."""

    task: Task
    teaching: Teaching
    manner: Manner = field(default_factory=Manner)

    def __call__(
        self, robot: Robot, look: Looking, target: Pose, step: Step, belief: Belief
    ) -> Outcome:
        """Execute a step. What a recovery changed in its goal shifts where the skill aims, as do
        the shifts that the goal names; a compression stop ends it at once."""
        taught = self.teaching.goals.formations[step.formation]
        shift = {axis: value - taught.get(axis, 0.0) for axis, value in step.goal.items()}
        hand = Hand(self.manner, self.task, self.teaching, robot, look, step, belief)
        try:
            if step.retreat:
                self._lift_out(hand)
                self._approach(hand, shift)
                self._step_aside(hand, shift.get(Axis.X, 0.0))
                self._contact(hand)
            match step.formation:
                case Formation.APPROACH:
                    hand.to(target, self.manner.free_speed_m_s)
                    self._approach(hand, {})
                case Formation.CONTACT:
                    self._contact(hand)
                case Formation.FIT:
                    self._fit(hand, shift.get(Axis.X, 0.0))
                case Formation.ALIGN:
                    self._align(hand, shift)
                case Formation.INSERTION:
                    self._insert(hand, -min(0.0, shift.get(Axis.Z, 0.0)))
        except Stopped:
            robot.settle(self.manner.rest_s)
        hand.see((SIDE, FRONT))
        return Outcome(
            step=step, target=hand.at, motions=tuple(hand.motions), looks=tuple(hand.looks)
        )

    def probe(self, robot: Robot, look: Looking, probe: Probe, belief: Belief) -> Probed:
        """Lift the peg out and hang it leaning above the hole; look from higher, or touch."""
        step = self.teaching.goals.step(Formation.APPROACH)
        hand = Hand(self.manner, self.task, self.teaching, robot, look, step, belief)
        held_m, found = 0.0, Felt(note="the compression limit ended it")
        try:
            held_m = self._pull(hand)
            self._lift_out(hand)
            self._approach(hand, {})
            if probe.at is None:
                hand.shift(z=_HIGHER)
                found = Felt()
            else:
                found = self._touch(hand, *probe.at)
                self._lift_out(hand)
        except Stopped:
            pass
        robot.settle(self.manner.rest_s)
        hand.see(ALL)
        return Probed(
            probe=probe,
            motions=tuple(hand.motions),
            looks=tuple(hand.looks),
            held_m=held_m,
            touched_z=found.z,
            note=found.note,
        )

    def _pull(self, hand: Hand) -> float:
        """Pull lightly at the peg: how far that stretches the wrist [m]."""
        if hand.compression() > _UNLOADED:
            hand.load(_UNLOADED)
        hand.shift(z=_PULL)
        hand.robot.settle(self.manner.rest_s)
        return max(0.0, -hand.compression())

    def _lift_out(self, hand: Hand) -> None:
        hand.lift(hand.frame.z + self.task.tip_below_hinge + _ABOVE + 0.01)

    def _touch(self, hand: Hand, x: float, y: float) -> "Felt":
        """Go down with the low corner over a place, from the middle of the believed hole [m], until
        it is felt, at most a little below the board's surface."""
        wall = half_hole(self.task)
        here = hand.frame.inside(hand.at)
        over = replace(here, x=here.x + x, y=here.y + y + wall - _BEFORE_WALL)
        goal = hand.frame.outside(over)
        outside = self.manner.limits.outside({axis: goal[axis] for axis in Axis})
        if outside is not None:
            return Felt(note=f"it did not go there: the hand's {outside}")
        hand.to(goal, self.manner.free_speed_m_s)
        corner = hand.corner((SIDE, FRONT))
        if corner is None:
            return Felt(note="it did not go down: no picture shows where the peg hangs")
        hand.tare()
        above = hand.at.z
        hand.guarded(_BELOW - corner.depth, _TOUCH)
        is_felt = hand.motions[-1].stop is Stop.TOUCH
        hand.robot.settle(self.manner.rest_s)
        z = hand.frame.z - corner.depth - (above - hand.at.z)
        if not is_felt:
            return Felt(note=f"nothing was felt down to {z * 1e3:.1f} mm")
        return Felt(z=z + hand.compression())

    # --- the formations --------------------------------------------------------------------------

    def _approach(self, hand: Hand, shift: Partial) -> None:
        """Hang leaning above the hole, the low corner over its far wall, as the cameras show it;
        turned from there [rad]."""
        robot, share = hand.robot, hang_share(self.teaching)
        higher = 0.0
        for attempt in range(5):
            robot.settle(self.manner.swing_s)
            tip = hand.hanging_tip(ALL if attempt == 0 or higher else (SIDE, FRONT))
            if attempt == 0 and hand.is_blind:
                higher = _HIGHER
                hand.shift(z=higher)  # more may be seen from there
                continue
            if tip is None:
                break
            goal, off = self._above_hole(hand, tip, shift, higher)
            turned = max(
                abs(goal.roll - hand.at.roll),
                abs(goal.pitch - hand.at.pitch),
                abs(goal.yaw - hand.at.yaw),
            )
            if off < _NEAR_ENOUGH and turned * share < _TURNED_ENOUGH:
                break
            hand.to(goal, self.manner.free_speed_m_s)
        if higher:
            hand.shift(z=-higher)
            robot.settle(_STILL_S)  # no picture will tell how far it still swings

    def _above_hole(
        self, hand: Hand, tip: tuple[float, float, float], shift: Partial, higher: float
    ) -> tuple[Pose, float]:
        """The pose of the hinge for which the tip hangs where it should, or `higher` [m], and how
        far from there the tip is [m]."""
        frame, belief = hand.frame, hand.belief
        lean = hang_share(self.teaching) * _LEAN  # about; what it is will be seen
        half, wall = self.task.peg.half_extents[1], half_hole(self.task)
        aim = np.array(
            [
                0.0,
                -wall + _BEFORE_WALL + half * math.cos(lean),
                _ABOVE + higher + half * math.sin(lean),
            ]
        )
        error = frame.point(aim) - np.array(tip)
        roll = belief.upright_roll.value + _LEAN if belief.upright_roll else hand.at.roll
        pitch = hand.at.pitch
        if belief.upright_pitch:
            pitch = belief.upright_pitch.value + shift.get(Axis.PITCH, 0.0)
        yaw = frame.yaw + shift.get(Axis.YAW, 0.0)
        turned = self.manner.limits.within(replace(hand.at, roll=roll, pitch=pitch))
        roll, pitch = turned.roll, turned.pitch
        # What turning the hand will move the tip by is left out beforehand.
        lever = self.task.tip_below_hinge * hang_share(self.teaching)
        ahead, aside = lever * (roll - hand.at.roll), lever * (pitch - hand.at.pitch)
        cos, sin = math.cos(yaw), math.sin(yaw)
        error[:2] += (cos * aside + sin * ahead, sin * aside - cos * ahead)
        x, y, z = (float(v) for v in hand.at.position() + error)
        goal = Pose(x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=yaw)
        return goal, math.dist(frame.point(aim)[:2], tip[:2])

    def _step_aside(self, hand: Hand, aside: float) -> None:
        """Shift the hand by so much [m] along the hole's x, whether or not the cameras see that
        axis."""
        if aside:
            hand.shift(x=aside)
            hand.robot.settle(self.manner.swing_s)

    def _contact(self, hand: Hand) -> None:
        """Move down until the wrist gives way, then to a steady load, both counted from free hang
        with the hand turned as it is now: gravity pulls less along a leaning wrist."""
        hand.tare()
        hand.down(2 * _ABOVE + 0.02, _TOUCH)
        hand.load(_PRESSED)

    def _fit(self, hand: Hand, aside: float) -> None:
        """Bring the low corner to the far wall of the hole, which is looked for `aside` [m] along x
        of where it is believed to be."""
        for attempt in range(10):
            corner = hand.corner((SIDE,) if attempt == 0 else (SIDE, FRONT))
            if corner is None:
                return
            at_wall = _AT_WALL[0] < corner.y < _AT_WALL[1]
            inside = corner.depth > CORNER_IN_M
            if inside and (at_wall or corner.trailing_depth > 0.0):
                return
            if attempt == 0:
                continue  # look across too, before anything moves
            if not hand.lacks("unload"):
                hand.load(_UNLOADED)
            beside = corner.y - _ON_HOLE
            off = corner.x - (aside if corner.across else 0.0)
            if corner.is_felt and not inside:
                self._rake(hand, attempt, aside)
            elif inside:
                hand.shift(y=-max(0.003, min(0.010, corner.y + 0.003)))
            elif abs(beside) > _ASTRAY or abs(off) > _ASIDE:
                if not hand.lacks("unload"):
                    hand.shift(z=_HOP)
                hand.shift(x=-bounded(off, 0.010), y=-bounded(beside, 0.010))
            else:
                self._search(hand, attempt, corner.y + 0.002)
            hand.load(_PRESSED)

    def _search(self, hand: Hand, attempt: int, along: float) -> None:
        """Search for the hole, over it but not in it: on to the far wall, `along` [m] from here,
        with a turn of the hand, and across by a little more each time."""
        reach = 0.0008 * (1 + attempt // 2) * (1 if attempt % 2 == 0 else -1)
        hand.load(_LIGHT)
        hand.shift(x=reach, y=-along)
        hand.dither(math.radians(2.5))
        hand.shift(x=-reach)

    def _rake(self, hand: Hand, attempt: int, aside: float) -> None:
        """Feel for the hole where nothing is seen: lift off, hang before the far wall, touch, and
        drag the low corner beyond the wall; then again from nearer, as friction may hold it back,
        and from a little further across."""
        hand.shift(z=_HOP)
        hand.robot.settle(self.manner.swing_s)
        corner = hand.corner((SIDE, FRONT))
        if corner is None:
            return
        lane, again = divmod(attempt - 1, 2)
        before = _NEARER if again else _BEFORE_WALL
        across = _APART * ((lane + 1) // 2) * (1 if lane % 2 else -1)
        hand.shift(x=aside + across - corner.x, y=before - corner.y)
        hand.robot.settle(self.manner.swing_s)
        hand.load(_LIGHT)
        hand.shift(y=-_BEFORE_WALL - _BEYOND_WALL)  # the same way from nearer goes further
        hand.dither(math.radians(2.5))

    def _align(self, hand: Hand, shift: Partial) -> None:
        """Turn the peg upright under a light load, its tip held at the far wall."""
        belief = hand.belief
        upright = belief.upright_roll.value if belief.upright_roll else 0.0
        over = self._hinge_over_hole(hand) + shift.get(Axis.Y, 0.0)
        aside = self._aside(belief, shift)
        here = hand.frame.inside(hand.at)
        light = _PRESSED if hand.lacks("light") else _LIGHT
        past = 0.0 if hand.lacks("hold") else _HOLD
        hand.load(light)
        parts = 5
        for k in range(1, parts + 1):
            part = k / parts
            y = here.y + part * (over - here.y)
            roll = here.roll + part * (upright - past - here.roll)
            more = {str(a): here[a] + part * (goal - here[a]) for a, goal in aside.items()}
            hand.inside(y=y, roll=roll, **more)
            hand.load(light)
            hand.dither(math.radians(2.5))
        for attempt in range(4):
            seen = hand.tip()
            if seen is None:
                return
            depth, tilt = seen
            leans = abs(tilt.value)
            stands = depth > _UPRIGHT_DEPTH and leans < _UPRIGHT_TILT
            held = depth > CORNER_IN_M and leans < _HELD_TILT
            if stands or held or depth > _DEEP or attempt == 3:
                break
            hand.load(0.002 + 0.001 * attempt)
            for sweep in (-0.004, 0.003, 0.0):
                hand.inside(y=over + sweep)
                hand.dither(math.radians(3.0))
            hand.load(light)
        hand.inside(roll=upright)
        hand.dither(math.radians(2.5))
        self._straighten(hand)

    def _straighten(self, hand: Hand) -> None:
        """Turn the hand by what the peg still leans: it may have turned in the grasp since it last
        hung freely."""
        for _ in range(2):
            seen = hand.tip()
            if seen is None or abs(seen[1].value) < _LEANS:
                return
            turn = bounded(seen[1].value / hang_share(self.teaching), math.radians(6))
            hand.inside(roll=hand.at.roll - turn)
            hand.dither(math.radians(2.5))

    def _hinge_over_hole(self, hand: Hand) -> float:
        """The y [m] of the hinge for an upright peg in the hole, in the hole's frame."""
        angle = hand.belief.grasp_roll.value if hand.belief.grasp_roll else 0.0
        return self.task.grasp_below_hinge * math.sin(angle)

    def _aside(self, belief: Belief, shift: Partial) -> Partial:
        """The place in the hole's frame to which a shift sends the hinge, from where an upright peg
        in the hole would have it [m, rad]; an axis without a shift stays as it is."""
        upright = belief.upright_pitch.value if belief.upright_pitch else 0.0
        angle = hang_share(self.teaching) * upright  # of the gripper that holds an upright peg
        over = {
            Axis.X: self.task.grasp_below_hinge * math.sin(angle),
            Axis.PITCH: upright,
            Axis.YAW: 0.0,
        }
        return {a: over[a] + shift[a] for a in SHIFTS if shift.get(a, 0.0)}

    def _insert(self, hand: Hand, deeper: float) -> None:
        """Go down in short steps, straightened after each by what the picture shows; where there is
        no progress, back off and shake."""
        deepest = self.task.depth + _MARGIN + deeper
        over = self._hinge_over_hole(hand)
        before, stuck = -math.inf, 0
        for _ in range(40):
            seen = hand.tip()
            if seen is None:
                return
            depth, tilt = seen
            if hand.is_blind:
                depth -= SLIDES_M
            if depth >= deepest:
                return
            if depth - before < 0.3 * SLICE:
                stuck += 1
                if stuck > 8:
                    return
                hand.load(WORKED)
                if stuck % 3 and not hand.lacks("ease"):
                    hand.ease(0.0005 * (1 + stuck))
                else:
                    hand.shake(stuck)
                hand.load(WORKED)
                continue
            stuck = 0
            before = depth
            if abs(tilt.value) > 2 * tilt.sd and not hand.lacks("recentre"):
                lean = self.task.tip_below_hinge * math.sin(tilt.value)
                here = hand.frame.inside(hand.at).y
                straight = bounded(lean, 0.004)
                hand.inside(y=max(over - _RECENTRED, min(over + _RECENTRED, here + straight)))
            hand.shift(z=-min(SLICE, deepest - depth + 0.001))
