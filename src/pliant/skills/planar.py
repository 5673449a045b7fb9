"""The paper's skills: one straight, position-controlled motion per contact formation (Sec. III).

Approach moves in y, z and roll; Contact and Insertion in z; Fit and Align in y. The soft wrist does
the rest. A step with `retreat` first leaves the hole: straight up, across, and down again.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pliant.belief import Belief
from pliant.cell import Motion, Robot
from pliant.formations import Formation, Step
from pliant.pose import Pose
from pliant.records import Look, Outcome

NAME = "planar"


@dataclass(frozen=True, kw_only=True)
class Planar:
    """How the paper's skills move: speed [m/s], limits and lengths [m], waits [s]."""

    speed_m_s: float = 0.05
    compression_limit_m: float = 0.020  # from free hang
    retreat_z: float = 0.215  # height of the hinge point while travelling
    run_up: float = 0.061  # from touch-down to Fit's goal, as taught
    settle_s: float = 0.6
    approach_settle_s: float = 1.5  # in free hang the wrist swings longer

    def __call__(
        self, robot: Robot, look: Callable[[], Look], target: Pose, step: Step, belief: Belief
    ) -> Outcome:
        """Execute a step: move to `target`, wait, look. A compression stop ends it at once."""
        motions: list[Motion] = []
        for pose in self._poses(robot, target, step):
            motion = robot.move_to(
                pose, speed_m_s=self.speed_m_s, stop_at_compression_m=self.compression_limit_m
            )
            motions.append(motion)
            if motion.stop.is_early:
                break
        hanging = step.formation is Formation.APPROACH
        robot.settle(self.approach_settle_s if hanging else self.settle_s)
        return Outcome(step=step, target=target, motions=tuple(motions), looks=(look(),))

    def _poses(self, robot: Robot, target: Pose, step: Step) -> list[Pose]:
        if not step.retreat:
            return [target]
        here = robot.observe(cameras=()).pose
        height = max(self.retreat_z, here.z, target.z)
        start = target.y + (self.run_up if step.formation is Formation.FIT else 0.0)
        lifted = Pose(x=here.x, y=here.y, z=height, roll=here.roll, pitch=here.pitch, yaw=here.yaw)
        above = Pose(
            x=target.x, y=start, z=height, roll=target.roll, pitch=target.pitch, yaw=target.yaw
        )
        down = Pose(
            x=target.x, y=start, z=target.z, roll=target.roll, pitch=target.pitch, yaw=target.yaw
        )
        return [lifted, above, down] if down == target else [lifted, above, down, target]
