"""The embedded reasoners on a handful of simulated trials."""

from pathlib import Path

import pytest
from stand_ins import PEGS, cell_for, names

from pliant.conditions import CONDITIONS
from pliant.errors import InputError
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.reasoners import REASONERS, reasoner
from pliant.records import End, Trial
from pliant.task import load_task
from pliant.teaching import shipped

FIVE = [str(f) for f in Formation]


def trial(peg: str, condition: str, seed: int, by: str) -> Trial:
    spec = Spec(task=load_task(peg), condition=CONDITIONS[condition], seed=seed, reasoner=by)
    return perform(spec, cell_for(peg), shipped())


# --- rules -------------------------------------------------------------------------------------


@pytest.mark.parametrize("peg", PEGS)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_rules_insert_every_peg_under_every_disturbance(peg: str, seed: int) -> None:
    done = trial(peg, "all", seed, "rules")
    assert done.end_reason == End.INSERTED
    assert done.judged
    assert done.inserted


def test_rules_recover_where_the_open_loop_fails_on_the_same_seed() -> None:
    assert not trial("circle", "all", 1, "none").inserted
    recovered = trial("circle", "all", 1, "rules")
    assert recovered.inserted
    assert any(not e.verdict.success for e in recovered.executions)


def test_a_failure_is_explained_and_planned_for_in_words_and_numbers() -> None:
    failed = [e for e in trial("circle", "all", 1, "rules").executions if not e.verdict.success]
    assert failed
    for execution in failed:
        assert execution.recovery is not None
        analysis = execution.recovery.analysis
        assert analysis.what
        assert analysis.why
        assert analysis.how
        assert analysis.motion
        assert execution.admission is not None
        assert execution.admission.steps == execution.recovery.steps
        assert execution.admission.refusals == ()


def test_a_verdict_keeps_every_vote_and_names_the_ones_that_disagreed() -> None:
    for peg, seed in (("circle", 1), ("rectangle_narrow", 2)):
        for execution in trial(peg, "all", seed, "rules").executions:
            verdict = execution.verdict
            assert verdict.votes == execution.evidence.votes
            against = sorted(
                name for name, vote in verdict.votes.items() if vote not in (None, verdict.success)
            )
            assert (verdict.conflict is None) == (not against)
            assert all(name in (verdict.conflict or "") for name in against)


@pytest.mark.parametrize("peg", PEGS)
def test_nothing_goes_wrong_where_nothing_differs_from_plan(peg: str) -> None:
    done = trial(peg, "none", 0, "rules")
    assert names(done.executions) == FIVE
    assert all(e.verdict.success for e in done.executions)
    assert done.inserted


def test_the_hole_and_the_grasp_angle_are_seen_as_they_are() -> None:
    done = trial("circle", "pose", 5, "rules")
    belief = done.executions[-1].belief
    assert belief.hole_y is not None
    assert belief.hole_y.value == pytest.approx(done.drawn["hole_y"], abs=0.0005)
    assert belief.grasp_roll is not None
    assert belief.grasp_roll.value == pytest.approx(done.drawn["grasp_roll"], abs=0.015)


# --- the controls ------------------------------------------------------------------------------


@pytest.mark.parametrize("peg", PEGS)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_open_loop_does_all_five_skills_once_with_the_taught_goals(peg: str, seed: int) -> None:
    done = trial(peg, "all", seed, "none")
    assert names(done.executions) == FIVE
    assert all(e.recovery is None for e in done.executions)
    for execution in done.executions:
        assert execution.outcome.target == shipped().goals.target(execution.formation)
    assert done.end_reason == (End.INSERTED if done.judged else End.FINISHED)


def test_retry_retreats_and_repeats_what_was_taught_until_it_is_exhausted() -> None:
    done = trial("circle", "all", 1, "retry")
    assert done.end_reason == End.EXHAUSTED
    again = [e for e in done.executions[3:] if e.outcome.step.retreat]
    assert again
    for execution in again:
        assert execution.formation is Formation.FIT
        assert execution.outcome.target == shipped().goals.target(Formation.FIT)
        assert len(execution.outcome.motions) == 4
        lifted = execution.outcome.motions[0]
        approach = shipped().goals.target(Formation.APPROACH)
        assert lifted.ended.z == pytest.approx(approach.z, abs=0.001)


# --- by name -----------------------------------------------------------------------------------


def test_an_unknown_reasoner_lists_the_valid_ones() -> None:
    with pytest.raises(InputError, match="unknown reasoner 'nobody': valid are") as error:
        reasoner("nobody")
    assert all(name in str(error.value) for name in REASONERS)


def test_a_reasoner_of_ones_own_is_named_by_its_file_and_class(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from pliant.reasoners.rules import Rules\nclass Mine(Rules): ...\n", encoding="utf-8"
    )
    assert type(reasoner(f"{path}:Mine")).__name__ == "Mine"
    with pytest.raises(InputError, match="has no class 'Yours': it has Mine"):
        reasoner(f"{path}:Yours")
    with pytest.raises(InputError, match="does not exist"):
        reasoner(f"{tmp_path / 'none.py'}:Mine")


def test_a_reasoner_of_ones_own_may_be_a_dataclass_with_postponed_annotations(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "@dataclass\n"
        "class Mine:\n"
        "    name: str = 'mine'\n"
        "    def judge(self, case): ...\n"
        "    def recover(self, case, verdict): ...\n",
        encoding="utf-8",
    )
    assert reasoner(f"{path}:Mine").name == "mine"


def test_a_trial_keeps_what_was_drawn_and_the_truth_beside_each_execution() -> None:
    done = trial("square", "all", 2, "rules")
    assert done.drawn == CONDITIONS["all"].draw(2).quantities()
    assert len(done.truths) == len(done.executions)
    assert done.truths[-1].depth_m > 0.010
