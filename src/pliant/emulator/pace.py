"""The pace at which the controller ticks: in real time, faster, or when the client grants it
(lockstep).

A controller that is too slow falls behind, and its time slips: it never makes up for it with a
burst. Without credit, lockstep answers commands and sends its time stamp again, but steps no
physics, so that a client on a loaded machine meets the same robot as on an idle one.
"""

import asyncio
from collections.abc import Callable

from pliant.emulator.controller import Controller
from pliant.emulator.plant import TICK
from pliant.ur5e.protocol import Pacing

MOST_SPEED = 100.0  # times real time; what is reached is another matter
_LATE_S = TICK  # of the wall's time: what is later than this is lost
_IDLE_S = 0.005  # between answers, while a lockstep client grants nothing
_TICKS_UNSEEN = 25  # at most, within one grant: a client acts between grants, not within


class EmulatorPace:
    """Runs a controller, and publishes after every tick."""

    def __init__(
        self,
        controller: Controller,
        publish: Callable[[bool], None],
        client_patience_s: float = 0.0,
    ) -> None:
        """Pace a controller; `publish(always)` sends out what is due, or everything. Time slips for
        up to `client_patience_s` of the wall's while a client is late to feed its watchdog."""
        self.pacing, self.speed = Pacing.REAL, 1.0
        self._client_patience_s = client_patience_s
        self._waited_s = 0.0  # for the client, since it was last in time
        self.slipped_s = 0.0  # of the wall's time, since it began
        self._controller, self._publish = controller, publish
        self._credit = 0
        self._spent: list[tuple[int, asyncio.Future[None]]] = []  # (at tick, the grant's)
        self._awake = asyncio.Event()
        self._stalled_until = 0.0

    def set(self, pacing: Pacing, speed: float) -> None:
        """Change the pace; credit that is left lapses."""
        self.pacing = pacing
        self.speed = speed if pacing is Pacing.FAST else 1.0
        self._credit = 0
        self._release(everyone=True)
        self._awake.set()

    async def grant(self, ticks: int) -> None:
        """Let a lockstep controller go on; returns when it has."""
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._credit += ticks
        self._spent.append((self._controller.ticks + self._credit, done))
        self._awake.set()
        await done

    def stall(self, seconds: float) -> None:
        """Do nothing at all for a while, by the wall's clock."""
        self._stalled_until = asyncio.get_running_loop().time() + seconds
        self._awake.set()

    def wake(self) -> None:
        """Note that a client has written something."""
        self._awake.set()

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            stall = self._stalled_until - loop.time()
            if stall > 0:
                await asyncio.sleep(stall)
                due = loop.time()
            elif self.pacing is Pacing.LOCKSTEP:
                await self._step_with_credit()
                due = loop.time()
            elif self._controller.is_unfed and self._waited_s < self._client_patience_s:
                self._waited_s -= loop.time()
                await asyncio.sleep(_IDLE_S)
                self._waited_s += loop.time()
            else:
                if not self._controller.is_unfed:
                    self._waited_s = 0.0
                due += TICK / self.speed
                late = loop.time() - due
                if late > _LATE_S:
                    self.slipped_s += late
                    due += late
                await asyncio.sleep(max(0.0, due - loop.time()))
                self._controller.tick()
                self._publish(False)

    async def _step_with_credit(self) -> None:
        self._awake.clear()
        if self._credit > 0:
            self._credit -= 1
            self._controller.tick()
            if self._credit == 0 or self._controller.ticks % _TICKS_UNSEEN == 0:
                self._publish(True)
                self._release()
                await asyncio.sleep(0)
            return
        self._controller.idle()
        self._publish(True)
        try:
            await asyncio.wait_for(self._awake.wait(), _IDLE_S)
        except TimeoutError:
            return

    def _release(self, *, everyone: bool = False) -> None:
        """Answer the grants that are used up."""
        ticks = self._controller.ticks
        while self._spent and (everyone or self._spent[0][0] <= ticks):
            _, done = self._spent.pop(0)
            if not done.done():
                done.set_result(None)
