import dataclasses
import typing
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from stand_ins import ScriptedReasoner, ScriptedRobot, cell_for, goal_step, names, recovery_of

from pliant import store
from pliant.belief import Belief
from pliant.cell import Robot, Stop, Truth
from pliant.conditions import Condition, Setup, condition
from pliant.envelope import Guarded, Limits
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.methods.planar import Planar
from pliant.methods.planar.skills import PlanarSkills
from pliant.pose import Axis, Pose
from pliant.reasoners.controls import OpenLoop
from pliant.records import Case, End, Execution, Recovery
from pliant.task import Task, load_task
from pliant.teaching import shipped
from pliant.trial import Patience, Run

FIT, ALIGN, INSERTION = Formation.FIT, Formation.ALIGN, Formation.INSERTION
FIVE = [str(f) for f in Formation]
ALL_AGAIN = recovery_of(goal_step(FIT, retreat=True), goal_step(ALIGN), goal_step(INSERTION))


def run_of(
    verdicts: Sequence[bool] = (True,),
    plans: Sequence[Recovery | None] = (None,),
    *,
    robot: ScriptedRobot | None = None,
    patience: Patience | None = None,
) -> tuple[Run, ScriptedReasoner, list[Execution]]:
    """A trial with a scripted reasoner, run to its end."""
    reasoner = ScriptedReasoner(verdicts=verdicts, plans=plans)
    run = Run(
        robot=robot or ScriptedRobot(),
        task=load_task("circle"),
        teaching=shipped(),
        reasoner=reasoner,
        method=Planar(),
        patience=patience or Patience(),
    )
    return run, reasoner, list(run)


# --- how a trial ends --------------------------------------------------------------------------


def test_five_successes_in_order_end_as_inserted() -> None:
    run, reasoner, executions = run_of()
    assert names(executions) == FIVE
    assert run.end_reason == End.INSERTED
    assert not reasoner.recovered


def test_ten_failed_verdicts_in_a_row_exhaust_it() -> None:
    run, reasoner, executions = run_of((True, True, False), (ALL_AGAIN,))
    assert run.end_reason == End.EXHAUSTED
    assert [e.verdict.success for e in executions] == [True, True] + 10 * [False]
    assert len(reasoner.recovered) == 9  # nobody is asked for a plan that will not be done
    assert executions[-1].recovery is None


def test_a_success_resets_the_count_of_failures() -> None:
    nine = 9 * [False]
    run, _, executions = run_of((*nine, True, *nine, True, *nine, False), (ALL_AGAIN,))
    assert run.end_reason == End.EXHAUSTED
    assert len(executions) == 9 + 1 + 9 + 1 + 10


def test_forty_executions_are_the_cap() -> None:
    run, _, executions = run_of(20 * [False, True], (ALL_AGAIN,))
    assert run.end_reason == End.CAP
    assert len(executions) == 40


def test_patience_can_be_set() -> None:
    patience = Patience(failures=3, executions=100)
    run, _, executions = run_of((False,), (ALL_AGAIN,), patience=patience)
    assert (run.end_reason, len(executions)) == (End.EXHAUSTED, 3)


def test_a_recovery_without_steps_stops_it() -> None:
    run, _, executions = run_of((True, True, False), (recovery_of(),))
    assert run.end_reason == End.STOPPED
    assert names(executions) == ["approach", "contact", "fit"]


def test_keeping_to_the_plan_through_failures_ends_as_finished() -> None:
    run, reasoner, executions = run_of((True, True, False))
    assert names(executions) == FIVE
    assert run.end_reason == End.FINISHED
    assert len(reasoner.recovered) == 3


def test_an_open_loop_reasoner_does_all_five_skills_once() -> None:
    robot = ScriptedRobot()
    run = Run(
        robot=robot,
        task=load_task("circle"),
        teaching=shipped(),
        reasoner=OpenLoop(),
        method=Planar(),
    )
    assert names(list(run)) == FIVE
    assert run.end_reason == End.FINISHED  # an empty picture proves no insertion


def test_a_failed_insertion_is_not_the_end_if_a_plan_follows() -> None:
    verdicts = (True, True, True, True, False, True, True)
    again = recovery_of(goal_step(ALIGN), goal_step(INSERTION))
    run, _, executions = run_of(verdicts, (again,))
    assert names(executions) == [*FIVE, "align", "insertion"]
    assert run.end_reason == End.INSERTED


# --- faults ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "use", "done"),
    [("move_to", 1, 0), ("move_to", 3, 2), ("settle", 2, 1), ("observe", 1, 0), ("observe", 5, 4)],
)
def test_a_fault_anywhere_ends_it_with_its_kind_halted_and_everything_recorded(
    call: str, use: int, done: int
) -> None:
    robot = ScriptedRobot(fault=(call, use))
    run, _, executions = run_of(robot=robot)
    assert run.end_reason == "fault:lost"
    assert run.fault == f"scripted at {call}"
    assert robot.calls[-1] == "halt"
    assert names(executions) == FIVE[:done]
    assert run.history == executions
    assert run.aborted is not None
    assert run.aborted.step.formation == FIVE[done]
    assert (run.aborted.under_way == run.aborted.target) is (call == "move_to")
    assert len(run.aborted.motions) == (call != "move_to")


def test_what_a_fault_ended_is_kept_with_the_trial(tmp_path: Path) -> None:
    class Cell:
        kind = "scripted"

        def prepare(self, task: Task, setup: Setup) -> Robot:
            return ScriptedRobot(fault=("move_to", 3))

        def truth(self) -> Truth:
            return Truth(
                inserted=False,
                depth_m=0.0,
                tip=(0.0, 0.0, 0.0),
                tilt_rad=0.0,
                hole_y=0.0,
                compression_m=0.0,
            )

    spec = Spec(task=load_task("circle"), condition=condition("none"), seed=1, reasoner="none")
    store.save_trial(tmp_path, perform(spec, Cell(), shipped()))
    kept = store.load_trial(tmp_path)
    assert kept.end_reason == "fault:lost"
    assert kept.aborted is not None
    assert kept.aborted.step.formation is FIT
    assert kept.aborted.under_way == shipped().goals.target(FIT)
    assert kept.aborted.motions == ()


def test_a_motion_outside_the_envelope_is_a_fault_of_its_own_kind() -> None:
    limits = Limits(low=Limits().low, high=Limits().high.updated({Axis.Y: 0.02}))
    robot = ScriptedRobot()
    run = Run(
        robot=robot,
        task=load_task("circle"),
        teaching=shipped(),
        reasoner=ScriptedReasoner(),
        method=Planar(),
        limits=limits,
    )
    assert list(run) == []
    assert run.end_reason == "fault:envelope"
    assert "y 26.0 mm is outside the workspace" in run.fault
    assert not robot.poses


def test_the_robot_is_halted_when_a_trial_ends_by_itself() -> None:
    robot = ScriptedRobot()
    run_of(robot=robot)
    assert robot.calls[-1] == "halt"


def test_the_robot_is_halted_when_its_watcher_walks_away() -> None:
    robot = ScriptedRobot()
    run = Run(
        robot=robot,
        task=load_task("circle"),
        teaching=shipped(),
        reasoner=ScriptedReasoner(),
        method=Planar(),
    )
    executions = iter(run)
    next(executions)
    executions.close()
    assert robot.calls[-1] == "halt"
    assert len(run.history) == 1


def test_a_reasoners_own_error_is_not_hidden_and_halts_the_robot() -> None:
    class Broken(ScriptedReasoner):
        def judge(self, case: Case) -> typing.NoReturn:
            raise ZeroDivisionError

    robot = ScriptedRobot()
    run = Run(
        robot=robot,
        task=load_task("circle"),
        teaching=shipped(),
        reasoner=Broken(),
        method=Planar(),
    )
    with pytest.raises(ZeroDivisionError):
        list(run)
    assert robot.calls[-1] == "halt"


# --- plans and goals ---------------------------------------------------------------------------


def test_a_plan_replaces_what_was_queued() -> None:
    only_align_on = recovery_of(goal_step(ALIGN), goal_step(INSERTION))
    _, _, executions = run_of((True, True, False, True), (only_align_on,))
    assert names(executions) == ["approach", "contact", "fit", "align", "insertion"]


def test_a_plan_that_ends_early_goes_on_in_the_papers_order() -> None:
    run, _, executions = run_of((True, True, False, True), (recovery_of(goal_step(FIT, -0.005)),))
    assert names(executions) == ["approach", "contact", "fit", "fit", "align", "insertion"]
    assert run.end_reason == End.INSERTED


def test_a_changed_goal_stays_in_force_for_later_skills() -> None:
    plan = recovery_of(goal_step(ALIGN, 0.004), goal_step(INSERTION))
    _, reasoner, executions = run_of((True, True, True, False, True), (plan,))
    assert names(executions) == [*FIVE[:4], "align", "insertion"]
    assert executions[-1].outcome.target.y == pytest.approx(0.004)
    assert reasoner.judged[-1].goals.formations[ALIGN][Axis.Y] == pytest.approx(0.004)
    assert reasoner.judged[0].teaching.goals == shipped().goals


def test_goals_in_a_plan_are_not_in_force_before_they_are_done() -> None:
    plan = recovery_of(goal_step(ALIGN, 0.004), goal_step(INSERTION, -0.004))
    _, reasoner, _ = run_of((True, True, True, False, False, True), (plan, None))
    after_align = reasoner.judged[4].goals
    assert after_align.formations[ALIGN][Axis.Y] == pytest.approx(0.004)
    assert after_align.formations[INSERTION] == shipped().goals.formations[INSERTION]


def test_steps_that_are_refused_are_recorded_and_never_done() -> None:
    wild = recovery_of(goal_step(FIT, -0.010), goal_step(ALIGN, 0.090))
    robot = ScriptedRobot()
    _, _, executions = run_of((True, True, False, False, True), (wild, None), robot=robot)
    failed = executions[2]
    assert failed.recovery is wild
    assert failed.admission is not None
    assert len(failed.admission.steps) == 1
    assert failed.admission.refusals[0].startswith("align: moves y by +90.0 mm")
    assert all(p.y < 0.05 for p in robot.poses)


def test_a_recovery_refused_from_its_first_step_ends_the_trial_as_refused() -> None:
    run, _, executions = run_of((True, True, False), (recovery_of(goal_step(FIT, 0.090)),))
    assert run.end_reason == End.REFUSED
    assert executions[-1].admission is not None
    assert executions[-1].admission.refusals


# --- skills ------------------------------------------------------------------------------------


def planar(robot: ScriptedRobot, formation: Formation, *, retreat: bool) -> list[Pose]:
    goals = shipped().goals
    target = goals.target(formation)
    look = typing.cast("typing.Any", None)
    PlanarSkills(taught=shipped().goals)(
        Guarded(robot, Limits()),
        lambda cameras=("side",): look,
        target,
        goals.step(formation, retreat=retreat),
        Belief(),
    )
    return robot.poses


@pytest.mark.parametrize("formation", list(Formation))
def test_a_skill_is_one_straight_motion_to_its_target(formation: Formation) -> None:
    target = shipped().goals.target(formation)
    assert planar(ScriptedRobot(), formation, retreat=False) == [target]


def test_a_retreat_lifts_straight_up_travels_and_comes_down_before_the_skill() -> None:
    goals = shipped().goals
    robot = ScriptedRobot(pose=goals.target(INSERTION))
    lifted, above, down, there = planar(robot, FIT, retreat=True)
    start, target = goals.target(INSERTION), goals.target(FIT)
    assert (lifted.y, lifted.roll) == (start.y, start.roll)
    assert lifted.z == above.z == goals.target(Formation.APPROACH).z
    assert above.y == down.y > target.y
    assert down.z == target.z
    assert there == target


def test_a_compression_stop_ends_the_skill_at_once() -> None:
    robot = ScriptedRobot(blocked_below=0.20)
    _, _, executions = run_of((True, False), (ALL_AGAIN, None), robot=robot)
    contact = executions[1].outcome
    assert contact.stop is Stop.COMPRESSION
    assert len(contact.motions) == 1
    fit = executions[2].outcome  # down from the retreat is blocked: the slide is not tried
    assert len(fit.motions) == 3
    assert not any(m.requested == fit.target for m in fit.motions)


# --- what the reasoner sees --------------------------------------------------------------------


def test_the_reasoner_sees_the_history_in_order() -> None:
    _, reasoner, executions = run_of((True, True, False, True), (ALL_AGAIN,))
    for index, case in enumerate(reasoner.judged):
        assert list(case.history) == executions[:index]
        assert [e.index for e in case.history] == list(range(index))
        assert case.outcome is executions[index].outcome


def test_recovery_is_asked_about_the_case_that_was_judged() -> None:
    _, reasoner, _ = run_of((True, True, False, True), (ALL_AGAIN,))
    assert reasoner.recovered == [reasoner.judged[2]]


def test_an_execution_keeps_what_was_thought_and_admitted() -> None:
    _, _, executions = run_of((True, True, False, True), (ALL_AGAIN,))
    failed, after = executions[2], executions[3]
    assert failed.recovery is ALL_AGAIN
    assert failed.admission is not None
    assert failed.admission.steps == ALL_AGAIN.steps
    assert after.recovery is None
    assert after.outcome.step == ALL_AGAIN.steps[0]


def reachable(root: object) -> set[object]:
    """Every type that can be reached from a type through annotations."""
    found: set[object] = set()
    todo = [root]
    while todo:
        kind = todo.pop()
        if kind in found:
            continue
        found.add(kind)
        if typing.get_origin(kind) is np.ndarray:
            continue  # numbers
        todo.extend(typing.get_args(kind))
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            todo.extend(typing.get_type_hints(kind).values())
    return found


def test_truth_is_no_part_of_a_case() -> None:
    types = reachable(Case)
    assert {Execution, Belief, Pose} <= types  # the search does reach what a case holds
    assert not types & {Truth, Setup, Condition, object, typing.Any}


def test_a_skill_gets_no_more_of_the_robot_than_the_protocol() -> None:
    public = {n for n in dir(Guarded) if not n.startswith("_")}
    assert public == {n for n in vars(Robot) if not n.startswith("_")}


def test_a_peg_that_slid_into_the_hole_without_ever_pressing_the_board_goes_in() -> None:
    """Its sensor has not answered, so it goes down from where the picture shows it."""
    spec = Spec.named(peg="rectangle_narrow", condition="pose", seed=129)
    trial = perform(spec, cell_for("rectangle_narrow"), shipped())
    assert (trial.end_reason, trial.inserted, len(trial.executions)) == ("inserted", True, 9)
