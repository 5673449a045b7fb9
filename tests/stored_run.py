"""A small stored run for the tests of exports: one trial that is inserted after retries, one that
is not, and one whose seed is held out."""

from pathlib import Path

from stand_ins import cell_for

from pliant.experiment import holdings, plan, results
from pliant.experiment.one import Spec, perform
from pliant.experiment.rows import rows_of
from pliant.records import Trial
from pliant.sim import replay
from pliant.store import save_trial
from pliant.teaching import Teaching

RECOVERED, FAILED, HELD_OUT = (f"L0-circle-all-{who}" for who in ("rules-6", "none-6", "rules-5"))


def store(folder: Path) -> dict[str, Trial]:
    """Perform and store the run as an experiment with `--save all` does."""
    experiment = plan.from_fields(
        {
            "pegs": ["circle"],
            "conditions": ["all"],
            "reasoners": ["rules", "none"],
            "trials": 2,
            "first_seed": 5,
        }
    )
    holdings.prepare(experiment, folder)
    specs = [s for s in experiment.specs() if s.trial_id in (RECOVERED, FAILED, HELD_OUT)]
    trials = [_performed(spec, experiment.teaching(), folder) for spec in specs]
    results.write_rows(folder, [rows_of(trial) for trial in trials])
    return {trial.trial_id: trial for trial in trials}


def _performed(spec: Spec, teaching: Teaching, folder: Path) -> Trial:
    cell = cell_for(spec.task.peg.name)
    trial = perform(spec, cell, teaching)
    kept = folder / "trials" / trial.trial_id
    save_trial(kept, trial)
    replay.save(kept, cell.trajectory())
    return trial
