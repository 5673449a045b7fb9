"""The simulated robot as a stream of set points: each motion is one short straight piece of a
longer one, without ramps, as a controller's servo mode takes them. For the Gymnasium environment.
"""

import math

from pliant.cell import Motion, RobotBehind
from pliant.pose import Pose
from pliant.sim import constants as c
from pliant.sim.cell import SimRobot


class Streamed(RobotBehind):
    """A simulated robot (protocol `pliant.cell.Robot`) whose motions take `period_s` each, or as
    much longer as the speed asks; a motion may be a few millimetres long."""

    def __init__(self, robot: SimRobot, period_s: float) -> None:
        super().__init__(robot)
        self._arm, self._period_s = robot, period_s

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        length = math.dist(pose.position(), self._arm.set_point().position())
        longer = c.CONTROL_PERIOD * math.ceil(length / speed_m_s / c.CONTROL_PERIOD - 1e-6)
        return self._arm.stream_to(
            pose,
            seconds=max(self._period_s, longer),
            stop_at_compression_m=stop_at_compression_m,
        )
