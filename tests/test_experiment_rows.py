"""A trial's rows say what happened, and of what kind a failure was."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest
from stand_ins import case_after, executed, goal_step, outcome_of, recovery_of

from pliant.cell import Stop, Truth
from pliant.conditions import NOMINAL, condition
from pliant.experiment import results
from pliant.experiment.columns import EXECUTIONS, TRIALS, dictionary, schema
from pliant.experiment.one import Spec
from pliant.experiment.rows import Rows, lost, rows_of
from pliant.experiment.success import TRIAL_KINDS, trial_kind
from pliant.formations import Formation
from pliant.pose import Axis
from pliant.records import Admission, End, Exchange, Execution, Trial
from pliant.task import load_task
from pliant.teaching import shipped

DOCUMENT = Path(__file__).parents[1] / "docs" / "data.md"
OUT, SHORT, IN_HOLE, DEEP = -0.03, 0.03, 0.0, 0.02


def truth(tip_y: float = 0.0, *, depth: float = 0.0, fit: bool = False) -> Truth:
    return Truth(
        inserted=depth >= 0.01,
        depth_m=depth,
        tip=(0.0, tip_y, -depth),
        tilt_rad=0.0,
        hole_y=0.001,
        compression_m=0.0,
        fit=fit,
    )


BEFORE, BEYOND = truth(SHORT), truth(OUT)
SEATED, INSIDE = truth(depth=0.004, fit=True), truth(depth=DEEP, fit=True)


def execution(formation: Formation, success: bool = False, stop: Stop = Stop.REACHED) -> Execution:
    return executed(case_after(outcome_of(formation, stop=stop)), success)


def trial(*done: tuple[Execution, Truth], end: str = End.EXHAUSTED, known: bool = True) -> Trial:
    return Trial(
        trial_id="L0-circle-all-rules-1",
        task=load_task("circle"),
        level="L0",
        condition="all",
        seed=1,
        reasoner="rules",
        model=None,
        goals=shipped().goals,
        executions=tuple(replace(e, index=i) for i, (e, _) in enumerate(done)),
        end_reason=end,
        fault="",
        simulated_s=10.0,
        wall_s=0.1,
        drawn=dict(NOMINAL),
        truths=tuple(t for _, t in done) if known else (),
    )


FIT, ALIGN = execution(Formation.FIT), execution(Formation.ALIGN)
PUSH, STOPPED = (
    execution(Formation.INSERTION),
    execution(Formation.INSERTION, stop=Stop.COMPRESSION),
)
DONE = execution(Formation.INSERTION, success=True)


@pytest.mark.parametrize(
    ("kind", "failed"),
    [
        (None, trial((FIT, SEATED), (DONE, INSIDE), end=End.INSERTED)),
        ("false_accept", trial((FIT, SEATED), (DONE, SEATED), end=End.INSERTED)),
        ("false_reject", trial((FIT, SEATED), (PUSH, INSIDE))),
        ("gave_up", trial((FIT, BEFORE), end=End.STOPPED)),
        ("gave_up", trial((execution(Formation.APPROACH), BEFORE))),
        ("missed_edge", trial((FIT, BEFORE), (STOPPED, BEYOND), end=End.FINISHED)),
        ("overshot", trial((FIT, BEYOND), (STOPPED, BEFORE), end=End.FINISHED)),
        ("missed_edge", trial((FIT, BEYOND), (FIT, SEATED), (ALIGN, BEFORE))),
        ("wedged", trial((FIT, BEFORE), (FIT, SEATED), (PUSH, SEATED))),
        ("compression_stop", trial((FIT, SEATED), (STOPPED, SEATED))),
        ("cell_fault", trial((FIT, SEATED), (PUSH, INSIDE), end="fault:unreachable")),
        ("fault", trial((FIT, SEATED), (PUSH, INSIDE), end="fault:camera")),
        (None, trial((FIT, SEATED), (PUSH, SEATED), known=False)),
    ],
)
def test_a_failures_kind_follows_from_the_truth(kind: str | None, failed: Trial) -> None:
    assert trial_kind(failed) == kind
    assert kind is None or kind in TRIAL_KINDS


def test_executions_beyond_the_first_are_extra() -> None:
    ran = trial((FIT, BEFORE), (FIT, SEATED), (ALIGN, SEATED), (FIT, SEATED), (ALIGN, SEATED))
    row = rows_of(ran).trial
    assert (row["extra_fit"], row["extra_align"], row["extra_insertion"]) == (2, 1, 0)
    assert (row["executions"], row["moves"], row["depth_m"]) == (5, 5, 0.004)


def test_an_execution_keeps_its_plan_and_what_it_cost() -> None:
    exchange = Exchange(
        stage="judge",
        request="?",
        reply="!",
        model="m",
        input_tokens=5,
        output_tokens=2,
        latency_s=0.5,
        cost_usd=0.01,
    )
    steps = (goal_step(Formation.FIT, -0.002, retreat=True), goal_step(Formation.ALIGN))
    planned = replace(
        FIT,
        verdict=replace(FIT.verdict, exchanges=(exchange,)),
        recovery=replace(recovery_of(*steps), exchanges=(exchange,)),
        admission=Admission(steps=steps[:1], refusals=("align: no",)),
    )
    first, second = rows_of(trial((planned, BEFORE), (FIT, SEATED))).executions
    assert [s["formation"] for s in first["proposed"]] == ["fit", "align"]
    assert first["proposed"][0]["goal"] == {"y_m": steps[0].goal[Axis.Y]}
    assert first["proposed"][0]["retreat"] is True
    assert (len(first["admitted"]), first["refusals"]) == (1, ["align: no"])
    assert (first["tokens"], first["latency_s"], first["cost_usd"]) == (14, 1.0, 0.02)
    assert "proposed" not in second
    assert second["cost_usd"] is None


def test_rows_fit_the_schemas_and_survive_json_and_parquet(tmp_path: Path) -> None:
    rows = rows_of(trial((FIT, BEFORE), (STOPPED, SEATED)))
    spec = Spec(task=load_task("circle"), condition=condition("all"), seed=2, reasoner="rules")
    dead = lost(spec, "worker", "the worker process died", 0.0)
    for row, columns in ((rows.trial, TRIALS), (dead.trial, TRIALS)):
        assert list(row) == [c.name for c in columns]
    for row in rows.executions:
        assert set(row) <= {c.name for c in EXECUTIONS}
    again = json.loads(json.dumps([rows.trial, rows.executions], allow_nan=False))
    results.write_rows(tmp_path, [Rows(trial=again[0], executions=again[1]), dead])
    read = results.read_trials(tmp_path)
    assert read.to_pylist() == [rows.trial, dead.trial]
    assert read.schema.field("depth_m").metadata[b"unit"] == b"m"
    (executions,) = results.each_trials_executions(tmp_path)
    assert executions[1]["stop"] == "compression"
    assert executions[0]["truth_tip_y_m"] == SHORT
    assert executions[0]["proposed"] is None


def test_a_lost_trial_keeps_what_was_drawn_and_claims_nothing() -> None:
    spec = Spec(task=load_task("square"), condition=condition("all"), seed=4, reasoner="rules")
    row = lost(spec, "timeout", "too long", 0.0).trial
    assert row["drawn_friction"] == spec.condition.draw(4).friction
    assert (row["end_reason"], row["judged"], row["inserted"]) == ("fault:timeout", False, None)
    assert lost(spec, "timeout", "too long", 0.0).failed


def test_what_is_not_finite_was_not_measured() -> None:
    row = rows_of(trial((FIT, replace(BEFORE, depth_m=math.nan)))).trial
    assert row["depth_m"] is None


@pytest.mark.parametrize("columns", [TRIALS, EXECUTIONS])
def test_the_data_dictionary_lists_every_column_as_it_is(columns: tuple[object, ...]) -> None:
    assert dictionary(columns) in DOCUMENT.read_text(encoding="utf-8")  # type: ignore[arg-type]


def test_the_documents_first_example_runs(tmp_path: Path) -> None:
    results.write_rows(tmp_path, [rows_of(trial((FIT, BEFORE), (STOPPED, SEATED)))])
    blocks = DOCUMENT.read_text(encoding="utf-8").split("```python\n")[1:]
    code = next(b.partition("```")[0] for b in blocks if "pyarrow" in b)
    found: dict[str, object] = {}
    exec(code.replace("runs/table2", str(tmp_path)), found)
    assert isinstance(found["trials"], pa.Table)
    assert found["trials"].schema.equals(schema(TRIALS))


def test_a_model_s_own_decisions_are_told_from_clamped_ones_and_fallbacks() -> None:
    exchange = Exchange(stage="plan", request="?", reply="!", model="m", input_tokens=3)
    steps = (goal_step(Formation.FIT, -0.002),)
    asked = replace(FIT.verdict, exchanges=(exchange,))
    cut = replace(recovery_of(*steps), exchanges=(exchange,), clamped=(goal_step(Formation.FIT),))
    instead = replace(recovery_of(*steps), fallback="no reply")
    clamped = replace(FIT, verdict=asked, recovery=cut)
    fallen = replace(FIT, verdict=asked, recovery=instead)
    rows = rows_of(trial((clamped, BEFORE), (fallen, BEFORE), (FIT, SEATED)))
    told = {k: rows.trial[k] for k in ("decisions", "own", "clamped", "fallbacks", "tokens")}
    assert told == {"decisions": 4, "own": 2, "clamped": 1, "fallbacks": 1, "tokens": 9}
    assert len(rows.executions[0]["clamped_from"]) == 1
    assert rows.executions[1]["recovery_fallback"] == "no reply"
    assert rows.executions[2]["verdict_fallback"] is None
