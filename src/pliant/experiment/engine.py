"""Engines that perform trials: spawned processes of this machine, one trial each at a time.

An engine takes jobs and says, in any order, how each ended. It knows which worker holds which
trial, so a death or a time-out costs that trial alone and names it.
"""

import multiprocessing as mp
import signal
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from pliant import signals
from pliant.errors import InputError, described
from pliant.experiment import faults
from pliant.experiment.rows import Rows
from pliant.experiment.work import Job

Work = Callable[[Job], Rows]
STILLBORN_MOST = 10  # workers in a row that are killed before they are ready
BROKEN_MOST = 3  # workers in a row that end by themselves before they are ready
_JOIN_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Ended:
    """The end of a job: with its rows, or with a problem ("worker", "timeout", "error")."""

    job: Job
    rows: Rows | None = None
    problem: str = ""
    message: str = ""


class Engine(Protocol):
    """An engine performs jobs, at most `capacity` in flight."""

    @property
    def capacity(self) -> int: ...
    @property
    def in_flight(self) -> int: ...
    def start(self, job: Job) -> None: ...
    def wait(self, seconds: float) -> list[Ended]:
        """The jobs that ended, after at most `seconds`. Raises InputError if none ever can."""
        ...

    def close(self) -> None:
        """End all workers now; what they were doing is lost."""
        ...


def answer(work: Work, job: Job) -> tuple[str, Any]:
    """Perform a job where nothing may be raised: (kind, rows or message)."""
    try:
        return "rows", work(job)
    except InputError as error:
        return "refused", str(error)
    except (Exception, SystemExit) as error:  # a user's code may raise anything
        return faults.ERROR, described(error)


def ended(job: Job, kind: str, content: Any) -> Ended:
    """Turn an `answer` into the end of its job. Raises InputError for one that every job would
    give."""
    if kind == "refused":
        raise InputError(content)
    if kind == "rows":
        return Ended(job=job, rows=content)
    return Ended(job=job, problem=kind, message=content)


class Local:
    """An engine of spawned worker processes; one that dies or overstays is replaced."""

    def __init__(self, work: Work, *, workers: int, time_limit_s: float) -> None:
        self._work = work
        self._time_limit_s = time_limit_s
        self._context = mp.get_context("spawn")  # fork would copy threads and OpenGL
        self._waiting: deque[Job] = deque()
        self._stillborn = 0
        self._workers = [self._spawn() for _ in range(workers)]

    @property
    def capacity(self) -> int:
        return len(self._workers) + 2  # so that none waits for the driver

    @property
    def in_flight(self) -> int:
        return len(self._waiting) + sum(w.job is not None for w in self._workers)

    def start(self, job: Job) -> None:
        self._waiting.append(job)
        self._hand_out()

    def wait(self, seconds: float) -> list[Ended]:
        now = time.monotonic()
        until = min([now + seconds, *(w.deadline for w in self._workers if w.job is not None)])
        readable = wait([w.connection for w in self._workers], max(0.0, until - now))
        over = [self._heard(w) for w in list(self._workers) if w.connection in readable]
        over += [self._overdue(w) for w in list(self._workers)]
        self._hand_out()
        return [e for e in over if e is not None]

    def close(self) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join(_JOIN_S)
            worker.connection.close()

    def _spawn(self) -> "_Worker":
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(theirs, self._work), daemon=True)
        process.start()
        theirs.close()
        return _Worker(process=process, connection=ours)

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._waiting and worker.ready and worker.job is None:
                job = self._waiting.popleft()
                try:
                    worker.connection.send(job)
                except OSError:  # it has just died: the next wait hears so
                    self._waiting.appendleft(job)
                    continue
                worker.job, worker.deadline = job, time.monotonic() + self._time_limit_s

    def _heard(self, worker: "_Worker") -> Ended | None:
        try:
            kind, content = worker.connection.recv()
        except (EOFError, OSError):
            return self._died(worker)
        if kind == "ready":
            worker.ready, self._stillborn = True, 0
            return None
        job, worker.job = worker.job, None
        assert job is not None, "a worker answers only what it was given"
        return ended(job, kind, content)

    def _died(self, worker: "_Worker") -> Ended | None:
        worker.process.join(_JOIN_S)
        status = worker.process.exitcode
        self._replace(worker)
        if worker.job is not None:
            message = f"the worker process died ({_of_what(status)})"
            return Ended(job=worker.job, problem=faults.WORKER, message=message)
        if not worker.ready:
            self._stillborn += 1
        by_itself = status is not None and status >= 0
        if self._stillborn >= (BROKEN_MOST if by_itself else STILLBORN_MOST):
            raise InputError(
                f"worker processes die as they start ({_of_what(status)}): see the messages"
                " above; a script that runs experiments needs 'if __name__ == \"__main__\":'"
            )
        return None

    def _overdue(self, worker: "_Worker") -> Ended | None:
        if worker.job is None or time.monotonic() < worker.deadline:
            return None
        worker.process.kill()
        worker.process.join(_JOIN_S)
        self._replace(worker)
        message = f"the trial took longer than {self._time_limit_s:g} s"
        return Ended(job=worker.job, problem=faults.TIMEOUT, message=message)

    def _replace(self, worker: "_Worker") -> None:
        worker.connection.close()
        self._workers[self._workers.index(worker)] = self._spawn()


def _of_what(status: int | None) -> str:
    """A worker's exit status in words, with what it means most of the time."""
    often = {-signal.SIGSEGV: ": it crashed", -signal.SIGABRT: ": it crashed"}
    if hasattr(signal, "SIGKILL"):
        often[-signal.SIGKILL] = ": it was killed, as happens where memory runs out"
    return f"exit status {status}{often.get(status or 0, '')}"


@dataclass(kw_only=True, eq=False)
class _Worker:
    """A worker process as the driver knows it."""

    process: mp.process.BaseProcess
    connection: Connection
    ready: bool = False
    job: Job | None = None
    deadline: float = 0.0


def _serve(connection: Connection, work: Work) -> None:
    """Run a worker process: it ends when the driver closes the pipe, or is gone."""
    signals.work_for_parent()
    try:
        connection.send(("ready", None))
        while True:
            connection.send(answer(work, connection.recv()))
    except (EOFError, OSError):
        return
