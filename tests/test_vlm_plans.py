"""From replies to steps: what a plan may say, what is refused and why, and what is cut down."""

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError
from stand_ins import goal_step, recovery_of
from vlm_cases import failures, simulated, wedged
from voices import NOTHING_WRONG

from pliant.envelope import Limits
from pliant.formations import Formation, Step
from pliant.methods.planar import Planar
from pliant.pose import Axis
from pliant.reasoners.vlm import plans
from pliant.reasoners.vlm.replies import (
    AbsolutePlan,
    Analysis,
    Judgement,
    bounded_plan,
    with_analysis,
)
from pliant.records import Case, FailureAnalysis, Recovery
from pliant.recovery import admit, changes

MOST_M = 0.040
BOUNDED = bounded_plan(40, Planar())
FIT, ALIGN, INSERTION = Formation.FIT, Formation.ALIGN, Formation.INSERTION


def fit_case() -> Case:
    return simulated().recovered[0][0]


def bounded(**fields: Any) -> BaseModel:
    zero = {"fit_y_change_mm": 0, "align_y_change_mm": 0, "insertion_z_change_mm": 0}
    return BOUNDED.model_validate_json(
        json.dumps({"resume_from": "fit", "retreat_first": False, **zero, **fields})
    )


def absolute(*steps: tuple[str, float]) -> BaseModel:
    told = [{"skill": s, "goal_mm": mm, "retreat_first": False} for s, mm in steps]
    return AbsolutePlan.model_validate_json(json.dumps({"steps": told}))


def proposed(said: BaseModel, case: Case, *, y_mm: float = 0.0) -> Recovery:
    changes = {FIT: {Axis.Y: y_mm * 1e-3}}
    analysis = FailureAnalysis(what="", why="", how="", motion={}, changes=changes)
    return Recovery(analysis=analysis, steps=plans.steps_of(said, case), by="vlm")


def why(said: BaseModel, case: Case, *, y_mm: float = 0.0) -> str | None:
    return plans.refusal(proposed(said, case, y_mm=y_mm), case, Limits(), MOST_M)


# --- structure -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    ['"0.15"', "NaN", "Infinity", "1e309", "true", "null", "1e9", "-1001", "1" * 400, "[]", '"mm"'],
)
def test_what_is_no_plausible_number_of_millimetres_is_refused(value: str) -> None:
    step = f'{{"skill": "fit", "goal_mm": {value}, "retreat_first": false}}'
    with pytest.raises(ValidationError):
        AbsolutePlan.model_validate_json(f'{{"steps": [{step}]}}')
    with pytest.raises(ValidationError):
        bounded(fit_y_change_mm=json.loads(value) if value != "1e309" else 1e309)
    with pytest.raises(ValidationError):
        Analysis.model_validate_json(
            json.dumps({**NOTHING_WRONG, "fit_y_change_mm": 0}).replace(
                '"fit_y_change_mm": 0', f'"fit_y_change_mm": {value}'
            )
        )


def test_a_half_millimetre_is_no_whole_one_and_unknown_fields_are_refused() -> None:
    with pytest.raises(ValidationError):
        bounded(fit_y_change_mm=0.5)
    with pytest.raises(ValidationError):
        bounded(fit_y_change_m=0.005)
    with pytest.raises(ValidationError):
        absolute(("approach", 10.0))


def test_words_cannot_drive_a_terminal_and_stay_readable_in_any_language() -> None:
    said = dict.fromkeys(("pose_check", "compression_check", "table_i", "picture"), "failure")
    told = "\x1b[2J穴の\u3000左 \u202eright\tto\nleft می\u200cشود"
    judged = Judgement.model_validate({**said, "conflict": "", "reason": told, "success": False})
    assert judged.reason == "\N{REPLACEMENT CHARACTER}[2J穴の 左 �right to\nleft می\u200cشود"


def test_the_schema_bounds_every_change_and_the_analysis_comes_first() -> None:
    fields = BOUNDED.model_json_schema()["properties"]
    for name in ("fit_y_change_mm", "align_y_change_mm", "insertion_z_change_mm"):
        assert (fields[name]["minimum"], fields[name]["maximum"]) == (-40, 40)
    both = list(with_analysis(BOUNDED).model_json_schema()["properties"])
    assert both.index("why") < both.index("resume_from")


# --- steps ---------------------------------------------------------------------------------------


def test_a_bounded_plan_runs_from_where_it_resumes_and_retreats_once() -> None:
    case = fit_case()
    said = bounded(resume_from="align", retreat_first=True, fit_y_change_mm=9, align_y_change_mm=-3)
    align, insertion = plans.steps_of(said, case)
    now = case.goals.formations
    assert (align.formation, align.retreat) == (ALIGN, True)
    assert align.goal[Axis.Y] == pytest.approx(now[ALIGN][Axis.Y] - 0.003)
    assert (insertion.formation, insertion.retreat) == (INSERTION, False)
    assert insertion.goal == now[INSERTION]


def test_stop_and_an_empty_list_are_no_steps() -> None:
    assert plans.steps_of(bounded(resume_from="stop", fit_y_change_mm=40), fit_case()) == ()
    assert plans.steps_of(absolute(), fit_case()) == ()
    assert why(absolute(), fit_case()) is None


@given(
    st.integers(-40, 40),
    st.integers(-40, 40),
    st.integers(-40, 40),
    st.sampled_from(["fit", "align", "insertion"]),
    st.integers(0, 3),
)
def test_a_bounded_plan_within_its_bounds_is_refused_for_place_or_resistance_only(
    fit: int, align: int, insertion: int, start: str, number: int
) -> None:
    cases = failures()
    case = cases[number % len(cases)][0]
    said = bounded(
        resume_from=start,
        fit_y_change_mm=fit,
        align_y_change_mm=align,
        insertion_z_change_mm=insertion,
    )
    reason = why(said, case)
    assert reason is None or "workspace" in reason or "compression stop" in reason
    if reason is None:
        steps = plans.steps_of(said, case)
        assert admit(recovery_of(*steps), case, Limits()).steps == steps


# --- refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("steps", "says"),
    [
        ((("align", 0.0), ("fit", -35.2)), "out of order"),
        ((("fit", -35.2), ("insertion", 167.6)), "out of order"),
        ((("fit", -35.2), ("fit", -35.2)), "out of order"),
        ((("fit", -35.2), ("align", 0.0)), "a plan ends with insertion"),
        ((("fit", -85.2), ("align", 0.0), ("insertion", 167.6)), "more than 40 mm"),
        ((("insertion", 100.0),), "outside the workspace"),
    ],
)
def test_a_plan_that_may_not_be_done_is_refused_with_the_reason(
    steps: tuple[tuple[str, float], ...], says: str
) -> None:
    reason = why(absolute(*steps), fit_case())
    assert reason is not None
    assert says in reason


def test_a_goal_in_metres_is_asked_again_and_never_rescaled() -> None:
    case = fit_case()
    said = absolute(("fit", -0.0352), ("align", 0.0), ("insertion", 0.1676))
    reason = plans.in_metres(plans.steps_of(said, case), case)
    assert reason is not None
    assert "looks like metres" in reason
    for fine in (absolute(("fit", -0.1), ("align", 0.0)), bounded(fit_y_change_mm=35)):
        goals = case.goals.updated(Step(formation=FIT, goal={Axis.Y: 0.001}))
        assert plans.in_metres(plans.steps_of(fine, case), replace(case, goals=goals)) is None


def test_a_plan_against_its_own_analysis_is_refused() -> None:
    reason = why(bounded(fit_y_change_mm=5), fit_case(), y_mm=-4.0)
    assert reason == "fit: changes y by +5.0 mm, but the analysis says -4.0 mm"
    assert why(bounded(fit_y_change_mm=5), fit_case(), y_mm=4.0) is None
    assert why(bounded(fit_y_change_mm=5), fit_case(), y_mm=0.0) is None
    assert why(bounded(fit_y_change_mm=0), fit_case(), y_mm=4.0) is None


def test_after_a_compression_stop_deeper_needs_another_y() -> None:
    deeper = bounded(resume_from="insertion", insertion_z_change_mm=-4)
    assert "no deeper" in str(why(deeper, wedged()))
    moved = bounded(resume_from="align", align_y_change_mm=3, insertion_z_change_mm=-4)
    assert why(moved, wedged()) is None


# --- cut down ------------------------------------------------------------------------------------


def cut(proposal: tuple[Step, ...], evidence: tuple[Step, ...], most_m: float = 0.010) -> Any:
    case = fit_case()
    return plans.clamped(recovery_of(*proposal), recovery_of(*evidence), case, Limits(), most_m)


def plan(fit: float, align: float = 0.0, insertion: float = 0.0) -> tuple[Step, ...]:
    now = fit_case().goals.formations
    changes = ((FIT, Axis.Y, fit), (ALIGN, Axis.Y, align), (INSERTION, Axis.Z, insertion))
    return tuple(
        Step(formation=f, goal={axis: now[f][axis] + change}) for f, axis, change in changes
    )


def test_too_much_in_the_right_direction_is_cut_down_and_the_proposal_kept() -> None:
    far, right = plan(-0.120, -0.05, 0.002), plan(-0.012, -0.005)
    done = cut(far, right)
    fit, align, insertion = (changes(s, fit_case()) for s in done.steps)
    assert fit[Axis.Y] == pytest.approx(-0.010)
    assert align[Axis.Y] == pytest.approx(-0.010)
    assert insertion[Axis.Z] == pytest.approx(0.002)
    assert done.clamped == far
    assert admit(done, fit_case(), Limits()).steps == done.steps


@pytest.mark.parametrize(
    ("proposal", "evidence"),
    [
        (plan(0.120), plan(-0.012)),
        (plan(-0.120, 0.09), plan(-0.012, -0.005)),
        (plan(-0.120), plan(0.0)),
        (plan(-0.120), plan(-0.012)[1:]),
        (plan(-0.120)[::-1], plan(-0.012)),
        (plan(-0.120)[:2], plan(-0.012)),
        (plan(-0.120), ()),
        ((), plan(-0.012)),
    ],
    ids=["away", "later away", "nowhere", "elsewhere", "disorder", "unfinished", "stop", "none"],
)
def test_what_goes_another_way_than_the_evidence_is_not_cut_down(
    proposal: tuple[Step, ...], evidence: tuple[Step, ...]
) -> None:
    assert cut(proposal, evidence) is None


def test_nothing_is_cut_down_without_evidence() -> None:
    far = recovery_of(goal_step(FIT, -0.12))
    assert plans.clamped(far, None, fit_case(), Limits(), 0.01) is None
