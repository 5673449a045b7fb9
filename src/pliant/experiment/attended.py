"""Trials one after the other, in this process: in a real cell, whose trials need a person, or in an
emulated one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from pliant import signals, store
from pliant.cell import Truth, Workcell
from pliant.errors import InputError, described
from pliant.experiment import faults
from pliant.experiment.cells import Experiment
from pliant.experiment.engine import Ended
from pliant.experiment.one import INTERRUPTED, Spec, perform
from pliant.experiment.rows import rows_of
from pliant.experiment.work import Job, recording
from pliant.records import Execution, Trial

SKIPPED = "fault:skipped"
"""The end reason of a trial that the person leaves for later."""
_ONCE_S = 5.0  # Ctrl-C again within this time is the same one


class Attendant(Protocol):
    """The person at the cell, between trials."""

    def begin(self, spec: Spec) -> None:
        """Tell the person that this trial is the next."""
        ...

    def label(self, trial: Trial, picture: Path) -> bool | None:
        """Whether the peg is inserted, as the person sees it, before the verdict is told; `picture`
        is the last one's file. None: not known yet."""
        ...


class Attended:
    """An engine that keeps every trial's record. Without an attendant nobody has to be asked.

    A trial that the person stopped is none: what it did is kept in the run's folder `aborted`, and
    it is performed again. One that could not even begin ends the experiment.
    """

    capacity = 1

    def __init__(
        self, cell: Workcell, experiment: Experiment, attendant: Attendant | None = None
    ) -> None:
        """Load the experiment's goals. Raises InputError when they cannot be used."""
        self._cell, self._attendant = cell, attendant
        self._teaching, self._where = experiment.teaching(), experiment.where
        self._job: Job | None = None

    @property
    def in_flight(self) -> int:
        return int(self._job is not None)

    def start(self, job: Job) -> None:
        self._job = job

    def wait(self, seconds: float) -> list[Ended]:
        """Perform the trial that was started, however long it takes; raises as `perform`."""
        job, self._job = self._job, None
        if job is None:
            return []
        try:
            trial = self.perform(
                job.spec,
                job.folder,
                record=recording(job.record, job.spec),
                replay=recording(job.replay, job.spec),
            )
        except InputError:
            raise
        except Exception as error:  # a user's cell may raise anything
            return [Ended(job=job, problem=faults.ERROR, message=described(error))]
        return [] if trial is None else [Ended(job=job, rows=rows_of(trial))]

    def close(self) -> None:
        """Do nothing: the cell is its owner's to close."""

    @signals.once(_ONCE_S)
    def perform(
        self,
        spec: Spec,
        folder: Path,
        *,
        record: Path | None = None,
        replay: Path | None = None,
        on_execution: Callable[[Execution, Truth], None] | None = None,
    ) -> Trial | None:
        """Perform one trial and store it in the run's `folder`, with its label; None: left for
        later. The rest is as for `one.perform`.

        Raises:
            KeyboardInterrupt: the person stopped; it says where the trial is kept, if it had begun.
            InputError: the cell cannot be prepared, or the record cannot be written.
        """
        if self._attendant is not None:
            self._attendant.begin(spec)
        trial = perform(
            spec,
            self._cell,
            self._teaching,
            limits=self._where.limits,
            colours=self._where.colours,
            on_execution=on_execution,
            record=record,
            replay=replay,
        )
        has_begun = bool(trial.executions) or trial.aborted is not None
        if trial.end_reason == SKIPPED:
            return None
        if trial.end_reason == INTERRUPTED:
            if not has_begun:
                raise KeyboardInterrupt
            kept = store.free_folder(folder / store.ABORTED, trial.trial_id)
            store.save_trial(kept, trial)
            raise KeyboardInterrupt(f"what was done of the trial is kept in '{kept}'")
        if not has_begun:
            raise InputError(
                f"the cell cannot be prepared: {trial.fault}; see to it, and the same command goes"
                " on"
            )
        return self._kept(store.trial_folder(folder, trial.trial_id), trial)

    def _kept(self, folder: Path, trial: Trial) -> Trial:
        """Store the trial, first without its label and then, once the person was asked, with it."""
        store.save_trial(folder, trial)
        if self._attendant is None or not trial.truths:
            return trial
        named = labelled(trial, self._attendant.label(trial, last_picture(folder, trial)))
        store.save_trial(folder, named)
        return named


def labelled(trial: Trial, inserted: bool | None) -> Trial:
    """The trial with a person's label on the last thing that was seen in it."""
    if not trial.truths:
        return trial
    *before, last = trial.truths
    return replace(trial, truths=(*before, replace(last, inserted=inserted)))


def last_picture(folder: Path, trial: Trial) -> Path:
    """The last side picture's file in a trial's folder."""
    image = trial.executions[-1].outcome.looks[-1].observation.views["side"].image
    return store.Pictures(folder / store.PICTURES).path(image)
