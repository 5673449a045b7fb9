"""The limits within which the soft wrist may be pressed or stretched, and whether what is read of
it can be true: one rule for every cell.

The limit belongs to the wrist, not to a motion. Past it only unloading is allowed, whoever asks for
a motion, until compression is below it again; a little further the cell counts as broken. Each
robot has one `Watch` and feeds it every reading, also between motions.

Compression counts from free hang, in metres: above 0 pressed, below 0 stretched.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pliant.errors import RobotFault
from pliant.pose import Pose

Vector = NDArray[np.float64]  # (3,)

GRAVITY = 9.81  # [m/s2]
LIMIT_M = 0.020
"""The limit of the wrist that the paper's simulator has, pressed or stretched [m]."""

OVER_M = 0.0025
"""The distance past the limit [m] at which the trial ends as a fault; braking takes up to 1.5
mm."""

LOADED_M = 0.005
"""The distance [m] from where it hung at first at which a wrist does not hang freely: it is not
tared. In healthy trials it was within 1.5 mm."""

ANSWERS = (0.85, 1.25)
"""The range of what a believable wrist reads more for each millimetre that it is pressed by;
healthy: 0.97 to 1.06. At 0.85 a limit of 20 mm is kept within 23.5."""

_TOUCHED_M = 0.0008  # read, while the wrist is pressed
_PRESS_M = 0.0012  # a press that tells how the reading answers
_ASIDE, _TURNED_RAD = 0.1, math.radians(0.5)  # per metre down, of a straight press
_LEAST_READINGS = 4
_TELLS_SD = 0.25  # of the slope; at more, noise hides whether it answers
_NOISY_M, _FELT_M, _FELT_DEVIATIONS = 0.0001, 0.002, 4.0  # a load that no noise can feign
_MOST_OVER_M = 0.005  # as OVER_M, where readings are noisy
_OVER_S = 0.06  # for so long: a blow to a held peg swings the tool further, and back
_BACK_M = 0.0005  # below the limit, before a motion may press again
_ALONG_M = 0.00002  # a motion that goes less along the wrist's axis neither presses nor unloads
_PULLED_M = 0.003  # read as stretching while it is pressed: the sign is wrong; healthy: 1.2 mm
_PULLED_S = 0.2  # for so long: not a swing after a blow
_FROZEN_S = 0.2  # of a motion without any change of the reading: a true one trembles
_JUMP_M = (
    0.015  # from one reading to the next, that does not come back: a blow does, within _OVER_S
)
_DEVIATIONS = 8.0  # of a reading's noise, which is no jump


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Compression at one moment: as it was read, and filtered, which strays by `margin_m` at most
    by itself; `noise_m` is the standard deviation of what was read [s, m]. `along_m` is how far a
    straight press that is under way (`is_straight`) has come along the wrist's axis."""

    time_s: float
    read_m: float
    filtered_m: float
    margin_m: float = 0.0
    noise_m: float = 0.0
    along_m: float | None = None


@dataclass(frozen=True, eq=False)
class Way:
    """The way of a straight press: where it begins (3,) [m], and the wrist's axis (3,), toward the
    tip; in any one frame."""

    start: Vector
    axis: Vector


@dataclass(frozen=True, kw_only=True)
class SensorAnswer:
    """The answer of a wrist's reading to being pressed: for each metre that the hand came closer it
    read `slope` more, which is known to a standard deviation of `sd`."""

    slope: float
    sd: float

    def is_within(self, deviations: float) -> bool:
        """Whether the slope may be a believable wrist's, so many standard deviations allowed."""
        low, high = ANSWERS
        return low - deviations * self.sd <= self.slope <= high + deviations * self.sd


@dataclass(frozen=True, kw_only=True)
class Load:
    """The load on a wrist: what its readings so far mean for the next motion.

    `side` is 1 where it was pressed past its limit and has not come back, -1 where it was stretched
    past it, 0 within; `least_m` is the smallest reading of that side since then [m].
    """

    side: int = 0
    least_m: float = math.inf

    def after(self, compression_m: float, limit_m: float, margin_m: float) -> "Load":
        """The load after one more reading, which strays by `margin_m` at most by itself."""
        if not self.side:
            if abs(compression_m) <= limit_m:
                return self
            side = 1 if compression_m > 0 else -1
            return Load(side=side, least_m=abs(compression_m))
        reading = self.side * compression_m
        if reading < limit_m - max(_BACK_M, margin_m):
            return Load().after(compression_m, limit_m, margin_m)
        return replace(self, least_m=min(self.least_m, reading))

    def permits(self, toward_m: float) -> bool:
        """Whether a motion may go `toward_m` [m] along the wrist's axis, above 0 toward the tip."""
        return self.side * toward_m <= _ALONG_M


class Watch:
    """Watches one wrist: what its readings allow now, across motions."""

    def __init__(self, limit_m: float = LIMIT_M) -> None:
        self.limit_m = limit_m
        self.forget()

    def forget(self) -> None:
        """Begin anew: a trial, with a wrist that hangs freely."""
        self.load = Load()
        self.last: Reading | None = None
        self._jumped: tuple[float, float] | None = None  # from where, when
        self._within_s = self._changed_s = self._pushed_s = -math.inf  # when it was last so
        self._toward_m: float | None = None  # of the motion under way
        self._stop_at_m = self.limit_m
        self._began_m = self._pressed_m = self._stretched_m = 0.0  # at first, and least in it
        self._hung_m: float | None = None
        self._way: Way | None = None  # of the press under way
        self._press: list[tuple[float, float]] = []  # of this motion: how far along, read [m]

    def tare(self, hangs_m: float) -> None:
        """Compression is about to count from where the wrist is, `hangs_m` by a count [m] that no
        taring changes.

        Raises:
            RobotFault: "loaded": it is not where it hung when it was first tared.
        """
        if self._hung_m is None:
            self._hung_m = hangs_m
        off_m = hangs_m - self._hung_m
        if not abs(off_m) <= LOADED_M:
            raise RobotFault("loaded", f"not tared: {_in_words(off_m)}, and does not hang freely")
        self.last = self._jumped = None  # what is read jumps by what was tared

    def read(self, reading: Reading) -> None:
        """Take a reading.

        Raises:
            RobotFault: "compression": the wrist is loaded well past its limit; "sensor": what is
                read cannot be true.
        """
        before, self.last = self.last or reading, reading
        filtered, margin = reading.filtered_m, reading.margin_m
        self.load = self.load.after(filtered, self.limit_m, margin)
        if abs(filtered) <= self.limit_m + min(max(OVER_M, margin), _MOST_OVER_M):
            self._within_s = reading.time_s
        elif reading.time_s > self._within_s + _OVER_S:
            raise RobotFault(
                "compression",
                f"{_in_words(filtered)}, past its limit of {self.limit_m * 1e3:g} mm: free the peg"
                " by hand",
            )
        self._see_jumps(before, reading)
        if self._toward_m is None or before is reading or reading.read_m != before.read_m:
            self._changed_s = reading.time_s
        elif reading.time_s > self._changed_s + _FROZEN_S:
            raise _doubt(f"it reads {reading.read_m * 1e3:.2f} mm for a whole motion")
        if reading.along_m is not None and filtered >= _TOUCHED_M + margin:
            self._press.append((reading.along_m, reading.read_m))
        if self._toward_m is not None and self._toward_m > _ALONG_M:
            pulled = min(0.0, self._began_m) - filtered
            if pulled <= _PULLED_M + margin:
                self._pushed_s = reading.time_s
            elif reading.time_s > self._pushed_s + _PULLED_S:
                raise _doubt(
                    f"it reads {pulled * 1e3:.1f} mm of stretching while the wrist is pressed: is"
                    " its sign right?"
                )

    def _see_jumps(self, before: Reading, reading: Reading) -> None:
        """A blow to a held peg makes the reading jump, too, but swings back."""
        most_m = _JUMP_M + _DEVIATIONS * reading.noise_m
        if self._jumped is None and abs(reading.read_m - before.read_m) > most_m:
            self._jumped = before.read_m, reading.time_s
        if self._jumped is None:
            return
        from_m, at_s = self._jumped
        off_m = reading.read_m - from_m
        if abs(off_m) <= most_m:
            self._jumped = None
        elif reading.time_s > at_s + _OVER_S:
            raise _doubt(f"it jumped by {off_m * 1e3:+.1f} mm at once and has not come back")

    def begin(
        self, compression_m: float, toward_m: float, stop_at_m: float, way: Way | None = None
    ) -> bool:
        """Whether a motion may begin that goes `toward_m` along the wrist's axis, above 0 toward
        the tip, and ends at `stop_at_m` of compression [m]; a straight press on its `way`."""
        load = self.load
        self._stop_at_m, self._way = stop_at_m, way
        self._press = []
        self._began_m = self._pressed_m = compression_m
        self._stretched_m = -compression_m
        if load.side and abs(toward_m) <= _ALONG_M:  # across, or a turn: no creeping past it
            if load.side > 0:
                self._pressed_m = min(self._pressed_m, load.least_m)
            else:
                self._stretched_m = min(self._stretched_m, load.least_m)
        if not load.permits(toward_m):
            return False
        self._toward_m = toward_m
        self._pushed_s = -math.inf if self.last is None else self.last.time_s
        return True

    def along(self, position: Vector) -> float | None:
        """The distance [m] that a straight press has come along the wrist's axis, with the hinge
        point at `position` (3,); None: none is under way."""
        return None if self._way is None else float((position - self._way.start) @ self._way.axis)

    def rest(self) -> None:
        """Note that the motion has ended."""
        self._toward_m = self._way = None

    def answer(self) -> SensorAnswer | None:
        """The answer of the reading in the last motion; None: it was pressed too little to say. Of
        all its ends that tell, the one where most was felt: a peg that slides, or goes into a hole,
        is felt less."""
        if self.last is None or len(self._press) < _LEAST_READINGS:
            return None
        along, read = np.array(self._press)[::-1].T  # from the end
        n = np.arange(1, len(along) + 1)
        spread = np.cumsum(along**2) - np.cumsum(along) ** 2 / n
        common = np.cumsum(along * read) - np.cumsum(along) * np.cumsum(read) / n
        reach = np.maximum.accumulate(along) - np.minimum.accumulate(along)
        tells = (n >= _LEAST_READINGS) & (reach >= _PRESS_M)
        tells &= self.last.noise_m**2 <= _TELLS_SD**2 * spread
        if not tells.any():
            return None
        slope = np.where(tells, common / np.where(tells, spread, 1.0), -np.inf)
        k = int(np.argmax(slope))
        return SensorAnswer(
            slope=float(slope[k]), sd=float(self.last.noise_m / math.sqrt(spread[k]))
        )

    def ends(self, compression_m: float, margin_m: float, earlier_m: float = 0.0) -> bool:
        """Whether this reading ends the motion: past the motion's limit, or stretched past the
        wrist's, less `earlier_m` for braking. Where the wrist is past it already a motion may only
        unload, `margin_m` besides. It needs no reading before it: an arm that has not been tared
        yet moves, too."""
        self._pressed_m = min(self._pressed_m, compression_m)
        self._stretched_m = min(self._stretched_m, -compression_m)
        pressed = compression_m > max(self._stop_at_m - earlier_m, self._pressed_m + margin_m)
        stretched = -compression_m > max(self.limit_m - earlier_m, self._stretched_m + margin_m)
        return pressed or stretched


def is_felt(compression_m: float, sd_m: float, readings: int = 1) -> bool:
    """Whether a noisy wrist at rest, of which one reading is known to a standard deviation of
    `sd_m` and the mean of `readings` is `compression_m`, is felt to be pressed. Noise may hide by
    how much it answers, not that it does; of a wrist without noise more is asked."""
    is_sure = compression_m > _FELT_DEVIATIONS * sd_m / math.sqrt(readings)
    return is_sure and may_be_felt(compression_m, sd_m)


def may_be_felt(compression_m: float, sd_m: float) -> bool:
    """Whether more readings could show that the wrist is felt to be pressed."""
    return sd_m >= _NOISY_M and compression_m > _FELT_M


def is_straight(start: Pose, goal: Pose) -> bool:
    """Whether a motion goes so straight down that pressing is all it does to the wrist: a tip that
    is dragged, or turned, loads it, too."""
    way = goal.position() - start.position()
    return math.hypot(way[0], way[1]) <= -_ASIDE * way[2] and start.turn_to(goal) <= _TURNED_RAD


def toward_tip(start: Pose, end: Pose) -> float:
    """The distance [m] that the way to a pose goes along the wrist's axis there, toward the tip."""
    return float((start.position() - end.position()) @ end.rotation()[:, 2])


def _in_words(compression_m: float) -> str:
    how = "pressed" if compression_m > 0 else "stretched"
    return f"the wrist is {how} by {abs(compression_m) * 1e3:.1f} mm"


def _doubt(why: str) -> RobotFault:
    return RobotFault("sensor", f"the wrist's compression cannot be believed: {why}")
