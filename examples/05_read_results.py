"""Run a small experiment, then read its results."""

import tempfile
from pathlib import Path

import pyarrow.compute as pc

import pliant

if __name__ == "__main__":  # workers are spawned: they import this file
    folder = Path(tempfile.mkdtemp()) / "run"
    trials = pliant.compare(reasoners=["rules", "none"], trials=4, out=folder).trials
    for reasoner in ("rules", "none"):
        rows = trials.filter(pc.equal(trials["reasoner"], reasoner))
        print(reasoner, rows["inserted"].to_pylist(), rows["extra_fit"].to_pylist())
