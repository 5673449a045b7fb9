"""What a model is told and shown, what each switch withholds, and what it never learns."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from pydantic_ai.messages import BinaryContent, ModelMessage, ModelResponse, UserContent
from pydantic_ai.models.function import AgentInfo
from stand_ins import outcome_of
from vlm_cases import asking, checked, shallow, simulated, wedged
from voices import SpeaksForRules

from pliant.envelope import Limits
from pliant.formations import RECOVERABLE, Formation
from pliant.pose import Axis, Pose
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case, Exchange, FailureAnalysis
from pliant.task import BLOCK_SIZE, load_task
from pliant.vision.measure import PAPER as PAINTED
from pliant.vision.measure import SIMULATED

ALL = Settings(model="scripted", measurements=True, deadline_s=20)
PAPER = Settings(model="scripted", deadline_s=20)


def failed() -> Case:
    """Fit that failed, after others."""
    case = simulated().recovered[1][0]
    assert case.outcome.step.formation is Formation.FIT
    return case


ABOVE = np.full((48, 64, 3), 90, np.uint8)


def taken_from_above(case: Case) -> Case:
    """The case, whose first execution took a picture with the oblique camera, too."""
    first, *rest = case.history
    look, *others = first.outcome.looks
    view = replace(look.observation.views["side"], image=ABOVE)
    views = {**look.observation.views, "oblique": view}
    look = replace(look, observation=replace(look.observation, views=views))
    first = replace(first, outcome=replace(first.outcome, looks=(look, *others)))
    return replace(case, history=(first, *rest))


def words(content: list[UserContent]) -> str:
    return "\n".join(item for item in content if isinstance(item, str))


def pictures(content: list[UserContent]) -> list[BinaryContent]:
    return [item for item in content if isinstance(item, BinaryContent)]


def exchanges_of(settings: Settings, case: Case) -> list[Exchange]:
    """What is exchanged to judge a case, and to recover from it."""
    mind = SpeaksForRules(settings=settings)
    verdict = mind.judge(case)
    recovery = mind.recover(case, replace(verdict, success=False))
    assert recovery is not None
    return [*verdict.exchanges, *recovery.exchanges]


# --- told ----------------------------------------------------------------------------------------


def test_the_papers_evidence_is_told_with_its_units() -> None:
    told = words(prompt.situation(failed(), PAPER, asked=""))
    for line in (
        r"goal: y_mm -?\d+\.\d\n",
        r"terminal pose: y_mm -?\d+\.\d, z_mm \d+\.\d, roll_deg \d+\.\d\n",
        r"skill: .*, peak_compression_mm \d+\.\d\n",
        r"pose_check: (success|failure) \(",
        r"compression_check: (success|failure) \(",
        r"table_i: (success|failure)",
        r"\| approach \| y_mm \d+\.\d, z_mm \d+\.\d, roll_deg \d+\.\d \|",
    ):
        assert re.search(line, told), (line, told)


def test_earlier_executions_are_a_table_of_the_last_ones() -> None:
    case = failed()
    assert len(case.history) == 3
    told = words(prompt.situation(case, replace(PAPER, history=2), asked=""))
    rows = re.findall(r"^\| (\d) \| (\w+) .*\| (success|failure) \|$", told, re.MULTILINE)
    assert rows == [("2", "contact", "success"), ("3", "fit", "failure")]
    assert "Earlier" not in words(prompt.situation(case, replace(PAPER, history=0), asked=""))


def test_numbers_in_words_do_not_tell_zero_from_almost_zero() -> None:
    """The last digits of a simulation differ between machines; its recordings must not."""
    goals = simulated().judged[0].goals
    told = set()
    for y in (-4e-5, -1e-9, 0.0, 4e-5):
        ended = replace(goals.target(Formation.ALIGN), y=y)
        case = checked(outcome_of(Formation.ALIGN, ended=ended))
        told.add(words(prompt.situation(case, replace(PAPER, pose_check=False), asked="")))
    assert len(told) == 1
    assert "-0.0" not in told.pop()


# --- withheld ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("switch", "withheld"),
    [
        ({"pose_check": False}, "pose_check:"),
        ({"table_i": False}, "table_i:"),
        ({"history": 0}, "## Earlier executions"),
        ({"measurements": False}, "tip_y_mm"),
        ({"measurements": False}, "metric check"),
    ],
)
def test_a_switch_withholds_its_source_from_every_request(
    switch: dict[str, object], withheld: str
) -> None:
    everything = [e.request for e in exchanges_of(ALL, failed())]
    assert all(withheld in request for request in everything)
    rest = [e.request for e in exchanges_of(replace(ALL, **switch), failed())]  # type: ignore[arg-type]
    assert not any(withheld in request for request in rest)


@pytest.mark.parametrize("judge", ["rules", "checks"])
def test_the_words_of_another_judge_do_not_tell_what_is_withheld(judge: str) -> None:
    case = failed()
    said = Rules().judge(case)
    assert "mm" in said.reason
    heard: list[str] = []

    def hear(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        heard.append(str(messages))
        raise ConnectionError

    mind = asking(hear, table_i=False)
    mind.recover(case, replace(said, by=judge, conflict="table_i disagreed"))
    assert said.reason not in heard[0]
    assert "disagreed" not in heard[0]
    assert f"judged by {judge}" in heard[0]


def test_without_pictures_none_is_sent() -> None:
    for case in (failed(), shallow()):
        settings = replace(PAPER, picture=False, goal_picture=False)
        assert not any(e.pictures for e in exchanges_of(settings, case))


def test_the_picture_from_above_is_shown_if_asked_for_where_one_was_taken() -> None:
    shown = replace(PAPER, oblique_picture=True)
    above = exchanges_of(shown, taken_from_above(failed()))
    assert all("from above and aside" in e.request for e in above)
    assert all((e.pictures[-1] == ABOVE).all() for e in above)
    for settings, case in ((shown, failed()), (PAPER, taken_from_above(failed()))):
        assert not any("from above" in e.request for e in exchanges_of(settings, case))


def test_the_goal_picture_is_shown_when_insertion_is_judged_and_says_which_peg() -> None:
    judged, *rest = exchanges_of(PAPER, shallow())
    assert len(judged.pictures) == 2
    shown = shallow().teaching.demonstrations[Formation.INSERTION]
    assert f"succeeded with the {shown.peg} peg" in judged.request
    assert (judged.pictures[0] == shown.view.image).all()
    assert all(len(e.pictures) == 1 for e in rest)
    fit, *_ = exchanges_of(PAPER, failed())
    assert len(fit.pictures) == 1
    without, *_ = exchanges_of(replace(PAPER, goal_picture=False), shallow())
    assert len(without.pictures) == 1
    assert "Goal picture" not in without.request


def test_a_model_is_told_none_of_what_only_pliant_measures_or_knows() -> None:
    """As in the paper: pictures, poses, compression and Table I."""
    for case in (failed(), shallow()):
        metric = case.evidence["metric"]
        assert metric is not None
        for exchange in exchanges_of(PAPER, case):
            for name in ("metric", "goal_picture", "hole: y_mm", "truth", metric.message):
                if exchange.stage == "judge":  # later its own words come back, whatever they hold
                    assert name not in exchange.request


# --- in which order ------------------------------------------------------------------------------


def test_the_static_part_comes_first_and_is_the_same_for_every_case() -> None:
    first = [
        exchanges_of(PAPER, case)[0].request.partition("## Current goals")[0]
        for case in (simulated().judged[2], failed())
    ]
    assert first[0] == first[1]
    assert len(first[0]) > 1000


def test_instructions_hold_the_task_and_the_limits_in_words() -> None:
    task = failed().task
    for plan in Plans:
        settings = replace(PAPER, plan=plan, step_limit_mm=25.0)
        text = prompt.instructions(settings, failed(), Limits())
        assert "25 mm" in text or "±25" in text
        assert "$" not in text
        assert f"the {task.peg.name}" in text


def test_pictures_are_png_and_marked_for_no_provider() -> None:
    (picture,) = pictures(prompt.situation(failed(), PAPER, asked=""))
    assert picture.media_type == "image/png"
    assert picture.data.startswith(b"\x89PNG")
    assert picture.vendor_metadata is None


# --- figures -------------------------------------------------------------------------------------


def test_pixels_can_be_turned_into_millimetres_by_what_is_told() -> None:
    """A place on the peg and on the block, as the prompt says to read them, is where it is."""
    case = failed()
    camera = case.outcome.looks[-1].observation.views["side"].camera
    told = prompt.instructions(PAPER, case, Limits())
    zero = float(re.findall(r"y = 0 is column (\d+)", told)[0])
    at_peg, at_block = map(float, re.findall(r"(\d\.\d\d) px per mm", told))
    for x, scale in ((0.0, at_peg), (BLOCK_SIZE[0] / 2, at_block)):
        column, _ = camera.project(np.array([x, 0.015, 0.0]))
        assert (column - zero) / scale == pytest.approx(15.0, abs=0.1)


@pytest.mark.parametrize(
    ("peg", "width_mm", "hole_mm", "left_mm"),
    [("circle", 40, 42, 80), ("rectangle_narrow", 20, 22, 80)],
)
def test_the_sizes_of_peg_and_hole_are_told_and_what_success_leaves_to_be_seen(
    peg: str, width_mm: int, hole_mm: int, left_mm: int
) -> None:
    told = prompt.instructions(PAPER, replace(failed(), task=load_task(peg)), Limits())
    assert f"The peg is {width_mm} mm wide and 90 mm long" in told
    assert f"the block's top edge, {hole_mm} mm wide, 2 mm (3.0 px) more than the peg" in told
    assert f"at most {left_mm} mm (122 px) of the peg are left above the block" in told


def test_the_colours_are_those_that_the_sight_goes_by() -> None:
    case = failed()
    for colours, said in (
        (SIMULATED, "The peg is cyan, the block with the hole is red."),
        (PAINTED, "The peg is green, the block with the hole is red."),
        (None, "Colours, light and background may be anything"),
    ):
        assert said in prompt.instructions(PAPER, replace(case, colours=colours), Limits())


@pytest.mark.parametrize("limit_mm", [12, 20])
def test_the_compression_limit_is_told_as_the_cell_has_it(limit_mm: int) -> None:
    limits = replace(Limits(), compression_m=limit_mm * 1e-3)
    told = prompt.instructions(PAPER, failed(), limits)
    assert f"compressed by {limit_mm} mm from free hang" in told


def test_a_lean_is_worth_what_the_hinge_s_lever_says() -> None:
    told = prompt.instructions(PAPER, failed(), Limits())
    lever_mm = 1e3 * failed().task.tip_below_hinge * math.radians(1.0)
    assert f"align's y moves by {lever_mm:.1f} mm for each degree" in told


def test_all_requests_of_a_trial_begin_with_the_same_words() -> None:
    """So that servers can cache them; providers do so from 1,024 tokens."""
    stages = exchanges_of(PAPER, failed())
    assert [e.stage for e in stages] == ["judge", "analyse", "plan"]
    first = prompt.instructions(PAPER, failed(), Limits())
    assert all(e.request.startswith(first) for e in stages)
    assert len(first) > 4 * 1024


# --- not asked -----------------------------------------------------------------------------------


def test_no_model_is_asked_of_what_the_paper_takes_to_succeed_or_of_a_compression_stop() -> None:
    asked = [c for c in simulated().judged if SpeaksForRules(settings=PAPER).judge(c).is_asked]
    assert {c.outcome.step.formation for c in asked} == {*RECOVERABLE}
    stopped = SpeaksForRules(settings=PAPER).judge(wedged())
    assert (stopped.by, stopped.success, stopped.is_asked) == ("checks", False, False)
    assert stopped.reason.startswith("compression: limit reached")


def test_contact_that_did_not_get_there_is_a_failure_without_a_model() -> None:
    short = Pose(y=0.0, z=0.3)
    verdict = SpeaksForRules(settings=PAPER).judge(
        checked(outcome_of(Formation.CONTACT, ended=short))
    )
    assert (verdict.by, verdict.success) == ("checks", False)


def test_pictures_are_shrunk_to_the_width_that_is_asked_for() -> None:
    asked = replace(PAPER, picture_px=384)
    (picture,) = pictures(prompt.situation(failed(), asked, asked=""))
    assert prompt.shown(picture).shape == (288, 384, 3)


def test_in_brief_the_static_part_says_the_task_and_nothing_else() -> None:
    told = prompt.instructions(replace(PAPER, brief=True), failed(), Limits())
    assert "the circle, 90 mm long and 40 mm wide" in told
    assert "Method: planar" in told
    assert len(told) < 400


def test_in_brief_the_situation_is_told_in_few_words_and_holds_the_same_facts() -> None:
    full = prompt.situation(failed(), PAPER, asked="plan.")
    short = prompt.situation(failed(), replace(PAPER, brief=True), asked="plan.")
    told = str(short[0])
    case = failed()
    assert f"fit y {case.goals.formations[Formation.FIT][Axis.Y] * 1e3:.1f}" in told
    assert f"no {len(case.history) + 1}, {case.outcome.step.formation}" in told
    assert len(told) < len(str(full[0])) / 2
    assert short[-1] == "Asked: plan."


def test_in_brief_a_change_of_a_goal_is_told_with_the_goal_that_it_leads_to() -> None:
    case = failed()
    by = {Formation.FIT: {Axis.Y: -0.012, Axis.X: 0.001}, Formation.ALIGN: {Axis.PITCH: 0.1}}
    analysis = FailureAnalysis(what="", why="", how="", motion={}, changes=by)
    told = words(
        prompt.situation(case, replace(PAPER, brief=True), asked="plan.", analysis=analysis)
    )
    goal_mm = (case.goals.formations[Formation.FIT][Axis.Y] - 0.012) * 1e3
    assert f"Changes: fit y -12.0 mm, x 1.0 mm, to y {goal_mm:.1f}; align pitch 5.7 deg\n" in told
