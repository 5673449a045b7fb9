"""The simulated robot as a stream of set points: each motion is one short straight piece of a
longer one, without ramps, as a controller's servo mode takes them. For the Gymnasium environment.
"""

import math
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from pliant.cell import Motion, Observation
from pliant.pose import Pose
from pliant.sim import constants as c
from pliant.sim.cell import SimRobot


class Streamed:
    """A simulated robot (protocol `pliant.cell.Robot`) whose motions take `period_s` each, or as
    much longer as the speed asks; a motion may be a few millimetres long."""

    def __init__(self, robot: SimRobot, period_s: float) -> None:
        self._robot = robot
        self._period_s = period_s

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._robot.halt()

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        length = math.dist(pose.position(), self._robot.set_point().position())
        longer = c.CONTROL_PERIOD * math.ceil(length / speed_m_s / c.CONTROL_PERIOD - 1e-6)
        return self._robot.stream_to(
            pose,
            seconds=max(self._period_s, longer),
            stop_at_compression_m=stop_at_compression_m,
        )

    def settle(self, seconds: float) -> None:
        self._robot.settle(seconds)

    def tare(self) -> None:
        self._robot.tare()

    def clock(self) -> float:
        return self._robot.clock()

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        return self._robot.observe(cameras)

    def halt(self) -> None:
        self._robot.halt()
