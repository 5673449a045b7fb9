"""The pace of the driver's loop from one look at the arm to the next: with the wall's clock, or
with an emulated controller in lockstep, whose ticks it grants itself. The loop is the same in
both."""

import time
from collections.abc import Callable

from pliant.ur5e.admin_port import AdminPort
from pliant.ur5e.configuration import Configuration
from pliant.ur5e.protocol import CYCLE_S, Pacing

_FRESH_S = 1e-6  # [s] of rounding in a time stamp
_SPIN_S = 0.0002


class Stalled(Exception):
    """Raised when the controller does not go on."""


class RealTime:
    """The pace of the wall's clock: a look every 2 ms; late is late, nothing is made up for."""

    is_lockstep = False

    def look(self) -> None:
        time.sleep(CYCLE_S)


class Lockstep:
    """The pace of lockstep: grants an emulated controller its ticks, and waits until the client's
    data are of then."""

    is_lockstep = True

    def __init__(self, admin: AdminPort, stamp: Callable[[], float], ticks: int) -> None:
        """Pace a driver; `stamp` is the latest time stamp [s] that the client has received."""
        self._admin, self._stamp, self._ticks = admin, stamp, ticks

    def look(self) -> None:
        """Wait until it is time to look again.

        Raises:
            Stalled: that time does not come.
        """
        give_up = time.monotonic() + self._admin.patience_s
        try:
            now = self._admin.grant(self._ticks)
        except TimeoutError as error:
            raise Stalled from error
        while self._stamp() < now - _FRESH_S:
            if time.monotonic() > give_up:
                raise Stalled
            time.sleep(_SPIN_S)


Pace = RealTime | Lockstep
"""A pace, whose `look` returns when it is time to look again."""


def pace_of(configuration: Configuration, stamp: Callable[[], float]) -> Pace:
    """The cell's pace.

    Raises:
        InputError: the cell is said to be emulated, and nobody answers at its admin port.
        OSError: the emulator does not answer.
    """
    emulator = configuration.emulator
    if emulator is None:
        return RealTime()
    patience_s = configuration.patience.stamp_ms * 1e-3
    admin = AdminPort(configuration.arm.address, emulator.admin_port, patience_s)
    if admin.ask("describe")["mode"] != Pacing.LOCKSTEP:
        admin.close()
        return RealTime()
    return Lockstep(admin, stamp, emulator.ticks_per_look)
