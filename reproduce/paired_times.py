"""What leaving a mechanism out costs, on the same seeds.

    python reproduce/paired_times.py LADDER ABLATION

LADDER holds the ladder's runs, a folder for each level; ABLATION those of `ablation.sh`. Prints the
table that docs/ladder.md shows.
"""

import sys
from pathlib import Path

import numpy as np

from pliant.experiment.results import read_trials

RESAMPLES = 10_000


def trials(run: Path) -> dict[tuple[str, int], dict[str, object]]:
    """The trials of a run by peg and seed."""
    return {(row["peg"], row["seed"]): row for row in read_trials(run).to_pylist()}


def main() -> None:
    ladder, ablation = (Path(name) for name in sys.argv[1:])
    print("| level | without | n | inserted | mean difference in time [s] | longest trial [s] |")
    print("| --- | --- | --- | --- | --- | --- |")
    for run in sorted(ablation.iterdir()):
        without = trials(run)
        level, _, mechanism = run.name.partition("-")
        whole = {key: row for key, row in trials(ladder / level).items() if key in without}
        times = np.array([[rows[k]["simulated_s"] for k in whole] for rows in (whole, without)])
        differences = np.diff(times, axis=0)[0].astype(float)
        drawn = np.random.default_rng(0).choice(differences, (RESAMPLES, len(differences)))
        low, high = np.percentile(drawn.mean(axis=1), [2.5, 97.5])
        inserted = [
            sum(bool(row["inserted"]) for row in rows.values()) for rows in (whole, without)
        ]
        print(
            f"| {level} | {mechanism} | {len(whole)} | {inserted[0]} → {inserted[1]} |"
            f" {differences.mean():+.1f} [{low:+.1f}, {high:+.1f}] |"
            f" {times[0].max():.0f} → {times[1].max():.0f} |"
        )


if __name__ == "__main__":
    main()
