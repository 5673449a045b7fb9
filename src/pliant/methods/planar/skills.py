"""The paper's skills: one straight, position-controlled motion per contact formation (Sec. IV).

Approach moves in y, z and roll; Contact and Insertion in z; Fit and Align in y. The soft wrist does
the rest. A step with `retreat` first leaves the hole: straight up, across, and down again.
"""

from dataclasses import dataclass, replace

from pliant.belief import Belief
from pliant.cell import Motion, Robot
from pliant.formations import Formation, Goals, Step
from pliant.pose import Pose
from pliant.records import Looking, Outcome
from pliant.wrist import LIMIT_M


@dataclass(frozen=True, kw_only=True)
class PlanarSkills:
    """The paper's skills: the taught goals, from which a retreat takes its height and where it
    comes down; speeds [m/s], limit [m], waits [s]."""

    taught: Goals
    free_speed_m_s: float = 0.05
    contact_speed_m_s: float = 0.02  # slow enough that a dragged tip does not hop
    compression_limit_m: float = LIMIT_M  # from free hang
    settle_s: float = 0.6
    approach_settle_s: float = 1.5  # in free hang the wrist swings longer

    def __call__(
        self, robot: Robot, look: Looking, target: Pose, step: Step, belief: Belief
    ) -> Outcome:
        """Execute a step: move to `target`, wait, look. A compression stop ends it at once."""
        motions: list[Motion] = []
        for pose, speed in self._route(robot, target, step):
            motion = robot.move_to(
                pose, speed_m_s=speed, stop_at_compression_m=self.compression_limit_m
            )
            motions.append(motion)
            if motion.stop.is_early:
                break
        hanging = step.formation is Formation.APPROACH
        robot.settle(self.approach_settle_s if hanging else self.settle_s)
        return Outcome(step=step, target=target, motions=tuple(motions), looks=(look(),))

    def _route(self, robot: Robot, target: Pose, step: Step) -> list[tuple[Pose, float]]:
        """Poses to move through, each with the speed to it [m/s]."""
        free, contact = self.free_speed_m_s, self.contact_speed_m_s
        if not step.retreat:
            return [(target, free if step.formation is Formation.APPROACH else contact)]
        here = robot.observe(cameras=()).pose
        height = max(self.taught.target(Formation.APPROACH).z, here.z, target.z)
        touch_down = self.taught.touch_down_y(step)
        start = target.y if touch_down is None else touch_down
        lifted = replace(here, z=height)
        above = replace(target, y=start, z=height)
        down = replace(target, y=start)
        route = [(lifted, contact), (above, free), (down, contact)]
        return route if down == target else [*route, (target, contact)]
