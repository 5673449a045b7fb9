"""Faults: which of them are outcomes, and what is said of one.

A fault ends a trial before it has come to its own end. Whether it then says anything of the method
is decided here and nowhere else. What the arm did, or what a person stopped because of it, is an
outcome: a protective stop, a pose that cannot be reached, a peg that was lost, an emergency stop,
and every kind that this list does not name. The trial counts as not inserted, and nobody may draw
again until it fits. Where the program, the machine or the wiring gave way, nothing was measured:
such a trial is in no rate and in no n, is counted beside them, and may be repeated.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pliant.errors import PliantError, described, line_of, users_frames
from pliant.formations import Step
from pliant.records import Case, FailureAnalysis, Probe, Recovery, Verdict
from pliant.recovery import Inquirer, Reasoner

PREFIX = "fault:"
REASONER, ERROR, WORKER, TIMEOUT = "reasoner", "error", "worker", "timeout"
UNMEASURED: Mapping[str, str] = {
    REASONER: "the reasoner raised something, or answered what is no answer",
    ERROR: "the program raised something",
    WORKER: "the process died, as where memory runs out",
    TIMEOUT: "the trial took longer than it may",
    "connection": "the network or the controller was gone",
    "stalled": "the controller sent no new time stamp",
    "driver": "the driver's process crashed or hung",
    "camera": "no picture came in time",
    "safeguard_stop": "a door or a scanner",
}
"""The kinds of fault after which nothing of the method was measured."""

_SHOWN = 60  # [characters] of a wrong answer


def is_fault(trial: Mapping[str, Any]) -> bool:
    """Whether a row of trials.parquet is of a trial in which nothing was measured."""
    return is_unmeasured(str(trial.get("end_reason")))


def is_unmeasured(end_reason: str) -> bool:
    """Whether a trial with this end reason says nothing of the method."""
    return end_reason.startswith(PREFIX) and end_reason.removeprefix(PREFIX) in UNMEASURED


def told(trial: Mapping[str, Any]) -> str:
    """The end of a faulted trial with what was said: "fault:timeout: it took longer than ..."."""
    end, said = str(trial["end_reason"]), trial.get("fault")
    return f"{end}: {said}" if said else end


def by_text(trials: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The texts of faulted trials and how often each occurs, the commonest first."""
    counts = Counter(told(trial) for trial in trials)
    return [{"text": text, "n": n} for text, n in counts.most_common()]


class ReasonerFault(PliantError):
    """The error that a reasoner raised something, or answered what is no answer."""


@dataclass(frozen=True, kw_only=True)
class Heeded:
    """A reasoner whose failures are told from everybody else's: they are raised as ReasonerFault.
    What pliant itself raises on purpose, and Ctrl-C, pass."""

    inner: Reasoner

    @property
    def name(self) -> str:
        return self.inner.name

    def judge(self, case: Case) -> Verdict:
        with _heeded():
            verdict = self.inner.judge(case)
        where = self.inner.judge
        _see(verdict, Verdict, "judge answered", where)
        for name, kind in (("success", bool), ("reason", str), ("by", str)):
            _see(getattr(verdict, name), kind, f"the verdict's {name} is", where)
        return verdict

    def inquire(self, case: Case, verdict: Verdict) -> Probe | None:
        if not isinstance(self.inner, Inquirer):
            return None
        with _heeded():
            probe = self.inner.inquire(case, verdict)
        if probe is not None:
            where = self.inner.inquire
            _see(probe, Probe, "inquire answered", where)
            _see(probe.reason, str, "the probe's reason is", where)
        return probe

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        with _heeded():
            recovery = self.inner.recover(case, verdict)
        where = self.inner.recover
        if recovery is None:
            return None
        _see(recovery, Recovery, "recover answered", where)
        _see(recovery.analysis, FailureAnalysis, "the recovery's analysis is", where)
        for name in ("what", "why", "how"):
            _see(getattr(recovery.analysis, name), str, f"the analysis's {name} is", where)
        _see(recovery.steps, Sequence, "the recovery's steps are", where)
        for step in recovery.steps:
            _see(step, Step, "a step of the recovery is", where)
        return recovery


@contextmanager
def _heeded() -> Iterator[None]:
    try:
        yield
    except (Exception, SystemExit) as error:  # a user's reasoner may raise anything
        if isinstance(error, PliantError) and not users_frames(error):
            raise
        raise ReasonerFault(described(error)) from error


def _see(found: object, kind: type, what: str, where: object) -> None:
    """Refuse an answer of a reasoner that could not be acted upon, or not be stored."""
    if isinstance(found, kind):
        return
    code = getattr(where, "__code__", None)
    place = f" ({line_of(code.co_filename, code.co_firstlineno)})" if code is not None else ""
    shown = repr(found)
    shown = shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}…"
    raise ReasonerFault(f"{what} {shown}, which is no {kind.__name__}{place}")
