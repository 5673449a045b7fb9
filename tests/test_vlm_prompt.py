"""What a model is told and shown, what each switch withholds, and what it never learns."""

import re
from dataclasses import replace

import pytest
from pydantic_ai.messages import BinaryContent, ModelMessage, ModelResponse, UserContent
from pydantic_ai.models.function import AgentInfo
from stand_ins import outcome_of
from vlm_cases import asking, checked, simulated, wedged
from voices import SpeaksForRules

from pliant.formations import Formation
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case, Exchange

ALL = Settings(model="scripted", measurements=True, deadline_s=20)
PAPER = Settings(model="scripted", deadline_s=20)


def failed() -> Case:
    """Fit that failed, after others."""
    case = simulated().recovered[1][0]
    assert case.outcome.step.formation is Formation.FIT
    return case


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
    told = words(prompt.situation(failed(), PAPER))
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
    told = words(prompt.situation(case, replace(PAPER, history=2)))
    rows = re.findall(r"^\| (\d) \| (\w+) .*\| (success|failure) \|$", told, re.MULTILINE)
    assert rows == [("2", "contact", "success"), ("3", "fit", "failure")]
    assert "Earlier" not in words(prompt.situation(case, replace(PAPER, history=0)))


def test_numbers_in_words_do_not_tell_zero_from_almost_zero() -> None:
    """The last digits of a simulation differ between machines; its recordings must not."""
    goals = simulated().judged[0].goals
    told = set()
    for y in (-4e-5, -1e-9, 0.0, 4e-5):
        ended = replace(goals.target(Formation.ALIGN), y=y)
        case = checked(outcome_of(Formation.ALIGN, ended=ended))
        told.add(words(prompt.situation(case, replace(PAPER, pose_check=False))))
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
    for case in (failed(), wedged()):
        settings = replace(PAPER, picture=False, goal_picture=False)
        assert not any(e.pictures for e in exchanges_of(settings, case))


def test_the_goal_picture_is_shown_when_insertion_is_judged_and_says_which_peg() -> None:
    judged, *rest = exchanges_of(PAPER, wedged())
    assert len(judged.pictures) == 2
    shown = wedged().teaching.demonstrations[Formation.INSERTION]
    assert f"succeeded with the {shown.peg} peg" in judged.request
    assert (judged.pictures[0] == shown.view.image).all()
    assert all(len(e.pictures) == 1 for e in rest)
    fit, *_ = exchanges_of(PAPER, failed())
    assert len(fit.pictures) == 1
    without, *_ = exchanges_of(replace(PAPER, goal_picture=False), wedged())
    assert len(without.pictures) == 1
    assert "Goal picture" not in without.request


def test_a_model_is_told_none_of_what_only_pliant_measures_or_knows() -> None:
    """As in the paper: pictures, poses, compression and Table I."""
    for case in (failed(), wedged()):
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
        for case in (simulated().judged[0], failed())
    ]
    assert first[0] == first[1]
    assert len(first[0]) > 1000


def test_instructions_hold_the_task_and_the_limits_in_words() -> None:
    task = failed().task
    for plan in Plans:
        settings = replace(PAPER, plan=plan, step_limit_mm=25.0)
        text = prompt.instructions(settings, failed(), "analyse", f"plan_{plan}")
        assert "25 mm" in text or "±25" in text
        assert "$" not in text
        assert f"the {task.peg.name}" in text


def test_pictures_are_png_and_marked_for_no_provider() -> None:
    (picture,) = pictures(prompt.situation(failed(), PAPER))
    assert picture.media_type == "image/png"
    assert picture.data.startswith(b"\x89PNG")
    assert picture.vendor_metadata is None
