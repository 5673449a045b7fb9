"""The weighing of signs, and the signs that a guided trial shows."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.diagnosis import Diagnosis, Hypothesis, Sign, weighed
from pliant.experiment.one import run
from pliant.experiment.rows import trial_row
from pliant.records import End, Evidence

SPEAKS = st.dictionaries(st.sampled_from(Hypothesis), st.floats(-3.0, 3.0), max_size=4)
SIGNS = st.lists(st.builds(Sign, says=st.just("something"), speaks=SPEAKS), max_size=6)


@given(SIGNS)
def test_the_weights_of_all_hypotheses_are_shares_of_one(signs: list[Sign]) -> None:
    diagnosis = weighed(signs)
    assert math.fsum(diagnosis.weights.values()) == pytest.approx(1.0)
    assert all(0.0 <= weight <= 1.0 for weight in diagnosis.weights.values())


@given(SIGNS)
def test_the_order_of_signs_does_not_matter(signs: list[Sign]) -> None:
    there, back = weighed(signs), weighed(signs[::-1])
    for hypothesis, weight in there.weights.items():
        assert weight == pytest.approx(back.weights[hypothesis])


def test_without_a_sign_all_is_as_the_task_says() -> None:
    assert Diagnosis().leading is Hypothesis.AS_TOLD
    assert not weighed([]).is_hopeless


def test_one_weak_sign_is_not_enough_to_give_up_and_two_strong_ones_are() -> None:
    weak = Sign(says="it stands high", speaks={Hypothesis.OBJECT_ON_BOARD: 1.0})
    strong = replace(weak, speaks={Hypothesis.OBJECT_ON_BOARD: 2.0})
    assert not weighed([weak]).is_hopeless
    assert weighed([strong, strong]).is_hopeless


def test_a_hole_that_is_elsewhere_is_no_reason_to_give_up() -> None:
    sure = Sign(says="it is not there", speaks={Hypothesis.HOLE_ELSEWHERE: 6.0})
    assert not weighed([sure]).is_hopeless


def test_a_sign_that_decides_fails_the_execution_and_a_doubt_has_no_vote() -> None:
    for by, vote in ((5.0, False), (1.0, None)):
        sign = Sign(says="it is wide", speaks={Hypothesis.PEG_OTHER: by})
        check = Evidence(checks=()).with_signs(weighed([sign]))["plausible"]
        assert check is not None
        assert check.vote is vote
        assert "it is wide" in check.message
    assert Evidence(checks=()).with_signs(weighed([])) == Evidence(checks=())


@pytest.mark.parametrize(
    ("level", "end", "truly", "most"),
    [
        ("wrong_peg", End.STOPPED, Hypothesis.PEG_OTHER, 1),
        ("long_peg", End.STOPPED, Hypothesis.PEG_OTHER, 1),
        ("bar_across", End.STOPPED, Hypothesis.OBJECT_ON_BOARD, 4),
        ("frozen_pictures", End.STOPPED, Hypothesis.CAMERA_WRONG, 2),
        ("no_peg", "fault:no_touch", Hypothesis.PEG_MISSING, 2),
        ("dead_sensor", "fault:sensor", Hypothesis.SENSOR_WRONG, 1),
    ],
)
def test_a_trial_in_which_nothing_can_help_ends_soon_and_says_what_is_so(
    level: str, end: str, truly: Hypothesis, most: int
) -> None:
    trial = run(level=level, peg="square", seed=43001)
    assert trial.diagnosis is not None
    assert trial.diagnosis.leading is truly
    assert len(trial.executions) <= most
    assert trial.end_reason == end
    if end == End.STOPPED:
        recovery = trial.executions[-1].recovery
        assert recovery is not None
        assert recovery.analysis.what == truly.words
        assert recovery.analysis.why


def test_a_hole_that_the_camera_shows_elsewhere_is_felt_for_and_found() -> None:
    trial = run(level="lying_camera", peg="circle", seed=43001)
    assert trial.inserted
    assert trial.diagnosis is not None
    assert trial.diagnosis.leading is Hypothesis.HOLE_ELSEWHERE


def test_a_method_that_does_not_look_for_signs_is_not_said_to_believe_the_task() -> None:
    trial = run(level="no_peg", peg="square", seed=43001, method="planar", reasoner="none")
    assert [execution.diagnosis for execution in trial.executions] == [None] * len(trial.executions)
    row = trial_row(replace(trial, end_reason=End.STOPPED))
    assert row["diagnosis"] is row["diagnosis_weight"] is None


# The sight by edges sees a peg here, and then in the hole.
def test_an_empty_gripper_that_a_picture_takes_for_a_peg_is_told_by_what_is_never_felt() -> None:
    trial = run(level="L9", peg="rectangle_narrow", seed=33005)
    assert trial.end_reason == End.STOPPED
    assert trial.diagnosis is not None
    assert trial.diagnosis.leading is Hypothesis.PEG_MISSING
    assert "nothing was felt" in trial.diagnosis.why
