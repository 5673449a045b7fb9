"""One recovery: the first failure of a trial is stored, and three reasoners say what to do."""

import tempfile
from pathlib import Path

from pliant.conditions import condition
from pliant.envelope import Limits
from pliant.methods.planar import Planar
from pliant.reasoners import reasoner
from pliant.recovery import admit
from pliant.sim.cell import SimCell
from pliant.store import load_case, save_case
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Question, Run

task, taught, rules = load_task("circle"), shipped(), reasoner("rules")
robot = SimCell().prepare(task, condition("all").draw(1))
run = Run(robot=robot, task=task, teaching=taught, reasoner=rules, method=Planar())
question = next(turn for turn in run.turns() if isinstance(turn, Question))
folder = Path(tempfile.mkdtemp())
save_case(folder, question.case)

case = load_case(folder)  # no robot from here on
verdict = rules.judge(case)
print(f"{case.outcome.step.formation} failed: {verdict.reason}")
for name in ("rules", "messages", "sweep"):
    recovery = reasoner(name).recover(case, verdict)
    assert recovery is not None
    print(f"{name}: {recovery.analysis.what}; {recovery.analysis.how}")
    for step in admit(recovery, case, Limits()).steps:
        print("   ", step)
