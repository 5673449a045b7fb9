"""A check of your own: after Align, does the wrist hang freely again, or does something hold it?

pliant run --method examples/11_your_own_check.py:SpringsBack
"""

from dataclasses import replace

from pliant.belief import Belief
from pliant.formations import Formation
from pliant.methods.planar import Planar
from pliant.records import Check, Evidence, Outcome
from pliant.task import Task
from pliant.teaching import Teaching

HELD_M = 0.004  # of compression at rest


class SpringsBack(Planar):
    """The paper's method, with one more check. It votes beside the others: where they do not agree
    the verdict names the conflict."""

    name = "springs_back"

    def check(self, task: Task, outcome: Outcome, belief: Belief, teaching: Teaching) -> Evidence:
        evidence = super().check(task, outcome, belief, teaching)
        if outcome.step.formation is not Formation.ALIGN:
            return evidence
        rest_m = outcome.looks[-1].observation.compression_m
        own = Check(
            name="springs_back",
            vote=abs(rest_m) < HELD_M,
            message=f"{rest_m * 1e3:+.1f} mm of compression at rest",
            paper=False,
        )
        return replace(evidence, checks=(*evidence.checks, own))


if __name__ == "__main__":
    import pliant

    for execution in pliant.run(method=f"{__file__}:SpringsBack", seed=3).executions:
        check = execution.evidence["springs_back"]
        if check is not None:
            print(f"{execution.formation}: {check.message}, vote {check.vote};", end=" ")
            print("conflict:", execution.verdict.conflict)
