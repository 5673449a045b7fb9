"""A method of your own: the paper's, but Insertion goes half of its way, looks, and goes on.

pliant run --method examples/12_your_own_method.py:TwoStages
"""

from dataclasses import replace

from pliant.belief import Belief
from pliant.cell import Robot
from pliant.envelope import Limits
from pliant.formations import Formation, Step
from pliant.methods import Skill
from pliant.methods.planar import Planar
from pliant.pose import Axis, Pose
from pliant.records import Looking, Outcome
from pliant.task import Task
from pliant.teaching import Teaching


class TwoStages(Planar):
    """The paper's method, with a look half-way down the hole."""

    name = "two_stages"

    def skill(self, task: Task, teaching: Teaching, limits: Limits) -> Skill:
        whole = super().skill(task, teaching, limits)

        def act(robot: Robot, look: Looking, target: Pose, step: Step, belief: Belief) -> Outcome:
            if step.formation is not Formation.INSERTION:
                return whole(robot, look, target, step, belief)
            half = target.updated({Axis.Z: (robot.observe(()).pose.z + target.z) / 2})
            first = whole(robot, look, half, step, belief)
            if first.stop.is_early:
                return first
            then = whole(robot, look, target, replace(step, retreat=False), belief)
            return replace(
                then,
                step=step,
                motions=(*first.motions, *then.motions),
                looks=(*first.looks, *then.looks),
            )

        return act


if __name__ == "__main__":
    import pliant

    trial = pliant.run(method=f"{__file__}:TwoStages", condition="none")
    print(trial.end_reason, "by", trial.method)
    for look in trial.executions[-1].outcome.looks:
        peg = look.scene.peg
        print("not seen" if peg is None else f"tip {peg.tip_z.value * 1e3:+.1f} mm")
