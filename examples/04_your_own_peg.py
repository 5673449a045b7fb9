"""A peg of your own, which is a file: open loop, and with the rules, on the same seeds."""

from pathlib import Path

from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

task = load_task(str(Path(__file__).with_suffix(".yaml")))
cell, taught = SimCell(), shipped()
for reasoner in ("none", "rules"):
    specs = (
        Spec(task=task, condition=condition("all"), seed=seed, reasoner=reasoner)
        for seed in range(1, 4)
    )
    inserted = [perform(spec, cell, taught).inserted for spec in specs]
    print(f"{task.peg.name}, {reasoner}: {sum(map(bool, inserted))} of {len(inserted)} inserted")
