"""A reasoner of your own: the rules' judge, and a bolder plan after a failed Fit.

pliant run --reasoner examples/03_your_own_reasoner.py:Bold
"""

from dataclasses import replace

from pliant.formations import Formation, Step
from pliant.pose import Axis
from pliant.reasoners.rules import Rules
from pliant.records import Case, Recovery, Verdict


class Bold(Rules):
    """Moves Fit's goal 6 mm further than the rules would."""

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        planned = super().recover(case, verdict)
        if planned is None or not planned.steps:
            return planned
        first, *rest = planned.steps
        if first.formation is not Formation.FIT or first.retreat:
            return planned
        further = Step(formation=Formation.FIT, goal={Axis.Y: first.goal[Axis.Y] - 0.006})
        told = planned.analysis
        motion = {Axis.Y: told.motion[Axis.Y] - 0.006}
        analysis = replace(told, how=f"{told.how}, and 6 mm further", motion=motion)
        return replace(planned, analysis=analysis, steps=(further, *rest), by="bold")


if __name__ == "__main__":
    import pliant

    trial = pliant.run(reasoner=f"{__file__}:Bold")
    print(trial.end_reason, len(trial.executions), "executions")
