"""The hand during one guided execution: it moves in the hole's frame, feels the wrist's
compression, looks, and keeps what it did, saw, and now believes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pliant.belief import Belief
from pliant.cell import Motion, Robot, Stop
from pliant.checks import half_hole
from pliant.envelope import Limits
from pliant.errors import RobotFault
from pliant.formations import Step
from pliant.methods.guided.belief import MEMORY, in_hand, softly
from pliant.methods.guided.touch import placed, shows_nothing
from pliant.pose import Pose
from pliant.records import Look, Looking
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.scene import Measured, PegSeen
from pliant.vision.surround import FRONT, SIDE
from pliant.wrist import LIMIT_M, LOADED_M

WORKED = 0.010  # [m] of compression while a stuck peg is shaken
_HELD_BACK = 0.005  # [m] the wrist is stretched by a peg that holds on
SLICE = 0.005  # [m] of one step of Insertion
_TRIMMED = 0.0003  # [m] a load this close is trimmed
_SPRANG_BACK = 0.001  # [m] of compression
_CLEARLY_IN_M = 0.003  # below the board's surface; a tip on it is read within 2 mm
_LIFTS = 40  # short lifts and shakes out of the hole, at most
_HALF_SWING_S = 0.19  # of the tool that hangs from the soft wrist


MECHANISMS = (
    "swing",  # two looks half a swing apart tell where the hanging peg will come to rest
    "unload",  # what is pressed does not travel
    "light",  # Align turns the peg under a light load
    "hold",  # and turns the hand past upright, so that the torque holds the tip at the far wall
    "dither",  # turns about z under load, to both sides
    "recentre",  # Insertion straightens the peg by what the picture shows
    "ease",  # and shifts the hand to where the wrist springs back
    "median",  # one reading of the hole does not decide
    "calibration",  # a camera is corrected by the hanging peg (where edges are measured)
)


@dataclass(frozen=True, kw_only=True)
class Manner:
    """The manner in which the guided skills move: workspace, speeds [m/s], limit [m], waits [s];
    and the mechanisms that they go without."""

    limits: Limits = field(default_factory=Limits)
    lacks: frozenset[str] = frozenset()
    free_speed_m_s: float = 0.05
    guarded_speed_m_s: float = 0.03
    turning_speed_m_s: float = 0.10  # of the arc at the tip's distance; a turn about z moves no tip
    compression_limit_m: float = LIMIT_M  # from free hang
    swing_s: float = 0.8  # until a free-hanging peg is nearly at rest
    rest_s: float = 0.3

    @property
    def memory(self) -> int:
        """The number of readings of which the hole's place is the median."""
        return 1 if "median" in self.lacks else MEMORY


class Stopped(Exception):
    """Raised when the compression limit ended a motion."""


@dataclass(frozen=True, kw_only=True)
class HandFrame:
    """The hole's frame in the task frame: its origin [m] and its yaw [rad]."""

    x: float
    y: float
    z: float
    yaw: float

    def point(self, inside: np.ndarray) -> np.ndarray:  # (3,) [m]
        """Transform a point (3,) [m] of the hole's frame to the task frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        a, b, c = inside
        return np.array([self.x + cos * a - sin * b, self.y + sin * a + cos * b, self.z + c])

    def inside(self, pose: Pose) -> Pose:
        """Transform a pose of the task frame to the hole's."""
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
        """Transform a pose of the hole's frame to the task frame: the inverse of `inside`."""
        x, y, z = (float(v) for v in self.point(np.array([pose.x, pose.y, pose.z])))
        return replace(pose, x=x, y=y, z=z, yaw=pose.yaw + self.yaw)


@dataclass(frozen=True, kw_only=True)
class Tip:
    """The tip of the peg [m], seen or felt, the peg's corners, and its tilt about the hand's
    axis."""

    tip: tuple[float, float, float]
    peg: PegSeen
    tilt: Measured
    is_felt: bool


@dataclass(frozen=True, kw_only=True)
class Corner:
    """The low corner in the hole's frame [m]: x of the peg's axis (0 where it was not looked for),
    y from the far wall, its depth, and the trailing corner's; whether x was measured, and whether
    all of it is felt, not seen."""

    x: float
    y: float
    depth: float
    trailing_depth: float
    across: bool
    is_felt: bool


def bounded(value: float, most: float) -> float:
    return max(-most, min(most, value))


class Hand:
    """The robot during one execution: where it was sent, what it did, saw, and now believes."""

    def __init__(
        self,
        manner: Manner,
        task: Task,
        teaching: Teaching,
        robot: Robot,
        look: Looking,
        step: Step,
        belief: Belief,
    ) -> None:
        self.robot, self.belief = robot, belief
        self.motions: list[Motion] = []
        self.looks: list[Look] = []
        self.at = robot.observe(cameras=()).pose
        self._manner, self._task, self._teaching = manner, task, teaching
        self._look, self._step = look, step

    def lacks(self, mechanism: str) -> bool:
        return mechanism in self._manner.lacks

    # --- motion ----------------------------------------------------------------------------------

    def to(self, pose: Pose, speed: float) -> None:
        """Move straight to a pose in the task frame."""
        self._move(pose, speed, self._manner.compression_limit_m)

    def shift(self, *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        """Move by so much [m] along the hole's axes."""
        here = self.frame.inside(self.at)
        there = replace(here, x=here.x + x, y=here.y + y, z=here.z + z)
        self.to(self.frame.outside(there), self._manner.limits.contact_speed_m_s)

    def inside(self, **axes: float) -> None:
        """Move to these values of the hole's frame [m, rad]; the others stay."""
        there = replace(self.frame.inside(self.at), **axes)
        self.to(self.frame.outside(there), self._manner.limits.contact_speed_m_s)

    def dither(self, angle: float) -> None:
        """Turn the hand about z by so much to either side [rad], and back."""
        if self.lacks("dither"):
            return
        here = self.at
        for yaw in (here.yaw + angle, here.yaw - angle, here.yaw):
            self.to(replace(here, yaw=yaw), self._manner.turning_speed_m_s)

    def lift(self, clear: float) -> None:
        """Lift straight up to the height `clear` [m], out of the hole; a peg that holds on is
        shaken."""
        for attempt in range(_LIFTS):
            if self.at.z >= clear:
                return
            if self.compression() < -_HELD_BACK:
                self.shake(1 + attempt % 5)
            else:
                up = replace(self.at, z=min(clear, self.at.z + 2 * SLICE))
                self.to(up, self._manner.free_speed_m_s)

    def ease(self, size: float) -> None:
        """Shift the hand by `size` [m] to each side, and stay where the wrist springs back: a peg
        in a tight hole goes on where the hand is above it."""
        for x, y in ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)):
            before = self.compression()
            self.shift(x=x * size, y=y * size)
            if before - self.compression() > _SPRANG_BACK:
                self.load(WORKED)
            else:
                self.shift(x=-x * size, y=-y * size)

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

    def tare(self) -> None:
        """Count compression from here, in free hang.

        Raises:
            RobotFault: "loaded": by what is believed of the board the peg stands on it, or in it.
        """
        below = self.frame.z + self._task.tip_below_hinge - self.at.z
        if below > LOADED_M:
            raise RobotFault(
                "loaded",
                f"not tared: the hand is {below * 1e3:.1f} mm too low for the peg to hang freely",
            )
        self.robot.tare()

    def down(self, most: float, touch: float) -> None:
        """Move down by at most `most` [m], ended by `touch` [m] of compression, or in the hole.

        Raises:
            RobotFault: "no_touch": it was not, and no picture shows the tip in the hole.
        """
        self.guarded(most, touch)
        last = self.motions[-1]
        if last.stop is not Stop.TOUCH and not self._is_in_hole():
            raise RobotFault(
                "no_touch",
                f"nothing was felt down to {last.ended.z * 1e3:.1f} mm, where the peg should have"
                " touched the board",
            )

    def guarded(self, most: float, touch: float) -> None:
        """Move down by at most `most` [m], ended by `touch` [m] of compression."""
        goal = replace(self.at, z=self.at.z - most)
        self._move(goal, self._manner.guarded_speed_m_s, touch)

    def _is_in_hole(self) -> bool:
        seen = self.tip()
        return seen is not None and seen[0] > _CLEARLY_IN_M

    def load(self, compression: float) -> None:
        """Move up or down until the wrist is pressed by about so much [m]."""
        for _ in range(4):
            error = compression - self.compression()
            if abs(error) < _TRIMMED:
                return
            z = self.at.z - bounded(error, 0.008)
            self.to(replace(self.at, z=z), self._manner.limits.contact_speed_m_s)
            self.robot.settle(0.1)

    def _move(self, pose: Pose, speed: float, limit: float) -> None:
        pose = self._manner.limits.within(pose)
        motion = self.robot.move_to(pose, speed_m_s=speed, stop_at_compression_m=limit)
        guarded = limit < self._manner.compression_limit_m
        if motion.stop is Stop.COMPRESSION and guarded:
            motion = replace(motion, stop=Stop.TOUCH)
        self.motions.append(motion)
        self.at = motion.ended if motion.stop.is_early else pose
        if motion.stop is Stop.COMPRESSION:
            raise Stopped

    # --- senses ----------------------------------------------------------------------------------

    def compression(self) -> float:
        """The compression of the wrist, from free hang [m]."""
        return self.robot.observe(cameras=()).compression_m

    def see(self, cameras: Sequence[str]) -> Tip | None:
        """Look, and return the tip of the peg [m], or None if the peg or the hole is not seen."""
        look = self._look(cameras)
        self.looks.append(look)
        seen = look.during(self._step)
        self.belief = softly(self.belief, seen, self._teaching, self._manner.memory)
        scene = placed(self._task, self._teaching, look, self.belief)
        peg, across = scene.peg, scene.across
        if peg is None or self.belief.hole_y is None:
            return None
        x = across.tip_x.value if across is not None and across.tip_x is not None else self.frame.x
        is_felt = shows_nothing(look.scene)
        tilt = peg.tilt if is_felt else in_hand(seen)[0]
        tip = x, peg.tip_y.value, peg.tip_z.value
        return Tip(tip=tip, peg=peg, tilt=tilt, is_felt=is_felt)

    @property
    def is_blind(self) -> bool:
        """Whether the last pictures showed nothing."""
        return bool(self.looks) and shows_nothing(self.looks[-1].scene)

    def hanging_tip(self, cameras: Sequence[str]) -> tuple[float, float, float] | None:
        """The tip of the hanging peg [m], from two looks half a swing apart, whose mean is where it
        will come to rest."""
        one = self.see(cameras)
        if self.lacks("swing"):
            return None if one is None else one.tip
        self.robot.settle(_HALF_SWING_S)
        other = self.see((SIDE, FRONT))
        if one is None or other is None:
            return None
        x, y, z = ((a + b) / 2 for a, b in zip(one.tip, other.tip, strict=True))
        return x, y, z

    def corner(self, cameras: Sequence[str]) -> "Corner | None":
        """The low corner of the peg in the hole's frame, or None if the peg or the hole is not
        seen."""
        self.robot.settle(self._manner.rest_s)
        seen = self.see(cameras)
        if seen is None:
            return None
        across, peg = self.looks[-1].scene.across, seen.peg
        task, frame = self._task, self.frame
        cos, sin = math.cos(frame.yaw), math.sin(frame.yaw)
        x, y = seen.tip[0] - frame.x, seen.tip[1] - frame.y
        half = peg.tip_y.value - peg.left_y
        wall = half_hole(task)
        return Corner(
            x=cos * x + sin * y if FRONT in cameras else 0.0,
            y=y / cos - half + wall if FRONT not in cameras else cos * y - sin * x - half + wall,
            depth=frame.z - peg.left_z,
            trailing_depth=frame.z - peg.right_z,
            across=across is not None and across.tip_x is not None,
            is_felt=seen.is_felt,
        )

    def tip(self) -> tuple[float, Measured] | None:
        """The tip's depth [m] and the peg's tilt [rad] about the hand's axis."""
        self.robot.settle(self._manner.rest_s)
        seen = self.see((SIDE,))
        if seen is None:
            return None
        return self.frame.z - seen.tip[2], seen.tilt

    @property
    def frame(self) -> HandFrame:
        """The hole's frame, where the hole is believed to be."""
        belief = self.belief
        x, y, z, yaw = (
            m.value if m is not None else 0.0
            for m in (belief.hole_x, belief.hole_y, belief.surface_z, belief.board_yaw)
        )
        return HandFrame(x=x, y=y, z=z, yaw=yaw)
