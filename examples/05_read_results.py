"""Run a small experiment, then read its Parquet files."""

import tempfile
from pathlib import Path

import pyarrow.compute as pc

from pliant.experiment import plan, results, runner

if __name__ == "__main__":  # workers are spawned: they import this file
    folder = Path(tempfile.mkdtemp()) / "run"
    experiment = plan.from_fields(
        {"pegs": ["circle"], "conditions": ["all"], "reasoners": ["rules", "none"], "trials": 4}
    )
    runner.run(experiment, folder)
    trials = results.read_trials(folder)
    for reasoner in ("rules", "none"):
        rows = trials.filter(pc.equal(trials["reasoner"], reasoner))
        print(reasoner, rows["inserted"].to_pylist(), rows["extra_fit"].to_pylist())
