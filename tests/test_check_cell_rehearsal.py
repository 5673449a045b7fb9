"""A trial rehearsed: on paper it commands what a trial commands, in the air it touches nothing."""

from dataclasses import replace

import pytest
from stand_ins import ScriptedReasoner, ScriptedRobot, goal_step, prepared, recovery_of

from pliant.cli.rehearse import air_run, dry_run
from pliant.commissioning.rehearsal import above, air, bounds_of, plan_of
from pliant.conditions import Setup
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.experiment.where import Where
from pliant.formations import RECOVERABLE, Formation
from pliant.methods.planar import Planar
from pliant.recovery import admit
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

CIRCLE = load_task("circle")


def test_the_plan_on_paper_is_what_a_trial_commands() -> None:
    robot, slow = ScriptedRobot(), Limits(contact_speed_m_s=0.01)
    run = Run(
        robot=robot,
        task=CIRCLE,
        teaching=shipped(),
        reasoner=ScriptedReasoner(),
        method=Planar(),
        limits=slow,
    )
    assert len(list(run)) == len(Formation)
    nominal = [line for line in plan_of(shipped(), CIRCLE, slow) if not line.is_retreat]
    assert {line.speed_m_s for line in nominal} == {0.05, 0.01}
    assert [line.pose for line in nominal] == robot.poses
    assert [line.speed_m_s for line in nominal] == robot.speeds
    assert [line.compression_m for line in nominal] == robot.compression_limits


def test_every_recoverable_formation_is_also_planned_after_a_retreat() -> None:
    again = [line for line in plan_of(shipped(), CIRCLE, Limits()) if line.is_retreat]
    assert {line.formation for line in again} == set(RECOVERABLE)
    assert max(line.pose.z for line in again) == shipped().goals.target(Formation.APPROACH).z


def test_a_motion_that_the_envelope_would_refuse_is_shown_with_the_reason() -> None:
    narrow = replace(Limits(), low=replace(Limits().low, y=-0.03))
    problems = {line.formation for line in plan_of(shipped(), CIRCLE, narrow) if line.problem}
    assert problems == {Formation.FIT}


@pytest.mark.parametrize("bound", bounds_of(shipped(), Limits()), ids=lambda b: str(b.formation))
def test_the_bounds_are_those_of_admission(bound) -> None:  # type: ignore[no-untyped-def]
    from stand_ins import case_after, outcome_of

    case = case_after(outcome_of(bound.formation))
    for end, outward in zip(bound.one, (-1, 1), strict=True):
        for beyond, is_admitted in ((-1e-6, True), (1e-4, False)):
            change = end + outward * beyond - bound.taught
            plan = recovery_of(goal_step(bound.formation, change))
            assert bool(admit(plan, case, Limits()).steps) is is_admitted


@pytest.mark.parametrize("peg", ["circle", "rectangle_narrow"])
def test_an_air_run_goes_through_the_plan_and_stays_clear_of_the_board(peg: str) -> None:
    task = load_task(peg)
    robot = prepared(peg, Setup(seed=0, hole_y=0.02, grasp_roll=0.08))
    outcomes = list(air(robot, shipped(), task, Limits()))
    assert [o.step.formation for o in outcomes] == list(Formation)
    for outcome in outcomes:
        assert not outcome.stop.is_early
        assert outcome.pose.z > task.tip_below_hinge + 0.03
    travelled = [outcomes[i].pose.y for i in (1, 2, 3)]
    assert travelled == pytest.approx([0.026, -0.0352, 0.0], abs=0.001)


def test_an_air_run_that_touches_something_ends_there() -> None:
    outcomes = list(air(ScriptedRobot(blocked_below=0.26), shipped(), CIRCLE, Limits()))
    assert [o.step.formation for o in outcomes] == [Formation.APPROACH, Formation.CONTACT]
    assert outcomes[-1].stop.is_early


def test_an_air_run_without_room_above_is_refused_before_anything_moves() -> None:
    low_ceiling = replace(Limits(), high=replace(Limits().high, z=0.25))
    robot = ScriptedRobot()
    with pytest.raises(InputError, match="no room for an air run"):
        list(air(robot, shipped(), CIRCLE, low_ceiling))
    assert not robot.poses


def test_goals_that_are_high_already_are_not_lifted() -> None:
    low_board = replace(CIRCLE, grasp_below_hinge=0.02)
    assert above(shipped(), low_board, Limits()) == shipped().goals


def test_the_commands_print_the_plan_and_run_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert dry_run(Where(), CIRCLE, shipped()) == 0
    printed = capsys.readouterr().out
    for number in ("-35.2", "167.6", "-80.2", "212.6"):
        assert number in printed
    assert air_run(Where(), CIRCLE, shipped()) == 0
    assert "all in free air" in capsys.readouterr().out
