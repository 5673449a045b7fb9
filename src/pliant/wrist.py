"""How far the soft wrist may be pressed or stretched: one rule for every cell.

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

_MOST_OVER_M = 0.005  # the same where readings are noisy
_BACK_M = 0.0005  # below the limit, before a motion may press again
_ALONG_M = 0.00002  # a motion that goes less along the wrist's axis neither presses nor unloads


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
        """Begin anew, unwatched until `read` is given a reading."""
        self.load = Load()
        self._stop_at_m = self.limit_m
        self._pressed_m = self._stretched_m = math.inf  # least in this motion

    def read(self, compression_m: float, margin_m: float) -> None:
        """Take a reading.

        Raises:
            RobotFault: "compression": the wrist is loaded well past its limit.
        """
        self.load = self.load.after(compression_m, self.limit_m, margin_m)
        over_m = min(max(OVER_M, margin_m), _MOST_OVER_M)
        if abs(compression_m) > self.limit_m + over_m:
            how = "pressed" if compression_m > 0 else "stretched"
            raise RobotFault(
                "compression",
                f"the wrist is {how} by {abs(compression_m) * 1e3:.1f} mm, past its limit of"
                f" {self.limit_m * 1e3:g} mm: free the peg by hand",
            )

    def begin(self, compression_m: float, toward_m: float, stop_at_m: float) -> bool:
        """Whether a motion may begin that goes `toward_m` along the wrist's axis, above 0 toward
        the tip, and ends at `stop_at_m` of compression [m]."""
        load = self.load
        self._stop_at_m = stop_at_m
        self._pressed_m, self._stretched_m = compression_m, -compression_m
        if load.side and abs(toward_m) <= _ALONG_M:  # across, or a turn: no creeping past it
            if load.side > 0:
                self._pressed_m = min(self._pressed_m, load.least_m)
            else:
                self._stretched_m = min(self._stretched_m, load.least_m)
        return load.permits(toward_m)

    def ends(self, compression_m: float, margin_m: float, earlier_m: float = 0.0) -> bool:
        """Whether this reading ends the motion: past the motion's limit, or stretched past the
        wrist's, less `earlier_m` for braking. Where the wrist is past it already a motion may only
        unload, `margin_m` besides."""
        self._pressed_m = min(self._pressed_m, compression_m)
        self._stretched_m = min(self._stretched_m, -compression_m)
        pressed = compression_m > max(self._stop_at_m - earlier_m, self._pressed_m + margin_m)
        stretched = -compression_m > max(self.limit_m - earlier_m, self._stretched_m + margin_m)
        return pressed or stretched
