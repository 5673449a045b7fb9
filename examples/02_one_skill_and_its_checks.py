"""Drive the cell yourself: the first three skills, and every check of the last one."""

from collections.abc import Sequence

from pliant.belief import Belief
from pliant.conditions import Setup
from pliant.envelope import Guarded, Limits
from pliant.formations import Formation
from pliant.methods.planar import Planar
from pliant.records import Look
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.measure import measure

task, taught = load_task("circle"), shipped()
cell = SimCell()
robot = Guarded(cell.prepare(task, Setup(seed=0, hole_y=-0.008)), Limits())
method = Planar()
skill = method.skill(task, taught, Limits())


def look(cameras: Sequence[str] = ("side",)) -> Look:
    observation = robot.observe(cameras)
    return Look(observation=observation, scene=measure(observation.views["side"], task))


for formation in (Formation.APPROACH, Formation.CONTACT, Formation.FIT):
    target, step = taught.goals.target(formation), taught.goals.step(formation)
    outcome = skill(robot, look, target, step, Belief())
    print(formation, outcome.stop, f"{outcome.peak_compression_m * 1e3:.1f} mm at most")
for made in method.check(task, outcome, Belief(), taught).checks:
    print(f"{made.name:<12} {made.vote!s:<6} {made.message}")
print("in truth:", cell.truth().fit)
