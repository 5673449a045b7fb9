"""A trial as rows: one of trials.parquet, and one of executions.parquet per execution.

Rows hold plain JSON values (columns.py says which), so that the journal can keep them as they are.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pliant.cell import Truth
from pliant.experiment import faults
from pliant.experiment.columns import axis_field
from pliant.experiment.one import Spec
from pliant.experiment.success import trial_kind
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.pose import Axis, Partial, Pose
from pliant.records import Decision, Exchange, Execution, Trial

Row = dict[str, Any]
_NO_GOALS = Goals(formations={f: dict.fromkeys(OWNED[f], 0.0) for f in Formation})


@dataclass(frozen=True, kw_only=True)
class Rows:
    """One finished trial, as the journal keeps it."""

    trial: Row
    executions: list[Row] = field(default_factory=list)

    @property
    def trial_id(self) -> str:
        return str(self.trial["trial_id"])

    @property
    def failed(self) -> bool:
        """Whether the trial is worth a look: not inserted, not judged so, or ended by a fault."""
        return self.trial["failure_kind"] is not None or not self.trial["judged"]


def rows_of(trial: Trial) -> Rows:
    """A trial's rows. The trial's condition and reasoner are named as in its record."""
    truths: list[Truth | None] = [*trial.truths]
    truths += [None] * (len(trial.executions) - len(truths))
    return Rows(
        trial=trial_row(trial),
        executions=[
            execution_row(trial.trial_id, execution, truth)
            for execution, truth in zip(trial.executions, truths, strict=True)
        ],
    )


def trial_row(trial: Trial) -> Row:
    """A trial's row of trials.parquet."""
    counts = {
        f: sum(e.formation is f for e in trial.executions) for f in RECOVERABLE
    }  # Approach and Contact are not recovered from
    measured = not faults.is_unmeasured(trial.end_reason)
    believed = trial.diagnosis if measured else None
    return {
        "trial_id": trial.trial_id,
        "cell": trial.cell,
        "level": trial.level,
        "peg": trial.task.peg.name,
        "method": trial.method,
        "condition": trial.condition,
        "reasoner": trial.reasoner,
        "model": trial.model,
        "seed": trial.seed,
        "judged": trial.judged,
        "inserted": trial.inserted if measured else None,
        "depth_m": _number(trial.truths[-1].depth_m) if trial.truths and measured else None,
        "end_reason": str(trial.end_reason),
        "fault": trial.fault or None,
        "diagnosis": str(believed.leading) if believed is not None else None,
        "diagnosis_weight": believed.weight if believed is not None else None,
        "executions": len(trial.executions),
        **{f"extra_{f}": max(0, n - 1) for f, n in counts.items()},
        "moves": sum(len(e.motions) for e in trial.executions),
        "simulated_s": _number(trial.simulated_s),
        "wall_s": trial.wall_s,
        "failure_kind": trial_kind(trial),
        **_asked(trial),
        **_spent([x for e in trial.executions for x in exchanges(e)]),
        **{f"drawn_{name}": value for name, value in trial.drawn.items()},
    }


def lost(spec: Spec, kind: str, message: str, wall_s: float, cell: str = "sim") -> Rows:
    """The rows of a trial that left no record: it is neither judged nor labelled. `cell` is the
    workcell's kind."""
    nothing = spec.trial(
        model=None if spec.vlm is None else spec.vlm.model,
        goals=_NO_GOALS,
        executions=(),
        end_reason=f"{faults.PREFIX}{kind}",
        fault=message,
        simulated_s=0.0,
        wall_s=wall_s,
        cell=cell,
    )
    return rows_of(nothing)


def execution_row(trial_id: str, execution: Execution, truth: Truth | None) -> Row:
    """An execution's row of executions.parquet; the columns left out are null."""
    outcome, verdict = execution.outcome, execution.verdict
    row: Row = {
        "trial_id": trial_id,
        "index": execution.index,
        "formation": str(execution.formation),
        "retreat": outcome.step.retreat,
        **_pose("goal", outcome.target),
        **_pose("end", outcome.pose),
        "stop": str(outcome.stop),
        "peak_compression_m": _number(outcome.peak_compression_m),
        "checks": [
            {"name": c.name, "vote": c.vote, "message": c.message, "paper": c.paper}
            for c in execution.evidence.checks
        ],
        "verdict": verdict.success,
        "reason": verdict.reason,
        "conflict": verdict.conflict,
        "by": verdict.by,
        "verdict_fallback": verdict.fallback or None,
    }
    if truth is not None:
        row |= _truth(truth)
    recovery, admission = execution.recovery, execution.admission
    if recovery is not None:
        row |= {
            "analysis_what": recovery.analysis.what,
            "analysis_why": recovery.analysis.why,
            "analysis_how": recovery.analysis.how,
            "analysis_motion": _goal(recovery.analysis.motion),
            "proposed": _steps(recovery.steps),
            "recovery_by": recovery.by,
            "recovery_fallback": recovery.fallback or None,
        }
        if recovery.clamped is not None:
            row["clamped_from"] = _steps(recovery.clamped)
    if admission is not None:
        row |= {"admitted": _steps(admission.steps), "refusals": list(admission.refusals)}
    return row | _spent(exchanges(execution))


def _truth(truth: Truth) -> Row:
    x, y, z = truth.tip
    return {
        "truth_inserted": truth.inserted,
        "truth_fit": truth.fit,
        "truth_depth_m": _number(truth.depth_m),
        "truth_tip_x_m": _number(x),
        "truth_tip_y_m": _number(y),
        "truth_tip_z_m": _number(z),
        "truth_tilt_rad": _number(truth.tilt_rad),
        "truth_hole_y_m": _number(truth.hole_y),
        "truth_compression_m": _number(truth.compression_m),
    }


def _asked(trial: Trial) -> Row:
    """Counts of the decisions that a model was asked for, of those that were its own in the end,
    and of what became of others. Where the rules may not step in, the rest got no answer at all."""
    plans = [e.recovery for e in trial.executions if e.recovery is not None]
    made: list[Decision] = [*(e.verdict for e in trial.executions), *plans]
    return {
        "decisions": sum(d.is_asked for d in made),
        "own": sum(d.is_own for d in made),
        "clamped": sum(plan.clamped is not None for plan in plans),
        "fallbacks": sum(bool(d.fallback) for d in made),
    }


def decided(trial: Row) -> str:
    """Say how much of a trial, given as its row, was decided by the model that was asked; empty:
    none was."""
    asked, own, cut, rules = (trial[n] for n in ("decisions", "own", "clamped", "fallbacks"))
    if not asked:
        return ""
    rest = {"cut down": cut, "by the rules": rules, "not at all": asked - own - cut - rules}
    others = ", ".join(f"{n} {how}" for how, n in rest.items() if n)
    noun = "decision" if asked == 1 else "decisions"
    return f"the model decided {own} of {asked} {noun}{'; ' if others else ''}{others}"


def exchanges(execution: Execution) -> list[Exchange]:
    """The exchanges with a model about an execution."""
    asked = [execution.verdict, *(probed.probe for probed in execution.probes), execution.recovery]
    return [
        exchange for decision in asked if decision is not None for exchange in decision.exchanges
    ]


def _spent(exchanges: list[Exchange]) -> Row:
    costs = [e.cost_usd for e in exchanges if e.cost_usd is not None]
    return {
        "tokens": sum(e.tokens for e in exchanges),
        "cost_usd": sum(costs) if costs else None,
        "latency_s": sum((e.latency_s for e in exchanges), 0.0),
    }


def _pose(prefix: str, pose: Pose) -> Row:
    return {f"{prefix}_{axis_field(axis)}": pose[axis] for axis in Axis}


def _goal(goal: Partial) -> Mapping[str, float | None]:
    return {axis_field(axis): _number(value) for axis, value in goal.items()}


def _steps(steps: Iterable[Step]) -> list[Row]:
    return [
        {"formation": str(s.formation), "retreat": s.retreat, "goal": _goal(s.goal)} for s in steps
    ]


def _number(value: float) -> float | None:
    """A number, or None where it is not finite: JSON and tables have no NaN and no infinity, and
    what is not finite was not measured."""
    return float(value) if math.isfinite(value) else None
