"""Shifts of x, pitch and yaw from what is believed: which are admitted, and that they are done."""

import json
import math
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo
from stand_ins import case_after, goal_step, outcome_of, recovery_of
from vlm_cases import asked, asking
from voices import NOTHING_WRONG, reply

from pliant.belief import hang_share
from pliant.conditions import condition
from pliant.envelope import Limits
from pliant.formations import MOST_TURN, Formation, Step
from pliant.levels import load_level
from pliant.methods.guided import Guided
from pliant.methods.guided.hand import HandFrame
from pliant.methods.guided.skills import SHIFTED, SHIFTS
from pliant.pose import Axis, Partial
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import plans, prompt
from pliant.reasoners.vlm.replies import absolute_plan, bounded_plan
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case, Execution, FailureAnalysis, Recovery, Verdict
from pliant.recovery import admit, changes
from pliant.sim.cell import SimCell
from pliant.store import load_case, save_case
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

LIMITS = Limits()
FIT, ALIGN, INSERTION = Formation.FIT, Formation.ALIGN, Formation.INSERTION
ANY = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-0.1, 0.1))
SOME = st.dictionaries(st.sampled_from(SHIFTS), ANY, min_size=1)


def guided() -> Case:
    return replace(case_after(outcome_of(FIT)), method=Guided())


def shifted(formation: Formation, shifts: Partial) -> Step:
    step = goal_step(formation)
    return replace(step, goal={**step.goal, **shifts})


# --- admission -----------------------------------------------------------------------------------


@given(st.tuples(*(st.one_of(st.just({}), SOME) for _ in range(3))))
def test_of_any_shifts_those_within_the_limits_are_admitted_and_only_at_fit_and_align(
    shifts: tuple[dict[Axis, float], ...],
) -> None:
    plan = tuple(shifted(f, s) for f, s in zip((FIT, ALIGN, INSERTION), shifts, strict=True))
    result = admit(recovery_of(*plan), guided(), LIMITS)

    def fine(step: Step) -> bool:
        return all(
            axis in SHIFTED[step.formation]
            and abs(value) <= (MOST_TURN if axis.is_angle else LIMITS.high.x - 0.001)
            for axis, value in step.goal.items()
            if axis in SHIFTS
        )

    first = next((n for n, step in enumerate(plan) if not fine(step)), len(plan))
    assert result.steps == plan[:first]
    assert len(result.refusals) == (first < len(plan))


@given(st.sampled_from([FIT, ALIGN]), SOME)
def test_the_papers_skills_take_no_shift(formation: Formation, shifts: dict[Axis, float]) -> None:
    planar = case_after(outcome_of(FIT))
    result = admit(recovery_of(shifted(formation, shifts)), planar, LIMITS)
    assert not result.steps
    assert f"which {formation} does not own" in result.refusals[0]


def test_a_shift_is_refused_with_how_far() -> None:
    step = shifted(FIT, {Axis.YAW: math.radians(6)})
    assert admit(recovery_of(step), guided(), LIMITS).refusals == (
        "fit: moves yaw by +6.0 deg, more than 5 deg",
    )


def test_goals_keep_no_shift() -> None:
    goals = shipped().goals
    step = shifted(ALIGN, {Axis.X: 0.002, Axis.YAW: 0.05})
    assert goals.updated(step) == goals


# --- what a model says ---------------------------------------------------------------------------


def bounded(**fields: Any) -> Any:
    form = bounded_plan(40, Guided())
    told = dict.fromkeys(form.model_fields, 0) | {"resume_from": "fit", "retreat_first": False}
    return form.model_validate_json(json.dumps({**told, **fields}))


def refused(said: Any, **suggested: float) -> str | None:
    motion = {Axis(axis): value for axis, value in suggested.items()}
    analysis = FailureAnalysis(what="", why="", how="", motion=motion)
    steps = plans.steps_of(said, guided())
    recovery = Recovery(analysis=analysis, steps=steps, by="vlm")
    return plans.refusal(recovery, guided(), LIMITS, 0.040)


def test_no_shift_is_the_plan_without_any() -> None:
    assert plans.steps_of(bounded(), guided()) == tuple(map(goal_step, (FIT, ALIGN, INSERTION)))


def test_a_shift_against_its_own_analysis_is_refused() -> None:
    against = refused(bounded(fit_yaw_change_deg=3), yaw=math.radians(-3))
    assert against == "fit: changes yaw by +3.0 deg, but the analysis says -3.0 deg"
    assert refused(bounded(fit_yaw_change_deg=3), yaw=math.radians(3)) is None
    assert refused(bounded(fit_yaw_change_deg=5, align_x_change_mm=-28)) is None


def test_a_shift_of_insertion_is_refused_and_not_dropped() -> None:
    step = {"goal_mm": 167.6, "retreat_first": False, "x_mm": 1, "pitch_deg": 0, "yaw_deg": 0}
    plan = {"steps": [{"skill": "insertion", **step}]}
    said = absolute_plan(Guided()).model_validate_json(json.dumps(plan))
    assert "insertion does not own" in str(refused(said))


def test_a_shift_that_is_too_much_is_cut_down_with_the_rest_of_its_plan() -> None:
    far = shifted(FIT, {Axis.X: 0.1, Axis.PITCH: -1.0, Axis.YAW: 0.02})
    far = replace(far, goal={**far.goal, **goal_step(FIT, -0.12).goal})
    proposal = recovery_of(far, goal_step(ALIGN), goal_step(INSERTION))
    evidence = recovery_of(goal_step(FIT, -0.012), goal_step(ALIGN), goal_step(INSERTION))
    cut = plans.clamped(proposal, evidence, guided(), LIMITS, 0.010)
    assert cut is not None
    assert cut.clamped == proposal.steps
    assert changes(cut.steps[0], guided()) == pytest.approx(
        {Axis.Y: -0.010, Axis.X: 0.010, Axis.PITCH: -MOST_TURN, Axis.YAW: 0.02}
    )


# --- done ----------------------------------------------------------------------------------------

FIT_SHIFT = {Axis.X: 0.002, Axis.PITCH: math.radians(4), Axis.YAW: math.radians(4)}
ALIGN_SHIFT = {Axis.X: -0.003, Axis.PITCH: math.radians(-3), Axis.YAW: math.radians(-3)}

ABOUT = math.radians(1.5)  # of the hand: the belief moves on by as much, and shifts are larger


@dataclass
class Shifting:
    """Sees the first Fit and the first Align fail. Its model then shifts them: Fit by a bounded
    plan, Align by an absolute one."""

    name: str = "shifting"
    asked: list[Case] = field(default_factory=list)

    def judge(self, case: Case) -> Verdict:
        formation = case.outcome.step.formation
        again = any(e.formation is formation for e in case.history)
        failed = bool(SHIFTED[formation]) and not again
        return replace(Rules().judge(case), success=not failed)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        self.asked.append(case)
        form = Plans.BOUNDED if case.outcome.step.formation is FIT else Plans.ABSOLUTE
        return asking(self.answer, plan=form, fallback=False).recover(case, verdict)

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        fields: dict[str, Any] = {}
        if "plan" not in asked(messages):
            zero = ("x_motion_mm", "pitch_motion_deg", "yaw_motion_deg")
            return reply(info, NOTHING_WRONG | dict.fromkeys(zero, 0))
        case = self.asked[-1]
        if case.outcome.step.formation is FIT:
            fields = dict.fromkeys(bounded_plan(40, Guided()).model_fields, 0)
            shift = {"fit_x_change_mm": 2, "fit_pitch_change_deg": 4, "fit_yaw_change_deg": 4}
            return reply(info, fields | {"resume_from": "fit", "retreat_first": True} | shift)
        shifts = {"x_mm": -3, "pitch_deg": -3, "yaw_deg": -3}
        steps = [
            {
                "skill": str(formation),
                "goal_mm": next(iter(case.goals.formations[formation].values())) * 1e3,
                "retreat_first": False,
                **(shifts if formation is ALIGN else dict.fromkeys(shifts, 0)),
            }
            for formation in (ALIGN, INSERTION)
        ]
        return reply(info, {"steps": steps})


@cache
def done() -> tuple[tuple[Execution, ...], Shifting]:
    """Approach, Contact, Fit, Fit shifted, Align, Align shifted."""
    task, taught, reasoner = load_task("circle", "L1"), shipped(), Shifting()
    run = Run(
        robot=SimCell().prepare(task, load_level("L1").on(condition("all")).draw(9003)),
        task=task,
        teaching=taught.for_task(task),
        reasoner=reasoner,
        method=Guided(),
    )
    executions = iter(run)
    made = tuple(next(executions) for _ in range(6))
    executions.close()
    return made, reasoner


def aimed(execution: Execution) -> dict[Axis, float]:
    """Where the hand was at the end, from what is believed."""
    belief, hand = execution.belief, execution.outcome.motions[-1].commanded
    assert belief.hole_x is not None
    assert belief.hole_y is not None
    assert belief.upright_pitch is not None
    upright = belief.upright_pitch.value
    yaw = belief.board_yaw.value if belief.board_yaw is not None else 0.0
    inside = HandFrame(x=belief.hole_x.value, y=belief.hole_y.value, z=0.0, yaw=yaw).inside(hand)
    over = load_task("circle", "L1").grasp_below_hinge * math.sin(hang_share(shipped()) * upright)
    return {Axis.X: inside.x - over, Axis.PITCH: inside.pitch - upright, Axis.YAW: inside.yaw}


def test_a_bounded_plan_shifts_where_fit_touches_down() -> None:
    fit = done()[0][3]
    assert fit.outcome.step.retreat
    assert {a: fit.outcome.step.goal[a] for a in SHIFTS} == pytest.approx(FIT_SHIFT)
    for axis in (Axis.PITCH, Axis.YAW):
        assert aimed(fit)[axis] == pytest.approx(FIT_SHIFT[axis], abs=ABOUT)
    steps = [
        (later.commanded.x - motion.ended.x, later.commanded.y - motion.ended.y)
        for motion, later in pairwise(fit.outcome.motions)
        if later.commanded.z == motion.commanded.z
    ]
    assert any(math.hypot(x - 0.002, y) < 0.0003 for x, y in steps)


def test_an_absolute_plan_shifts_where_align_holds_the_hand() -> None:
    align = done()[0][5]
    assert {a: align.outcome.step.goal[a] for a in SHIFTS} == pytest.approx(ALIGN_SHIFT)
    for axis, off in ((Axis.X, 0.0007), *((a, ABOUT) for a in SHIFTS[1:])):
        assert aimed(align)[axis] == pytest.approx(ALIGN_SHIFT[axis], abs=off)


def test_a_shift_is_stored_and_told_in_the_history(tmp_path: Path) -> None:
    case = done()[1].asked[-1]
    content = prompt.situation(case, Settings(model="scripted"), asked="")
    told = "\n".join(item for item in content if isinstance(item, str))
    assert "x_mm 2.0, pitch_deg 4.0, yaw_deg 4.0 |" in told
    save_case(tmp_path, case)
    assert [e.outcome.step for e in load_case(tmp_path).history] == [
        e.outcome.step for e in case.history
    ]
