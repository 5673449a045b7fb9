import math
from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from stand_ins import (
    ScriptedRobot,
    case_after,
    executed,
    goal_step,
    outcome_of,
    recovery_of,
    scene_of,
    step_to,
    verdict_of,
)

from pliant.belief import Belief
from pliant.cell import Stop
from pliant.envelope import Guarded, Limits
from pliant.errors import RobotFault
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.methods.guided import Guided
from pliant.methods.planar import Planar
from pliant.methods.planar.skills import PlanarSkills
from pliant.pose import Axis
from pliant.reasoners.controls import Messages, Retry, Sweep
from pliant.reasoners.rules import Rules
from pliant.records import Admission, Case, KnownMethod, Look
from pliant.recovery import admit
from pliant.teaching import shipped

LIMITS = Limits()
FIT, ALIGN, INSERTION = Formation.FIT, Formation.ALIGN, Formation.INSERTION
ANY = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-0.2, 0.3),
    st.floats(-0.05, 0.05),
)
HOSTILE_STEPS = st.builds(
    Step,
    formation=st.sampled_from(list(Formation)),
    goal=st.dictionaries(st.sampled_from(list(Axis)), ANY, max_size=3),
    retreat=st.booleans(),
)
PLAUSIBLE_STEPS = st.sampled_from(RECOVERABLE).flatmap(
    lambda f: st.builds(
        Step,
        formation=st.just(f),
        goal=st.fixed_dictionaries(
            {a: st.floats(0.10, 0.20) if a is Axis.Z else st.floats(-0.12, 0.12) for a in OWNED[f]}
        ),
        retreat=st.booleans(),
    )
)
PLANS = st.lists(st.one_of(HOSTILE_STEPS, PLAUSIBLE_STEPS), max_size=5).map(tuple)
IN_ORDER = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.10, 0.20)).map(
    lambda v: (
        step_to(FIT, {Axis.Y: v[0]}),
        step_to(ALIGN, {Axis.Y: v[1]}),
        step_to(INSERTION, {Axis.Z: v[2]}),
    )
)
CASES = st.builds(
    lambda formation, stop: case_after(outcome_of(formation, stop=stop)),
    st.sampled_from(list(Formation)),
    st.sampled_from(list(Stop)),
)


PLANAR = Planar()


def admitted(*steps: Step, case: Case | None = None) -> Admission:
    return admit(recovery_of(*steps), case or case_after(outcome_of(FIT)), LIMITS)


# --- hostile plans -----------------------------------------------------------------------------


@given(st.one_of(PLANS, IN_ORDER), CASES)
def test_nothing_outside_the_limits_is_ever_admitted(plan: tuple[Step, ...], case: Case) -> None:
    for step in admit(recovery_of(*plan), case, LIMITS).steps:
        for axis, value in step.goal.items():
            assert math.isfinite(value)
            assert LIMITS.low[axis] <= value <= LIMITS.high[axis]
            assert abs(value - case.goals.formations[step.formation][axis]) <= LIMITS.goal_step_m


@given(st.one_of(PLANS, IN_ORDER), CASES)
def test_what_is_admitted_is_an_in_order_plan_of_owned_axes(
    plan: tuple[Step, ...], case: Case
) -> None:
    steps = admit(recovery_of(*plan), case, LIMITS).steps
    orders = [s.formation.order for s in steps]
    assert all(s.formation in RECOVERABLE for s in steps)
    assert all(set(s.goal) == set(OWNED[s.formation]) for s in steps)
    assert all(later == earlier + 1 for earlier, later in pairwise(orders))


@given(st.one_of(PLANS, IN_ORDER), CASES)
def test_a_plan_is_admitted_up_to_its_first_refusal_which_has_a_reason(
    plan: tuple[Step, ...], case: Case
) -> None:
    result = admit(recovery_of(*plan), case, LIMITS)
    assert result.steps == plan[: len(result.steps)]
    assert bool(result.refusals) == (len(result.steps) < len(plan))
    if result.refusals:
        assert result.refusals[0].startswith(f"{plan[len(result.steps)].formation}: ")


@given(IN_ORDER)
def test_an_admitted_plan_still_leads_to_targets_inside_the_workspace(
    plan: tuple[Step, ...],
) -> None:
    goals: Goals = shipped().goals
    for step in admit(recovery_of(*plan), case_after(outcome_of(FIT)), LIMITS).steps:
        goals = goals.updated(step)
        target = goals.target(step.formation)
        assert LIMITS.outside({axis: target[axis] for axis in Axis}) is None


@given(st.floats(-0.09, 0.09), st.floats(-0.045, 0.045))
def test_an_admitted_retreat_never_meets_the_envelope(in_force: float, change: float) -> None:
    goals = shipped().goals.updated(step_to(FIT, {Axis.Y: in_force}))
    step = step_to(FIT, {Axis.Y: in_force + change}, retreat=True)
    case = case_after(outcome_of(FIT, goals=goals), goals)
    robot = ScriptedRobot(pose=goals.target(FIT))
    for admitted_step in admit(recovery_of(step), case, LIMITS).steps:
        target = goals.updated(admitted_step).target(FIT)
        look = Look(observation=robot.observe(), scene=case.outcome.scene)
        try:
            PlanarSkills(taught=shipped().goals)(
                Guarded(robot, LIMITS), partial(_same, look), target, step, Belief()
            )
        except RobotFault as fault:
            pytest.fail(str(fault))


# --- each rule by itself -----------------------------------------------------------------------


def test_the_taught_plan_is_admitted_whole() -> None:
    plan = (goal_step(FIT), goal_step(ALIGN), goal_step(INSERTION))
    assert admitted(*plan) == Admission(steps=plan)


def test_a_plan_may_start_anywhere_from_fit_to_insertion() -> None:
    for start in range(3):
        plan = (goal_step(FIT), goal_step(ALIGN), goal_step(INSERTION))[start:]
        assert admitted(*plan).steps == plan


def test_no_steps_is_an_admission_without_refusal() -> None:
    assert admitted() == Admission(steps=())


@pytest.mark.parametrize("formation", [Formation.APPROACH, Formation.CONTACT])
def test_a_plan_may_not_go_back_before_fit(formation: Formation) -> None:
    step = shipped().goals.step(formation)
    assert admitted(step).refusals == (f"{formation}: a plan may hold fit, align, insertion only",)


@pytest.mark.parametrize(
    ("plan", "kept"),
    [
        ((FIT, INSERTION), 1),
        ((ALIGN, FIT), 1),
        ((FIT, FIT), 1),
        ((FIT, ALIGN, ALIGN), 2),
        ((INSERTION, FIT, ALIGN), 1),
    ],
)
def test_a_plan_out_of_order_is_cut_where_the_order_breaks(
    plan: tuple[Formation, ...], kept: int
) -> None:
    result = admitted(*(goal_step(f) for f in plan))
    assert [s.formation for s in result.steps] == list(plan[:kept])
    assert "out of order" in result.refusals[0]


def test_a_goal_for_an_axis_that_is_not_owned_is_refused() -> None:
    result = admitted(step_to(FIT, {Axis.Y: -0.03, Axis.Z: 0.18}))
    assert not result.steps
    assert "fit does not own" in result.refusals[0]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_goal_that_is_not_finite_is_refused(value: float) -> None:
    assert "finite" in admitted(step_to(FIT, {Axis.Y: value})).refusals[0]


def test_a_goal_outside_the_workspace_is_refused_with_the_workspace() -> None:
    result = admitted(step_to(FIT, {Axis.Y: -0.11}))
    assert result.refusals == ("fit: y -110.0 mm is outside the workspace, -99.0 to 99.0 mm",)


def test_a_goal_further_than_one_step_is_refused_with_how_far() -> None:
    assert admitted(goal_step(FIT, 0.0449)).steps
    result = admitted(goal_step(FIT, 0.046))
    assert result.refusals == ("fit: moves y by +46.0 mm, more than 45 mm",)


def test_reach_is_counted_from_the_goal_in_force_not_from_the_taught_one() -> None:
    goals = shipped().goals.updated(goal_step(FIT, 0.040))
    case = case_after(outcome_of(FIT, goals=goals), goals)
    assert admitted(goal_step(FIT, 0.080), case=case).steps
    assert admitted(goal_step(FIT, -0.010), case=case).refusals


# --- after a compression stop ------------------------------------------------------------------


def stopped(
    formation: Formation,
    *,
    compression_m: float = 0.0203,
    z: float | None = None,
    method: KnownMethod = PLANAR,
) -> Case:
    """Stopped by compression, and standing there, at the taught goal or at height `z` [m]."""
    outcome = outcome_of(formation, stop=Stop.COMPRESSION)
    look = outcome.looks[-1]
    pose = outcome.target if z is None else outcome.target.updated({Axis.Z: z})
    seen = replace(look.observation, pose=pose, compression_m=compression_m)
    outcome = replace(outcome, looks=(replace(look, observation=seen),))
    return replace(case_after(outcome), method=method)


def stopped_insertion() -> Case:
    return stopped(INSERTION)


PRESSES_ON = "presses on after a compression stop: retreat, or unload the wrist first"


@pytest.mark.parametrize("after", [FIT, ALIGN, INSERTION])
@pytest.mark.parametrize("planned", [FIT, ALIGN, INSERTION])
def test_after_a_compression_stop_a_plan_must_not_begin_by_pressing_on(
    after: Formation, planned: Formation
) -> None:
    result = admitted(goal_step(planned), case=stopped(after))
    if after is INSERTION and planned is not INSERTION:  # their goals are higher: they unload
        assert result.steps == (goal_step(planned),)
    else:
        assert result.refusals == (f"{planned}: {PRESSES_ON}",)
    assert admitted(goal_step(planned, retreat=True), case=stopped(after)).steps


@pytest.mark.parametrize("higher", [0.0005, 0.0015, 0.0025, 0.008])
def test_what_rises_by_two_millimetres_unloads(higher: float) -> None:
    here = shipped().goals.target(INSERTION).z + 0.004
    case = stopped(INSERTION, z=here)
    again = step_to(INSERTION, {Axis.Z: here + higher})
    assert bool(admitted(again, case=case).steps) is (higher > 0.002)


def test_contact_cannot_be_planned_after_a_stop_or_ever() -> None:
    refusals = admitted(goal_step(Formation.CONTACT), case=stopped(Formation.CONTACT)).refusals
    assert refusals == ("contact: a plan may hold fit, align, insertion only",)


def test_a_stretched_wrist_is_not_stretched_on_by_a_retreat() -> None:
    here = shipped().goals.target(FIT).z + 0.015
    case = stopped(FIT, compression_m=-0.0204, z=here)
    assert admitted(goal_step(FIT, retreat=True), case=case).refusals
    assert admitted(goal_step(FIT), case=case).steps


def test_guided_skills_unload_by_themselves_unless_they_push() -> None:
    for formation in (FIT, ALIGN):
        assert admitted(goal_step(formation), case=stopped(formation, method=Guided())).steps
    case = stopped(INSERTION, method=Guided())
    assert admitted(goal_step(INSERTION), case=case).refusals == (f"insertion: {PRESSES_ON}",)
    assert admitted(goal_step(ALIGN), goal_step(INSERTION), case=case).refusals == ()


@pytest.mark.parametrize("reasoner", [Rules(), Messages(), Retry(), Sweep()])
@pytest.mark.parametrize("after", [FIT, ALIGN, INSERTION])
def test_no_reasoner_plans_to_press_on(reasoner: Rules, after: Formation) -> None:
    case = stopped(after)
    for tip_y, tip_z in ((0.0, 0.0), (-0.01, -0.004), (0.01, 0.0), (-0.04, 0.0)):
        scene = scene_of(tip_y=tip_y, tip_z=tip_z, tilt_deg=5.0)
        look = replace(case.outcome.looks[-1], scene=scene)
        shown = replace(case, outcome=replace(case.outcome, looks=(look,)))
        plan = reasoner.recover(shown, verdict_of(False))
        assert plan is not None
        assert plan.steps
        assert admit(plan, shown, LIMITS).refusals == ()


def test_no_deeper_insertion_after_a_compression_stop() -> None:
    plan = (goal_step(ALIGN), goal_step(INSERTION, -0.004))
    result = admitted(*plan, case=stopped_insertion())
    assert result.refusals == ("insertion: no deeper after a compression stop unless y changes",)


def test_pushing_as_deep_again_or_less_is_allowed_once_the_wrist_was_unloaded() -> None:
    for deeper in (0.0, 0.005):
        plan = (goal_step(ALIGN), goal_step(INSERTION, deeper))
        assert admitted(*plan, case=stopped_insertion()).steps == plan


def test_realigning_to_the_same_place_does_not_allow_a_deeper_insertion() -> None:
    result = admitted(goal_step(ALIGN), goal_step(INSERTION, -0.004), case=stopped_insertion())
    assert [s.formation for s in result.steps] == [ALIGN]
    assert result.refusals


def test_a_changed_y_allows_a_deeper_insertion() -> None:
    plan = (goal_step(ALIGN, 0.003), goal_step(INSERTION, -0.004))
    assert admitted(*plan, case=stopped_insertion()).steps == plan


def test_without_a_stop_a_deeper_insertion_is_allowed() -> None:
    case = case_after(outcome_of(INSERTION))
    assert admitted(goal_step(INSERTION, -0.004), case=case).steps


@given(st.floats(0.12, 0.20), st.floats(-0.0004, 0.0004))
def test_hidden_behind_any_depth_an_unchanged_y_stays_unchanged(z: float, y: float) -> None:
    case = stopped_insertion()
    steps = admitted(goal_step(ALIGN, y), step_to(INSERTION, {Axis.Z: z}), case=case).steps
    for step in steps:
        if step.formation is INSERTION:
            assert step.goal[Axis.Z] >= case.outcome.target.z - 0.0005


def test_a_stop_is_remembered_over_a_failed_align_at_the_same_place() -> None:
    case = case_after(outcome_of(ALIGN))
    from_before = replace(case, history=(executed(stopped_insertion()),))
    assert not any(
        s.formation is INSERTION
        for s in admitted(goal_step(ALIGN), goal_step(INSERTION, -0.004), case=from_before).steps
    )


def test_passing_fit_on_the_way_to_the_same_place_does_not_allow_a_deeper_insertion() -> None:
    plan = (goal_step(FIT), goal_step(ALIGN), goal_step(INSERTION, -0.004))
    assert [s.formation for s in admitted(*plan, case=stopped_insertion()).steps] == [FIT, ALIGN]


def _same(look: Look) -> Look:
    return look
