"""How steeply the baseline depends on Fit's goal: open loop, with the taught goal shifted.

    python reproduce/fit_sensitivity.py OUT [--trials 50]

Writes a run per shift into OUT and prints the table that docs/assumptions.md shows.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from pliant import teaching
from pliant.experiment import plan, results, runner
from pliant.experiment.statistics import wilson
from pliant.formations import Formation, Step
from pliant.pose import Axis

SHIFTS_MM = (-5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5)
CONDITIONS = ("friction", "all")


def shifted_goals(path: Path, shift_mm: float) -> float:
    """Write the shipped goals with Fit shifted; return Fit's goal [mm]."""
    shipped = teaching.shipped()
    y = shipped.goals.formations[Formation.FIT][Axis.Y] + shift_mm * 1e-3
    goals = shipped.goals.updated(Step(formation=Formation.FIT, goal={Axis.Y: y}))
    teaching.save(path, replace(shipped, goals=goals))
    return y * 1e3


def cell(trials: list[bool]) -> str:
    interval = wilson(sum(trials), len(trials))
    percent = 100 * sum(trials) / len(trials)
    return f"{percent:.0f} [{100 * interval.low:.0f}, {100 * interval.high:.0f}]"


def main(out: Path, trials: int) -> None:
    print(f"| Fit's goal, y [mm] | {' | '.join(CONDITIONS)} |")
    print("|---|" + "---|" * len(CONDITIONS))
    for shift in SHIFTS_MM:
        goals = out / f"goals{shift:+d}" / "goals.yaml"
        y = shifted_goals(goals, shift)
        folder = out / f"fit{shift:+d}"
        experiment = plan.from_fields(
            {
                "pegs": ["circle"],
                "conditions": list(CONDITIONS),
                "reasoners": ["none"],
                "trials": trials,
                "goals": str(goals),
            }
        )
        runner.run(experiment, folder)
        rows = results.read_trials(folder).select(["condition", "inserted"]).to_pylist()
        cells = [cell([r["inserted"] for r in rows if r["condition"] == c]) for c in CONDITIONS]
        print(f"| {y:.1f} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--trials", type=int, default=50)
    arguments = parser.parse_args()
    main(arguments.out, arguments.trials)
