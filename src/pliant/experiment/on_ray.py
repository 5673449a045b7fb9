"""Trials on a Ray cluster. Ray comes with the extra `ray` and is imported only here."""

import importlib
import signal
import socket
from collections.abc import Mapping
from typing import Any

from pliant.errors import InputError
from pliant.experiment import faults
from pliant.experiment.engine import Ended, Work, answer, ended
from pliant.experiment.work import Job

_ANSWER_S = 5.0
_AHEAD = 2  # jobs in flight per core: so that none waits for the driver


class OnRay:
    """An engine that uses a Ray cluster's cores; every node needs pliant, and the run's folder if
    trials are saved.

    Raises:
        InputError: Ray is not installed, or no cluster answers at the address.
    """

    def __init__(self, work: Work, *, address: str, time_limit_s: float) -> None:
        self._ray = _import()
        _see_that_it_answers(address)
        try:
            self._ray.init(address=address, log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise InputError(
                f"the Ray cluster at '{address}' cannot be joined: {str(error).splitlines()[0]}"
            ) from error
        self._work, self._time_limit_s = work, time_limit_s
        # Ray would retry by itself and not say so; the runner counts tries.
        self._remote = self._ray.remote(max_retries=0, num_cpus=1)(_within)
        self._jobs: dict[Any, Job] = {}

    @property
    def capacity(self) -> int:
        cores: Mapping[str, float] = self._ray.cluster_resources()
        return _AHEAD * max(1, int(cores.get("CPU", 1)))

    @property
    def in_flight(self) -> int:
        return len(self._jobs)

    def start(self, job: Job) -> None:
        self._jobs[self._remote.remote(self._time_limit_s, self._work, job)] = job

    def wait(self, seconds: float) -> list[Ended]:
        first, _ = self._ray.wait(list(self._jobs), num_returns=1, timeout=seconds)
        ready, _ = self._ray.wait(list(self._jobs), num_returns=len(self._jobs), timeout=0)
        return [self._ended(ref) for ref in dict.fromkeys([*first, *ready])]

    def close(self) -> None:
        for ref in self._jobs:
            self._ray.cancel(ref, force=True)
        self._ray.shutdown()

    def _ended(self, ref: Any) -> Ended:
        job = self._jobs.pop(ref)
        try:
            kind, content = self._ray.get(ref)
        except self._ray.exceptions.RayError as error:
            first = str(error).strip().splitlines()[0]
            message = f"the worker process died, or overstayed {self._time_limit_s:g} s: {first}"
            return Ended(job=job, problem=faults.WORKER, message=message)
        return ended(job, kind, content)


def _within(time_limit_s: float, work: Work, job: Job) -> tuple[str, Any]:
    """Answer a job in time, or end this process: the system's alarm needs no help from Python."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, time_limit_s)
    try:
        return answer(work, job)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _import() -> Any:
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise InputError(
            "Ray is not installed: run 'pip install \".[ray]\"' in a checkout, or leave out the"
            " address to use this machine's cores"
        ) from error


def _see_that_it_answers(address: str) -> None:
    """Knock at an address with a port first: Ray itself waits for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdecimal():
        return
    try:
        socket.create_connection((host, int(port)), timeout=_ANSWER_S).close()
    except (OSError, OverflowError) as error:
        raise InputError(
            f"no Ray cluster answers at '{address}' ({error}): start one with 'ray start --head',"
            " or leave out the address"
        ) from error
