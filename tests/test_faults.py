"""A reasoner that fails is told from a cell that fails, in one line, and what was done is kept."""

import inspect
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stand_ins import cell_for, verdict_of

from pliant.conditions import condition
from pliant.errors import InputError, RobotFault, described
from pliant.experiment.faults import Heeded, ReasonerFault, is_unmeasured
from pliant.experiment.one import Spec, perform
from pliant.experiment.rows import rows_of
from pliant.experiment.work import attempt
from pliant.records import FailureAnalysis, Recovery
from pliant.task import load_task
from pliant.teaching import shipped

CRASHES = """
from pliant.reasoners.rules import Rules

class Mine(Rules):
    def recover(self, case, verdict):
        return 1 / 0
"""
ANALYSIS = FailureAnalysis(what="a", why="b", how="c", motion={})


def judged(answer: Any) -> Any:
    """What comes of a reasoner whose judge answers so, or raises it."""
    heeded = Heeded(inner=SimpleNamespace(judge=_answering(answer)))
    return heeded.judge(None)  # type: ignore[arg-type]


def recovered(answer: Any) -> Any:
    heeded = Heeded(inner=SimpleNamespace(recover=_answering(answer)))
    return heeded.recover(None, None)  # type: ignore[arg-type]


def _answering(answer: Any) -> Any:
    def ask(*_: object) -> Any:
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return ask


def wrong(field: str, value: object) -> Any:
    verdict = verdict_of(True)
    object.__setattr__(verdict, field, value)
    return verdict


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (ZeroDivisionError("division\nby zero"), "ZeroDivisionError: division by zero ("),
        (SystemExit(3), "SystemExit: 3 ("),
        (RecursionError(), "RecursionError ("),
        (InputError("a step of mine"), "InputError: a step of mine ("),
        (True, "judge answered True, which is no Verdict ("),
        (None, "judge answered None, which is no Verdict ("),
        (wrong("success", np.False_), "success is np.False_, which is no bool ("),
        (wrong("reason", None), "reason is None, which is no str ("),
    ],
)
def test_what_a_judge_does_wrong_is_told_with_the_line_of_the_users_code(
    answer: Any, said: str
) -> None:
    with pytest.raises(ReasonerFault) as caught:
        judged(answer)
    assert said in str(caught.value)
    _, first = inspect.getsourcelines(_answering)
    line = first + (3 if isinstance(answer, BaseException) else 1)
    assert f"{Path(__file__).name}:{line})" in str(caught.value)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (5, "recover answered 5, which is no Recovery"),
        (Recovery(analysis="no", steps=(), by="x"), "analysis is 'no'"),  # type: ignore[arg-type]
        (Recovery(analysis=ANALYSIS, steps=("fit",), by="x"), "'fit', which is no Step"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_recovery_is_told(answer: Any, said: str) -> None:
    with pytest.raises(ReasonerFault, match=said):
        recovered(answer)


def test_right_answers_and_ctrl_c_pass() -> None:
    verdict, recovery = verdict_of(True), Recovery(analysis=ANALYSIS, steps=(), by="x")
    assert judged(verdict) is verdict
    assert recovered(recovery) is recovery
    assert recovered(None) is None
    with pytest.raises(KeyboardInterrupt):
        judged(KeyboardInterrupt())


def test_a_crashing_reasoner_ends_its_trial_as_a_fault_and_what_was_done_is_kept(
    tmp_path: Path,
) -> None:
    own = tmp_path / "mine.py"
    own.write_text(CRASHES, encoding="utf-8")
    task = load_task("circle")
    spec = Spec(task=task, condition=condition("all"), seed=6, reasoner=f"{own}:Mine")
    trial = perform(spec, cell_for("circle"), shipped())
    assert trial.end_reason == "fault:reasoner"
    assert trial.fault == f"ZeroDivisionError: division by zero ({own}:6)"
    assert len(trial.executions) == len(trial.truths) == 2
    row = rows_of(trial).trial
    assert (row["inserted"], row["depth_m"], row["failure_kind"]) == (None, None, "fault")


def test_in_doubt_a_fault_is_an_outcome() -> None:
    assert is_unmeasured("fault:timeout")
    assert not is_unmeasured(RobotFault("protective_stop", "").end_reason)
    assert not is_unmeasured(RobotFault("of_my_own", "").end_reason)
    assert not is_unmeasured("timeout")


def test_a_cell_that_cannot_draw_or_simulate_is_refused_in_one_line() -> None:
    for error in (RuntimeError("no\ncontext"), MemoryError(), ValueError("mesh")):
        cell = SimpleNamespace(prepare=_answering(error))
        spec = Spec(task=load_task("circle"), condition=condition("none"), seed=1, reasoner="rules")
        with pytest.raises(InputError, match="nothing can be simulated or drawn") as caught:
            attempt(cell, spec)
        assert "\n" not in str(caught.value)


def test_an_exception_without_a_trace_is_described_all_the_same() -> None:
    assert described(OSError("gone")) == "OSError: gone"
