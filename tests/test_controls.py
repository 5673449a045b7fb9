"""Controls: each is what it says, and judges as the rules do."""

from collections.abc import Sequence

import pytest

from pliant.conditions import CONDITIONS
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.pose import Axis
from pliant.records import Execution, Trial
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

CELL = SimCell()


def trial(reasoner: str, seed: int) -> Trial:
    spec = Spec(task=load_task("circle"), condition=CONDITIONS["all"], seed=seed, reasoner=reasoner)
    return perform(spec, CELL, shipped())


def failures(executions: Sequence[Execution]) -> list[Execution]:
    return [e for e in executions if e.recovery is not None]


def test_the_sweep_tries_its_offsets_in_turn_whatever_it_sees() -> None:
    taught = shipped().goals.formations[Formation.FIT][Axis.Y]
    tried = failures(trial("sweep", 1).executions)
    offsets = [e.recovery.steps[0].goal[Axis.Y] - taught for e in tried if e.recovery]
    expected = [0.0, -0.005, 0.005, -0.010, 0.010, -0.015]
    assert len(offsets) >= 3
    assert offsets[:6] == pytest.approx(expected[: len(offsets)])


def test_messages_moves_by_its_fixed_step_in_the_direction_of_table_one() -> None:
    for execution in failures(trial("messages", 1).executions):
        table = execution.evidence["table_i"]
        assert execution.recovery is not None
        motion = execution.recovery.analysis.motion[Axis.Y]
        if table is not None and "too big" in table.message:
            assert motion == pytest.approx(-0.009)
        if table is not None and "too small" in table.message:
            assert motion == pytest.approx(0.009)


def test_the_oracle_plans_from_the_truth() -> None:
    done = trial("oracle", 1)
    assert done.inserted
    align = [e for e in done.executions if e.formation is Formation.ALIGN][-1]
    true_lever = load_task("circle").grasp_below_hinge * done.drawn["grasp_roll"]
    assert align.outcome.target.y == pytest.approx(done.drawn["hole_y"] + true_lever, abs=1e-4)


def test_controls_judge_as_the_rules_do() -> None:
    first = {
        name: trial(name, 1).executions[2].verdict.success
        for name in ("rules", "retry", "sweep", "messages", "none", "oracle")
    }
    assert len(set(first.values())) == 1
