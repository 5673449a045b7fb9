"""A peg of your own, which is a file: open loop, and with the rules, on the same seeds."""

from pathlib import Path

import pliant
from pliant.sim.cell import SimCell

peg, cell = str(Path(__file__).with_suffix(".yaml")), SimCell()
for reasoner in ("none", "rules"):
    trials = [pliant.run(peg=peg, seed=seed, reasoner=reasoner, cell=cell) for seed in (1, 2, 3)]
    inserted = sum(bool(trial.inserted) for trial in trials)
    print(f"{trials[0].task.peg.name}, {reasoner}: {inserted} of {len(trials)} inserted")
