"""The work of a worker on one trial: perform it in a simulated cell, keep its record if asked."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pliant import store, teaching
from pliant.cell import Workcell
from pliant.errors import InputError, PliantError, described
from pliant.experiment import decides
from pliant.experiment.one import Spec, perform
from pliant.experiment.rows import Rows, lost, rows_of
from pliant.teaching import Teaching

if TYPE_CHECKING:
    from pliant.sim.cell import SimCell


class Save(StrEnum):
    """The choice of trials that keep their full record, in DIR/trials/<id>/."""

    FAILURES = "failures"
    ALL = "all"
    NONE = "none"

    def wants(self, rows: Rows) -> bool:
        return self is Save.ALL or (self is Save.FAILURES and rows.failed)


@dataclass(frozen=True, kw_only=True)
class Job:
    """One trial for a worker, which may be anywhere: every path is absolute. `goals` as in the
    experiment, `folder` the run's. `record` and `replay` are folders with one recording per
    trial. `only_try`: see that such a trial could be performed, no more; what is answered counts
    for nothing."""

    spec: Spec
    goals: str | None
    folder: Path
    save: Save
    record: Path | None = None
    replay: Path | None = None
    expected: Mapping[str, Any] | None = None  # what must be installed where it is performed
    only_try: bool = False


def perform_job(job: Job) -> Rows:
    """Perform a trial. Its record and trajectory are on the disk before its rows are returned.

    Raises:
        InputError: there is no OpenGL, the record cannot be written, or something that decides
            outcomes is another here than where the experiment was planned.
    """
    if job.expected is not None:
        decides.check(job.spec, job.expected)
    cell = _cell()
    if job.only_try:
        attempt(cell, job.spec)
        return lost(job.spec, "tried", "", wall_s=0.0)
    trial = perform(
        job.spec,
        cell,
        _teaching(job.goals),
        record=recording(job.record, job.spec),
        replay=recording(job.replay, job.spec),
    )
    rows = rows_of(trial)
    if job.save.wants(rows):
        from pliant.sim import replay

        folder = store.trial_folder(job.folder, trial.trial_id)
        store.save_trial(folder, trial)
        replay.save(folder, cell.trajectory())
    return rows


def attempt(cell: Workcell, spec: Spec) -> None:
    """Let a simulated cell do a little of all that a trial needs: compile, let the peg come to
    rest, draw.

    Raises:
        InputError: it cannot.
    """
    try:
        cell.prepare(spec.task, spec.condition.draw(spec.seed)).observe()
    except (MemoryError, RuntimeError, ValueError, OSError) as error:
        if isinstance(error, PliantError):
            raise
        raise InputError(f"nothing can be simulated or drawn here: {described(error)}") from error


def recording(folder: Path | None, spec: Spec) -> Path | None:
    return None if folder is None or spec.vlm is None else folder / f"{spec.trial_id}.jsonl"


@lru_cache(maxsize=1)
def _cell() -> "SimCell":
    """The worker's cell, which holds the model of its last task: an experiment goes peg by peg."""
    os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core a worker
    from pliant.sim.cell import SimCell

    return SimCell()


@lru_cache(maxsize=1)
def _teaching(goals: str | None) -> Teaching:
    return teaching.shipped() if goals is None else teaching.load(Path(goals))
