"""One insertion under every disturbance, judged and recovered by the rules."""

import pliant

trial = pliant.run(peg="square", condition="all", seed=4)
for execution in trial.executions:
    print(f"{execution.formation:<9} {execution.verdict.success}  {execution.verdict.reason}")
    if execution.recovery is not None:
        print("          ", execution.recovery.analysis.how)
print(trial.end_reason, "inserted:", trial.inserted)
