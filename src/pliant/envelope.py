"""The envelope: nothing moves the arm without its leave, teaching included."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from pliant.cell import Motion, Observation, Robot, RobotBehind, missed, outside
from pliant.errors import RobotFault
from pliant.formations import MOST_TURN
from pliant.pose import Axis, Partial, Pose
from pliant.wrist import LIMIT_M, SensorAnswer, is_felt, may_be_felt

_BELOW_M = 0.010  # than the touch is due: 51 of 52 healthy trials need no more
_UNPROVEN_M = 0.014  # of pressing on the board, whatever is read, before the sensor has answered
_LIKELY, _DOUBTED = 2.0, 3.0  # standard deviations of the sensor's answer
_PRESSES = 4  # that are felt too little
_READINGS, _BETWEEN_S = 9, 0.1  # at rest, of a wrist whose noise hides whether it is pressed
_OFF_M, _OFF_RAD = 0.010, math.radians(3.0)  # of a hand that is held back, before it has
_SURFACE_M = 0.020  # from nominal: further no board is believed to be


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The limits of the envelope: where the hinge point may go [m, rad], how fast at all and where
    the peg may touch [m/s], how far the wrist may be pressed [m], and how far one recovery may move
    a goal [m, rad]."""

    low: Pose = Pose(x=-0.03, y=-0.10, z=0.12, roll=-0.5, pitch=-0.3, yaw=-0.5)
    high: Pose = Pose(x=0.03, y=0.10, z=0.40, roll=0.5, pitch=0.3, yaw=0.5)
    speed_m_s: float = 0.10
    contact_speed_m_s: float = 0.02  # for skills to keep: the envelope knows no contact
    compression_m: float = LIMIT_M
    goal_step_m: float = 0.045
    goal_step_rad: float = MOST_TURN

    def within(self, pose: Pose) -> Pose:
        """The pose of the workspace that is nearest on each axis."""
        return Pose(**{a: min(max(pose[a], self.low[a]), self.high[a]) for a in Axis})

    def outside(self, goal: Partial, *, margin: bool = False) -> str | None:
        """The reason why a goal lies outside the workspace, or None. With `margin`, as for goals:
        inside it by so much that a pose measured at the goal is still within it."""
        inset = {a: 0.0 if not margin else 0.01 if a.is_angle else 0.001 for a in Axis}
        low = Pose(**{a: self.low[a] + inset[a] for a in Axis})
        high = Pose(**{a: self.high[a] - inset[a] for a in Axis})
        return outside(low, high, goal)


@dataclass(frozen=True, kw_only=True)
class Descent:
    """The limit on how low the hinge point may go over a board, by geometry alone: whatever the
    wrist's sensor says.

    `surface_z` is where the board's surface is believed to be, `hang_m` how far below the hinge
    point the peg's tip hangs freely, `depth_m` how deep the hole lets it in, `sunk_m` how deep in
    it the tip was seen, with the hinge point at `seen_z` [m].
    """

    surface_z: float
    hang_m: float
    depth_m: float
    sunk_m: float = 0.0
    seen_z: float = math.inf

    @property
    def unseen_z(self) -> float:
        """The height [m] up to which the hand may rise from where the tip was seen in the hole, by
        that picture alone."""
        return self.seen_z + _UNPROVEN_M

    def after(self, motion: Motion) -> "Descent":
        """The limit after one more motion: out of the hole nothing counts from the tip in it."""
        is_out = motion.ended.z > self.seen_z + self.sunk_m
        return replace(self, sunk_m=0.0) if is_out else self

    def lowest_z(self, stop_at_m: float, limits: Limits, *, proven: bool) -> float:
        """The lowest height [m] of the hinge point in a motion that ends at `stop_at_m` of
        compression [m]. One that ends earlier than at the limit is for a touch, on the board's
        surface. `proven` says whether the wrist's sensor has answered to being pressed: until then
        nothing goes further than a touch may, counted from the tip where it was seen in the hole.
        """
        surface = max(-_SURFACE_M, min(_SURFACE_M, self.surface_z))
        if stop_at_m < limits.compression_m:
            return surface + self.hang_m - stop_at_m - _BELOW_M
        lowest = min(surface, 0.0) + self.hang_m - self.depth_m - limits.compression_m - _BELOW_M
        if not proven:
            return max(lowest, surface + self.hang_m - self.sunk_m - _UNPROVEN_M)
        return lowest


class Guarded(RobotBehind):
    """A robot behind the envelope: the same six calls, each motion checked, speed and compression
    limit capped, and no lower than `descent` allows where somebody set it. The motion's record
    keeps what was requested beside what was commanded.

    `motions` are those done since somebody cleared the list, `under_way` where the arm was sent and
    has not arrived: after a fault they say what it was doing. `has_answered` says whether the
    wrist's sensor has answered to being pressed; until then `sees_depth`, where somebody gives it,
    takes a picture and says how deep the tip is in the hole [m], None if that is not seen.
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        super().__init__(robot)
        self.limits = limits
        self.motions: list[Motion] = []
        self.under_way: Pose | None = None
        self.descent: Descent | None = None
        self.has_answered = False
        self.sees_depth: Callable[[], float | None] | None = None
        self._unlikely = 0  # answers

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        """Move as `Robot.move_to` does; a pose outside the workspace raises RobotFault("envelope"),
        after a halt."""
        problem = self.limits.outside({axis: pose[axis] for axis in Axis})
        if problem is None and not (speed_m_s > 0 and stop_at_compression_m > 0):
            problem = "speed and compression limit must be above 0"
        if problem is not None:
            self._robot.halt()
            raise RobotFault("envelope", f"refused a motion: {problem}")
        self._see_that_it_comes_free(pose, speed_m_s, stop_at_compression_m)
        return self._move(pose, speed_m_s, stop_at_compression_m)

    def _move(self, requested: Pose, speed_m_s: float, stop_at_m: float) -> Motion:
        pose = self._not_too_low(requested, stop_at_m)
        self.under_way = pose
        motion = self._robot.move_to(
            pose,
            speed_m_s=min(speed_m_s, self.limits.speed_m_s),
            stop_at_compression_m=min(stop_at_m, self.limits.compression_m),
        )
        self.under_way = None
        if pose is not requested:
            motion = replace(motion, requested=requested)
        self.motions.append(motion)
        if self.descent is not None:
            self.descent = self.descent.after(motion)
        self._hear(motion.answer)
        self._see_that_it_arrived(motion)
        return motion

    def _see_that_it_comes_free(self, goal: Pose, speed_m_s: float, stop_at_m: float) -> None:
        """What holds a peg in the hole stretches the wrist of a hand that rises. Until the sensor
        has answered, the hand rises a little at a time, and the tip must be seen to rise with
        it."""
        descent = self.descent
        while (
            not self.has_answered
            and self.sees_depth is not None
            and descent is not None
            and descent.sunk_m > 0.0
            and goal.z > descent.unseen_z
        ):
            here = self._robot.observe(()).pose
            if here.z < descent.unseen_z:
                up = here.updated({Axis.Z: descent.unseen_z})
                here = self._move(up, speed_m_s, stop_at_m).ended
            depth = self.sees_depth()
            if depth is None or depth > descent.sunk_m - (here.z - descent.seen_z) / 2:
                self._robot.halt()
                raise RobotFault(
                    "held",
                    "the peg is not seen to rise with the hand, and the wrist's sensor has not"
                    " answered yet",
                )
            self.descent = descent = replace(descent, sunk_m=depth, seen_z=here.z)

    def _see_that_it_arrived(self, motion: Motion) -> None:
        """What holds the peg holds back the hand, too, and loads the wrist. A sensor that has
        answered tells by how much; until it has, the hand must get where it is sent."""
        off_m, turn = motion.off
        arrives = off_m <= _OFF_M and turn <= _OFF_RAD
        if self.has_answered or arrives or motion.stop.is_early:
            return
        self._robot.halt()
        raise RobotFault(
            "not_reached",
            f"{missed(off_m, turn)}, and the wrist's sensor has not answered yet",
        )

    def _hear(self, answer: SensorAnswer | None) -> None:
        """Judge how the sensor answered to a press. One that is felt too little may be of a peg
        that slid into the hole; several are not, but where the peg is in it already. Once the
        sensor has answered, a slide is no news."""
        if answer is None or self.has_answered:
            return
        self.has_answered = answer.is_within(_LIKELY)
        slides = self.descent is not None and self.descent.sunk_m > 0.0 and answer.slope < 1.0
        if answer.is_within(_DOUBTED) or slides:
            return
        self._unlikely += 1
        if self._unlikely >= _PRESSES or answer.slope > 1.0:
            self._robot.halt()
            raise RobotFault(
                "sensor",
                "the wrist's compression cannot be believed: a millimetre of pressing is felt as"
                f" {answer.slope:.2f} mm",
            )

    def _not_too_low(self, pose: Pose, stop_at_m: float) -> Pose:
        """The pose, or as low on the way to it as geometry allows; where the arm is lower already,
        the pose at the arm's height."""
        if self.descent is None:
            return pose
        lowest = self.descent.lowest_z(stop_at_m, self.limits, proven=self.has_answered)
        if pose.z >= lowest:
            return pose
        here = self._robot.observe(()).pose.z
        return pose.updated({Axis.Z: max(pose.z, min(lowest, here))})

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        seen = super().observe(cameras)
        if not self.has_answered:
            self.has_answered = self._feels(seen)
        return seen

    def _feels(self, seen: Observation) -> bool:
        """Whether the wrist is felt to be pressed. What noise may hide is read again."""
        read, sd_m = [seen.compression_m], seen.compression_sd_m
        while not is_felt(fmean(read), sd_m, len(read)):
            if len(read) == _READINGS or not may_be_felt(fmean(read), sd_m):
                return False
            self._robot.settle(_BETWEEN_S)
            read.append(self._robot.observe(()).compression_m)
        return True
