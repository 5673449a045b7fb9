"""The ladder is data: what a level changes, and how an experiment takes it."""

import math
from dataclasses import fields, replace

import pytest

from pliant.cli.ranges import Ranges
from pliant.conditions import NOMINAL, Condition, condition
from pliant.errors import InputError
from pliant.experiment import ladder, plan
from pliant.experiment.one import Spec
from pliant.levels import FIELDS, load_level, shipped_levels
from pliant.task import load_task, shipped_pegs


def test_the_papers_level_changes_nothing() -> None:
    level = load_level("L0")
    assert level.method == "planar"
    assert level.on(condition("all")) == condition("all")
    assert load_task("circle", "L0") == load_task("circle")


@pytest.mark.parametrize("level", list(shipped_levels().values()), ids=lambda level: level.name)
def test_every_level_can_be_drawn_with_every_peg_of_its_own(level: object) -> None:
    assert isinstance(level, type(load_level("L0")))
    drawn = level.on(condition("all"))
    for seed in range(20):
        setup = drawn.draw(seed)
        for name, (low, high) in drawn.ranges.items():
            size = getattr(setup, name)
            assert low <= size <= high or low <= -size <= high
    for peg in level.pegs:
        assert peg in shipped_pegs()
        assert load_task(peg, level.name).depth == level.depth


def test_a_level_tightens_the_hole_and_deepens_the_goal() -> None:
    task = load_task("square", "L2")
    assert task.hole.clearance == pytest.approx(0.0002)
    assert task.depth == pytest.approx(0.035)


def test_a_task_does_not_tell_its_level() -> None:
    assert load_task("circle", "wrong_peg") == load_task("circle", "L1")
    assert load_task("circle", "L5+") == load_task("circle", "L0")


def test_a_trial_with_a_task_of_another_level_is_refused() -> None:
    spec = Spec(task=load_task("circle"), condition=condition("all"), seed=1, reasoner="rules")
    assert replace(spec, level="L5").trial_id == "L5-circle-all-rules-1"
    with pytest.raises(InputError, match="level L2 has another hole or depth than the task"):
        replace(spec, level="L2")
    with pytest.raises(InputError, match="unknown level 'L99'"):
        replace(spec, level="L99")


def test_levels_build_on_one_another() -> None:
    third, fourth = load_level("L3"), load_level("L4")
    assert third.ranges == fourth.ranges
    assert fourth.ranges["board_yaw"] == pytest.approx((-math.radians(10), math.radians(10)))


def test_a_seed_draws_the_papers_quantities_alike_on_every_level() -> None:
    nominal = condition("all").draw(7)
    harder = load_level("L4").on(condition("all")).draw(7)
    assert (harder.friction, harder.hole_y, harder.grasp_roll) == (
        nominal.friction,
        nominal.hole_y,
        nominal.grasp_roll,
    )
    assert harder.hole_x != NOMINAL["hole_x"]


def test_a_condition_of_the_users_own_keeps_its_range() -> None:
    mine = Condition(name="mine", ranges={"hole_x": (0.001, 0.001)})
    assert load_level("L3").on(mine).draw(1).hole_x == 0.001


def test_an_experiment_takes_the_levels_pegs_and_skills() -> None:
    fields = {"conditions": "all", "reasoners": "rules"}
    planned = plan.from_fields(fields, {"level": "L7"})
    assert {c.task.peg.name for c in planned.cells} == set(load_level("L7").pegs)
    assert {c.method for c in planned.cells} == {"guided"}
    papers = plan.from_fields({**fields, "level": "L1", "method": "planar"})
    assert {c.method for c in papers.cells} == {"planar"}


def test_an_unknown_method_is_refused_in_one_line() -> None:
    fields = {"pegs": "circle", "conditions": "all", "reasoners": "rules", "method": "blind"}
    with pytest.raises(InputError, match="unknown method 'blind': valid are planar, guided"):
        plan.from_fields(fields)


def trial(level: str, *, judged: bool, inserted: bool) -> dict[str, object]:
    return {
        "level": level,
        "method": "guided",
        "reasoner": "rules",
        "peg": "circle",
        "judged": judged,
        "inserted": inserted,
        "end_reason": "inserted",
        "moves": 40,
        "executions": 5,
        "simulated_s": 30.0,
        "decisions": 0,
        "own": 0,
        "failure_kind": None if judged == inserted else "misjudged",
    }


def test_the_ladders_table_counts_wrong_verdicts_and_false_acceptances() -> None:
    outcomes = [(True, True), (True, False), (False, True), (False, False)]
    [row] = ladder.rows(trial("L1", judged=j, inserted=i) for j, i in outcomes)
    assert (row["inserted"]["percent"], row["wrong"]["percent"]) == (50.0, 50.0)
    assert row["false_accepts"]["percent"] == 25.0


def test_the_papers_grid_has_no_rows_on_the_ladder() -> None:
    papers = {**trial("L0", judged=True, inserted=True), "method": "planar"}
    assert ladder.rows([papers]) == []


def test_every_quantity_that_can_be_drawn_has_an_option() -> None:
    assert [field.name for field in fields(Ranges)] == list(FIELDS)
