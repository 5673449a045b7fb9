"""Run an experiment into a folder: resumable, on local processes or on a Ray cluster.

The journal is the truth: a trial is finished when its line is on the disk. Whatever dies, the same
command goes on from there, and the results do not depend on who performed what, or when.
"""

import os
import re
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from pliant import store
from pliant.errors import InputError
from pliant.experiment import faults, holdings, journal, measures, results
from pliant.experiment.cells import Experiment
from pliant.experiment.engine import Ended, Engine, Local, Work
from pliant.experiment.places import Places
from pliant.experiment.progress import Silent, Watcher
from pliant.experiment.rows import Rows, decided, lost
from pliant.experiment.work import Job, Save, perform_job
from pliant.own import own_file
from pliant.paths import located
from pliant.reasoners import refuse_silent

TRIES = 3
LOST = (faults.WORKER, faults.TIMEOUT)  # problems that another try may not have
ALIKE = 3  # of the first trials: when all are faults, and the same, so would the rest be
AGAIN = "--again faults"
TIME_LIMIT_S = 600.0
_LOOK_S = 0.5


@dataclass(frozen=True, kw_only=True)
class Finished:
    """The result of a call of `run`: trials in all, finished by now, before it began, and of those
    finished the ones in which nothing was measured. Not `complete`: it was `interrupted`, or trials
    were left for later, and the same call goes on."""

    total: int
    done: int
    resumed: int
    faults: int
    interrupted: bool = False

    @property
    def complete(self) -> bool:
        return self.done == self.total


def run(
    experiment: Experiment,
    folder: Path,
    *,
    workers: int | None = None,
    ray: str | None = None,
    save: Save = Save.NONE,
    time_limit_s: float = TIME_LIMIT_S,
    watcher: Watcher | None = None,
    record: Path | None = None,
    replay: Path | None = None,
    work: Work = perform_job,
    engine: Engine | None = None,
    again: bool = False,
    fallback_from_start: bool = False,
) -> Finished:
    """Perform what is missing of an experiment in `folder`, then write its Parquet files.

    `workers` None: every core. `ray`: a cluster's address instead; its nodes must share `folder`
    if trials are saved. A trial that outlasts `time_limit_s` or kills its worker is tried three
    times in all, then recorded as `fault:timeout` or `fault:worker`. Ctrl-C ends it early. `record`
    and `replay` are folders for the conversations with a VLM, a file per trial. `engine` performs
    the trials in place of processes or a cluster, and is closed in the end. `again` repeats the
    trials in which nothing was measured (`faults` says which): each one's line is replaced when it
    has ended, and nothing else is touched.

    In a simulated cell physics and drawing are tried first, where the trials will be performed. So
    is every model that is yet to be asked, with one small request, unless `fallback_from_start`
    lets the rules decide where it is refused.

    Raises:
        InputError: the folder holds something else, another configuration, or a damaged journal;
            something cannot be written; no worker can start; the cluster does not answer; a model
            cannot be made; nothing can be simulated or drawn; the first trials were all the same
            fault.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}: it must be at least 1")
    if not time_limit_s > 0:
        raise InputError(f"the time limit is {time_limit_s:g} s: it must be above 0")
    if replay is None:
        experiment.check_models()
    folder = located(folder)  # a worker's current folder may be another
    record, replay = (None if path is None else located(path) for path in (record, replay))
    goals = None if experiment.goals is None else str(located(experiment.goals))
    if again and not (folder / store.RUN).exists():
        raise InputError(
            f"'{folder}' holds no experiment, so there is nothing to repeat: leave {AGAIN} out, or"
            " name its folder (--out)"
        )
    expected = experiment.expected  # as planned: a file may be changed while it runs
    holdings.prepare(experiment, folder, grows=True)
    path = folder / journal.FILE
    with journal.Journal(path) as book, watcher or Silent() as seen:
        place, faulted, unkept = Places(experiment, holdings.held(folder)), dict[str, str](), 0
        for entry in journal.scan(path):
            cell = place.put(entry.trial_id, entry.offset, path)
            if cell is None:
                continue
            if entry.fault:
                faulted[entry.trial_id] = entry.fault
            if not (entry.fault and again):
                seen.known(cell, entry.inserted, entry.fault)
                unkept += engine is None and _lacks_record(folder, entry, save)
        repeated = set(faulted) if again else set()
        for trial_id in repeated:
            place.forget(trial_id, path)
            del faulted[trial_id]
        resumed = place.done
        if book.torn:
            seen.say(f"journal: dropped a half-written last line ({book.torn} bytes)")
        if resumed:
            seen.say(f"resuming: {resumed} of {len(experiment)} trials are there")
        if unkept:
            seen.say(_without_record(unkept, save))
        if again:
            seen.say(f"repeating {_count(len(repeated))}" if repeated else "no faults to repeat")
        elif faulted:
            seen.say(f"{_count(len(faulted))} among them: {AGAIN} repeats such trials")
        jobs = (
            Job(
                spec=spec,
                goals=goals,
                folder=folder,
                save=save,
                record=record,
                replay=replay,
                expected=expected.get((spec.reasoner, spec.method)),
            )
            for spec in place.missing_of(experiment)
        )
        if replay is None and not fallback_from_start:
            asked = (spec.vlm for spec in place.missing_of(experiment) if spec.vlm is not None)
            for settings in dict.fromkeys(asked):
                refuse_silent(settings, seen.say)
        silent = _Silent(experiment, seen.say)
        interrupted = False
        first = _First(min(ALIKE, len(experiment) - resumed))
        if resumed < len(experiment):
            try:
                used = engine or _engine(work, workers, ray, time_limit_s, place)
                with closing(used):
                    begun = jobs if engine is not None else _tried(used, jobs)
                    begun = _set_apart(begun, repeated)
                    for rows in _perform(used, begun, experiment.where.kind):
                        name, fault = rows.trial_id, ""
                        if faults.is_fault(rows.trial):
                            fault = faulted[name] = faults.told(rows.trial)
                        offset = 0
                        if name in repeated:
                            book.replace(rows)
                        else:
                            offset = book.append(rows)
                        cell = place.put(name, offset, path)
                        assert cell is not None, "only what is asked for is performed"
                        seen.finished(cell, rows.trial["inserted"], fault)
                        silent.tell(cell, rows)
                        if first.are_all(fault):
                            break
            except KeyboardInterrupt as stop:
                interrupted = True
                seen.say("interrupted: what is finished is kept; the same command goes on")
                for where in stop.args:
                    seen.say(str(where))
        if repeated:  # the lines behind theirs have moved
            place.find_again(path)
        if place.done == len(experiment):
            results.write(folder, path, place.finished)
    if first.stopped:
        raise InputError(
            f"stopped: the first {first.n} trials were all the same fault: {first.stopped};"
            f" {advice(experiment)}"
        )
    return Finished(
        total=len(experiment),
        done=place.done,
        resumed=resumed,
        faults=len(faulted),
        interrupted=interrupted,
    )


def advice(experiment: Experiment) -> str:
    """What to do about faults, in words: a changed file of the user's own needs a new folder."""
    repeats = f"the same command with {AGAIN} repeats them"
    if any(own_file(name) for c in experiment.cells for name in (c.reasoner, c.method)):
        return (
            "mend the cause: with a change to a file of your own the whole experiment goes into"
            f" another folder (--out), and without one {repeats}"
        )
    return f"mend the cause, and {repeats}"


class _Silent:
    """Say, once for each cell, that a model decided nothing in a whole trial, and why."""

    def __init__(self, experiment: Experiment, say: Callable[[str], None]) -> None:
        self._experiment, self._say = experiment, say
        self._said: set[int] = set()

    def tell(self, cell: int, rows: Rows) -> None:
        if cell in self._said or not measures.is_undecided(measures.model_share([rows.trial])):
            return
        self._said.add(cell)
        names = ("verdict_fallback", "recovery_fallback")
        causes = (row[name] for row in rows.executions for name in names if row.get(name))
        why = next(causes, "it gave no usable answer")
        who = ", ".join(self._experiment.cells[cell].names)
        self._say(f"{who}: {decided(rows.trial)} in trial '{rows.trial_id}': {why}")


class _First:
    """A check whether the first `n` trials that ended were all the same fault: then `stopped` says
    it."""

    def __init__(self, n: int) -> None:
        self.n, self.stopped = n, ""
        self._texts: list[str] | None = []

    def are_all(self, fault: str) -> bool:
        """Tell how the next trial ended (empty: with no fault), and return whether all were that
        fault."""
        if self._texts is None:
            return False
        self._texts.append(re.sub(r"0x[0-9a-f]+|\d+", "#", fault))
        if not fault or self._texts[0] != self._texts[-1]:
            self._texts = None
        elif len(self._texts) == self.n:
            self._texts, self.stopped = None, fault
        return bool(self.stopped)


def _lacks_record(folder: Path, entry: journal.Entry, save: Save) -> bool:
    """Whether a finished trial has no record that `save` would have kept."""
    is_wanted = save is Save.ALL or (save is Save.FAILURES and entry.inserted is not True)
    return is_wanted and not (store.trial_folder(folder, entry.trial_id) / store.TRIAL).is_file()


def _without_record(unkept: int, save: Save) -> str:
    trials = "1 finished trial has" if unkept == 1 else f"{unkept} finished trials have"
    return (
        f"{trials} no record, which --save {save.value} keeps only of trials that are run now: for"
        " theirs, run the experiment anew into another folder (--out)"
    )


def _count(faulted: int) -> str:
    return "1 fault" if faulted == 1 else f"{faulted} faults"


def _set_apart(jobs: Iterator[Job], repeated: set[str]) -> Iterator[Job]:
    """Pass on the jobs; what was kept of a trial that is repeated is moved to the run's
    `aborted`."""
    for job in jobs:
        if job.spec.trial_id in repeated:
            store.set_apart(job.folder, job.spec.trial_id)
        yield job


def _tried(engine: Engine, jobs: Iterator[Job]) -> Iterator[Job]:
    """Pass on the jobs, after what they need was tried by the engine's own kind of process.

    Raises:
        InputError: it failed.
    """
    first, tries = next(jobs), 0
    engine.start(replace(first, only_try=True))
    while engine.in_flight:
        for over in engine.wait(_LOOK_S):
            tries += 1
            if over.problem in LOST and tries < TRIES:
                engine.start(over.job)
            elif over.problem:
                raise InputError(
                    f"no trial can be performed here: {over.message}; see to it, and the same"
                    " command goes on"
                )
    return chain([first], jobs)


def _engine(
    work: Work, workers: int | None, ray: str | None, time_limit_s: float, place: Places
) -> Engine:
    if ray is not None:
        from pliant.experiment.on_ray import OnRay

        return OnRay(work, address=ray, time_limit_s=time_limit_s)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    most = workers or cores or 1
    return Local(work, workers=min(most, place.missing), time_limit_s=time_limit_s)


def _perform(engine: Engine, jobs: Iterator[Job], cell: str) -> Iterator[Rows]:
    """Perform jobs and give the rows of trials as they end. One that was lost is tried again after
    all others. `cell` is the workcell's kind."""
    again: deque[Job] = deque()
    tries: Counter[str] = Counter()
    while True:
        while engine.in_flight < engine.capacity:
            job = next(jobs, None) or (again.popleft() if again else None)
            if job is None:
                break
            engine.start(job)
        if not engine.in_flight:
            return
        for over in engine.wait(_LOOK_S):
            name = over.job.spec.trial_id
            if over.problem in LOST:
                tries[name] += 1
            if over.problem in LOST and tries[name] < TRIES:
                again.append(over.job)
            else:
                yield _rows(over, tries.pop(name, 0), cell)


def _rows(over: Ended, tries: int, cell: str) -> Rows:
    if over.rows is not None:
        return over.rows
    message = f"{over.message}, {tries} times" if tries else over.message
    return lost(over.job.spec, over.problem, message, wall_s=0.0, cell=cell)
