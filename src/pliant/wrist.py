"""How far the soft wrist may be pressed or stretched, and whether what is read of it can be true:
one rule for every cell.

The limit belongs to the wrist, not to a motion. Past it only unloading is allowed, whoever asks for
a motion, until compression is below it again; a little further the cell counts as broken. Each
robot has one `Watch` and feeds it every reading, also between motions.

Compression counts from free hang, in metres: above 0 pressed, below 0 stretched.
"""

import math
from dataclasses import dataclass, replace

from pliant.errors import RobotFault

LIMIT_M = 0.020
"""The limit of the wrist that the paper's simulator has, pressed or stretched [m]."""

OVER_M = 0.0025
"""So far past the limit [m] the trial ends as a fault; braking takes up to 1.5 mm."""

LOADED_M = 0.005
"""A wrist that is so far from where it hung at first [m] does not hang freely: it is not tared. In
healthy trials it was within 1.5 mm."""

_MOST_OVER_M = 0.005  # as OVER_M, where readings are noisy
_OVER_S = 0.06  # for so long: a blow to a held peg swings the tool further, and back
_BACK_M = 0.0005  # below the limit, before a motion may press again
_ALONG_M = 0.00002  # a motion that goes less along the wrist's axis neither presses nor unloads
_PULLED_M = 0.003  # read as stretching while it is pressed: the sign is wrong; healthy: 1.2 mm
_PULLED_S = 0.2  # for so long: not a swing after a blow
_FROZEN_S = 0.2  # of a motion without any change of the reading: a true one trembles
_JUMP_M = 0.015  # from one reading to the next; a blow to a held peg: 9 mm in 10 ms
_DEVIATIONS = 8.0  # of a reading's noise, which is no jump


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Compression at one moment: as it was read, and filtered, which strays by `margin_m` at most
    by itself; `noise_m` is the standard deviation of what was read [s, m]."""

    time_s: float
    read_m: float
    filtered_m: float
    margin_m: float = 0.0
    noise_m: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Load:
    """What a wrist's readings so far mean for the next motion.

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
        self._within_s = self._changed_s = self._pushed_s = -math.inf  # when it was last so
        self._toward_m: float | None = None  # of the motion under way
        self._stop_at_m = self.limit_m
        self._began_m = self._pressed_m = self._stretched_m = 0.0  # at first, and least in it
        self._hung_m: float | None = None

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
        self.last = None  # what is read jumps by what was tared

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
        jump = reading.read_m - before.read_m
        if abs(jump) > _JUMP_M + _DEVIATIONS * reading.noise_m:
            raise _doubt(f"it jumps by {jump * 1e3:+.1f} mm from one reading to the next")
        if self._toward_m is None or before is reading or jump != 0.0:
            self._changed_s = reading.time_s
        elif reading.time_s > self._changed_s + _FROZEN_S:
            raise _doubt(f"it reads {reading.read_m * 1e3:.2f} mm for a whole motion")
        if self._toward_m is not None and self._toward_m > _ALONG_M:
            pulled = min(0.0, self._began_m) - filtered
            if pulled <= _PULLED_M + margin:
                self._pushed_s = reading.time_s
            elif reading.time_s > self._pushed_s + _PULLED_S:
                raise _doubt(
                    f"it reads {pulled * 1e3:.1f} mm of stretching while the wrist is pressed: is"
                    " its sign right?"
                )

    def begin(self, compression_m: float, toward_m: float, stop_at_m: float) -> bool:
        """Whether a motion may begin that goes `toward_m` along the wrist's axis, above 0 toward
        the tip, and ends at `stop_at_m` of compression [m]."""
        load = self.load
        self._stop_at_m = stop_at_m
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

    def rest(self) -> None:
        """The motion has ended."""
        self._toward_m = None

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


def _in_words(compression_m: float) -> str:
    how = "pressed" if compression_m > 0 else "stretched"
    return f"the wrist is {how} by {abs(compression_m) * 1e3:.1f} mm"


def _doubt(why: str) -> RobotFault:
    return RobotFault("sensor", f"the wrist's compression cannot be believed: {why}")
