"""One insertion under every disturbance, judged and recovered by the rules."""

from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

spec = Spec(task=load_task("square"), condition=condition("all"), seed=4, reasoner="rules")
trial = perform(spec, SimCell(), shipped())
for execution in trial.executions:
    print(f"{execution.formation:<9} {execution.verdict.success}  {execution.verdict.reason}")
    if execution.recovery is not None:
        print("          ", execution.recovery.analysis.how)
print(trial.end_reason, "inserted:", trial.inserted)
