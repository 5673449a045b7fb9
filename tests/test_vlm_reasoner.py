"""The VLM as a reasoner: what is its own, when it is asked again, cut down or replaced, and what it
may spend."""

import asyncio
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tyro
from loopback import Handler, Loopback, loopback
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo
from vlm_cases import asking, failures, shallow, simulated
from voices import NOTHING_WRONG, Silent, SpeaksForRules, TenTimes, analysis, reply

from pliant.cli.model import ModelOptions
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.formations import RECOVERABLE, Formation, Step
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.settings import Decider, Output, Plans, Settings, from_fields
from pliant.records import Case, Recovery, Verdict
from pliant.recovery import admit

SCRIPTED = Settings(model="scripted", deadline_s=20, picture=False, goal_picture=False)


def first_failure() -> tuple[Case, Verdict]:
    return simulated().recovered[0]


def rules_say(case: Case, verdict: Verdict) -> Recovery:
    recovery = Rules().recover(case, verdict)
    assert recovery is not None
    return recovery


def numbers(steps: tuple[Step, ...]) -> list[float]:
    return [value for step in steps for value in step.goal.values()]


class Replies:
    """A model that replies with these fields in turn, the last for ever, and keeps the requests."""

    def __init__(self, *fields: dict[str, Any] | Exception) -> None:
        self.fields, self.heard = list(fields), list[list[ModelMessage]]()

    def __call__(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        said = self.fields[min(len(self.heard), len(self.fields) - 1)]
        self.heard.append(messages)
        if isinstance(said, Exception):
            raise said
        return reply(info, said)


def plan_replies(*plans: dict[str, Any] | Exception, y_mm: float = 0.0) -> Replies:
    told = {**NOTHING_WRONG, "what_happened": "a", "why": "b", "how_to_recover": "c"}
    return Replies({**told, "wrong_goal": "fit", "fit_y_change_mm": y_mm}, *plans)


def fit_by(mm: int) -> dict[str, Any]:
    zero = {"align_y_change_mm": 0, "insertion_z_change_mm": 0}
    return {"resume_from": "fit", "retreat_first": False, "fit_y_change_mm": mm, **zero}


# --- a model that answers as the rules do --------------------------------------------------------


@pytest.mark.parametrize("one_call", [False, True])
@pytest.mark.parametrize("output", list(Output))
@pytest.mark.parametrize("plan", list(Plans))
def test_a_model_that_speaks_for_the_rules_decides_as_they_do(
    plan: Plans, output: Output, one_call: bool
) -> None:
    settings = replace(SCRIPTED, plan=plan, output=output, one_call=one_call)
    mind = SpeaksForRules(settings=settings)
    for case in simulated().judged:
        verdict, right = mind.judge(case), Rules().judge(case)
        asked = case.outcome.step.formation in RECOVERABLE
        by = "vlm" if asked else "checks"
        assert (verdict.success, verdict.by, verdict.fallback) == (right.success, by, "")
    for case, verdict in failures():
        recovery, rules = mind.recover(case, verdict), rules_say(case, verdict)
        assert recovery is not None
        assert (recovery.by, recovery.fallback, recovery.clamped) == ("vlm", "", None)
        assert [s.formation for s in recovery.steps] == [s.formation for s in rules.steps]
        assert [s.retreat for s in recovery.steps] == [s.retreat for s in rules.steps]
        rounding = 1e-12 if plan is Plans.ABSOLUTE else 0.0005 + 1e-9
        assert numbers(recovery.steps) == pytest.approx(numbers(rules.steps), abs=rounding)
        assert recovery.analysis.what.startswith(rules.analysis.what)
        assert recovery.analysis.why == rules.analysis.why
        assert len(recovery.exchanges) == (1 if one_call else 2)
        assert not any(exchange.refused for exchange in recovery.exchanges)


def test_a_verdict_holds_each_sources_vote_and_the_conflict() -> None:
    said = {
        "pose_check": "success",
        "compression_check": "failure",
        "table_i": "not available",
        "picture": "failure",
        "conflict": "the pose check disagrees with the picture",
        "reason": "it is not in",
        "success": False,
    }
    verdict = asking(Replies(said), picture=False, goal_picture=False).judge(shallow())
    assert verdict.votes == {
        "pose_check": True,
        "compression_check": False,
        "table_i": None,
        "picture": False,
    }
    assert verdict.conflict == said["conflict"]
    assert (verdict.success, verdict.reason, verdict.by) == (False, "it is not in", "vlm")


# --- refused, asked again, cut down, replaced ----------------------------------------------------


def test_a_refused_plan_is_asked_for_once_more_with_the_reason() -> None:
    model = plan_replies(fit_by(70), fit_by(-7))
    recovery = asking(model, picture=False).recover(*first_failure())
    assert recovery is not None
    assert (recovery.by, recovery.fallback, recovery.clamped) == ("vlm", "", None)
    assert len(model.heard) == 3
    assert "more than 40 mm" in str(model.heard[2][-1])
    asked, refused, done = recovery.exchanges
    assert (asked.stage, refused.stage, done.stage) == ("analyse", "plan", "plan")
    assert "more than 40 mm" in refused.refused
    assert (asked.refused, done.refused) == ("", "")


def test_refused_twice_in_the_right_direction_it_is_cut_down() -> None:
    model = plan_replies(fit_by(-60), y_mm=-5)
    recovery = asking(model, picture=False, clamp_mm=8).recover(*first_failure())
    assert recovery is not None
    assert (recovery.by, recovery.fallback) == ("vlm", "")
    assert len(model.heard) == 3
    case, _ = first_failure()
    now = case.goals.target(Formation.FIT).y
    assert numbers(recovery.steps)[0] == pytest.approx(now - 0.008)
    assert recovery.clamped is not None
    assert numbers(recovery.clamped)[0] == pytest.approx(now - 0.060)
    assert "more than 40 mm" in recovery.exchanges[-1].refused


def test_refused_twice_in_the_wrong_direction_the_rules_answer() -> None:
    model = plan_replies(fit_by(100))
    recovery = asking(model, picture=False).recover(*first_failure())
    assert recovery is not None
    assert recovery.steps == rules_say(*first_failure()).steps
    assert recovery.by == "rules"
    assert "more than 40 mm" in recovery.fallback
    assert recovery.clamped is None
    assert len(recovery.exchanges) == 3


def test_a_plan_in_metres_is_not_cut_down_but_replaced() -> None:
    steps = [("fit", -0.0352), ("align", 0.0), ("insertion", 0.1676)]
    told = [{"skill": s, "goal_mm": goal, "retreat_first": False} for s, goal in steps]
    model = plan_replies({"steps": told}, y_mm=30)
    case, verdict = first_failure()
    mind = asking(model, plan=Plans.ABSOLUTE, picture=False)
    recovery = mind.recover(case, verdict)
    assert recovery is not None
    assert recovery.by == "rules"
    assert "looks like metres" in recovery.fallback


def test_a_reply_that_cannot_be_read_is_asked_for_once_more() -> None:
    fine = SpeaksForRules(settings=SCRIPTED)
    fine.case = simulated().put[0]
    first = iter([{"success": "perhaps"}])

    def stumbling(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        fields = next(first, None)
        return fine.answer(messages, info) if fields is None else reply(info, fields)

    verdict = asking(stumbling, picture=False).judge(simulated().put[0])
    assert verdict.by == "vlm"
    refused, used = verdict.exchanges
    assert "success" in refused.refused
    assert used.refused == ""


@pytest.mark.parametrize("fallback", [True, False])
def test_a_model_without_an_answer_is_replaced_or_the_trial_stops(fallback: bool) -> None:
    mind = Silent(settings=replace(SCRIPTED, fallback=fallback))
    case, failed = first_failure()
    verdict, recovery = mind.judge(case), mind.recover(case, failed)
    assert recovery is not None
    assert "nobody is there" in verdict.exchanges[0].refused
    if fallback:
        assert (verdict.by, recovery.by) == ("rules", "rules")
        assert "nobody is there" in verdict.fallback
        assert "nobody is there" in recovery.fallback
        assert recovery.steps == rules_say(case, failed).steps
    else:
        assert (verdict.by, verdict.success, recovery.by) == ("vlm", False, "vlm")
        assert recovery.steps == ()
        assert "nobody is there" in recovery.analysis.why


def test_ten_times_too_much_is_cut_down_to_what_may_be_done() -> None:
    mind = TenTimes(settings=replace(SCRIPTED, clamp_mm=10))
    case, verdict = first_failure()
    recovery = mind.recover(case, verdict)
    assert recovery is not None
    assert recovery.by == "vlm"
    assert admit(recovery, case, Limits()).steps == recovery.steps


# --- switches ------------------------------------------------------------------------------------


@pytest.mark.parametrize("who", ["judge", "recover"])
def test_the_rules_can_take_either_part(who: str) -> None:
    settings = replace(SCRIPTED, **{who: Decider.RULES})  # type: ignore[arg-type]
    mind = SpeaksForRules(settings=settings)
    case, failed = first_failure()
    verdict, recovery = mind.judge(case), mind.recover(case, failed)
    assert recovery is not None
    by = {"judge": verdict.by, "recover": recovery.by}
    assert by.pop(who) == "rules"
    assert by.popitem()[1] == "vlm"
    assert verdict.fallback == recovery.fallback == ""


def test_where_all_checks_agree_the_judge_can_be_skipped() -> None:
    mind = SpeaksForRules(settings=replace(SCRIPTED, skip_agreed=True))
    by = set()
    for case in simulated().judged:
        votes = set(case.evidence.votes.values())
        verdict = mind.judge(case)
        by.add(verdict.by)
        assert verdict.by == ("checks" if len(votes) == 1 and None not in votes else "vlm")
        assert len(verdict.exchanges) == (0 if verdict.by == "checks" else 1)
        if verdict.by == "checks":
            assert verdict.success == votes.pop()
    assert by == {"checks", "vlm"}


def test_a_step_limit_beyond_the_envelopes_is_told_as_the_envelopes() -> None:
    model = plan_replies(fit_by(50), fit_by(-7))
    mind = asking(model, picture=False, step_limit_mm=500)
    assert mind.settings.step_limit_mm == Limits().goal_step_m * 1e3
    recovery = mind.recover(*first_failure())
    assert recovery is not None
    assert "more than 45 mm" in recovery.exchanges[1].refused


# --- budgets and time ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limit", "says"),
    [
        ({"max_requests": 3}, "3 requests are spent"),
        ({"max_tokens": 2000}, "2000 tokens are spent"),
        ({"max_usd": 0.002, "usd_per_million": (1.0, 0.0)}, "0.002 USD are spent"),
    ],
)
def test_a_spent_budget_leaves_the_rest_to_the_rules(limit: dict[str, Any], says: str) -> None:
    mind = SpeaksForRules(settings=replace(SCRIPTED, **limit))
    verdicts = [mind.judge(case) for case in simulated().put]
    assert [v.by for v in verdicts] == ["vlm"] * 3 + ["rules"] * 2
    assert all(says in v.fallback for v in verdicts[3:])
    assert all(v.exchanges == () for v in verdicts[3:])


def test_the_price_of_each_request_is_kept_where_it_is_known() -> None:
    priced = SpeaksForRules(settings=replace(SCRIPTED, usd_per_million=(10.0, 100.0)))
    assert priced.judge(shallow()).exchanges[0].cost_usd == pytest.approx(0.009 + 0.006)
    assert SpeaksForRules(settings=SCRIPTED).judge(shallow()).exchanges[0].cost_usd is None


def test_one_deadline_covers_analysis_plan_and_asking_again() -> None:
    said = iter([analysis(rules_say(*first_failure()), first_failure()[0]), fit_by(90)])

    async def slower_and_slower(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        fields = next(said, None)
        if fields is None:
            await asyncio.sleep(600)
        return reply(info, fields or {})

    recovery = asking(slower_and_slower, deadline_s=3.0, picture=False).recover(*first_failure())
    assert recovery is not None
    assert recovery.by == "rules"
    assert "no usable reply within 3 s" in recovery.fallback
    assert "more than 40 mm" in recovery.fallback
    assert recovery.exchanges[-1].refused == "no reply before the deadline"
    assert len(recovery.exchanges) == 3


def test_it_can_be_asked_inside_a_running_event_loop() -> None:
    """A notebook runs one."""

    async def cell() -> Verdict:
        return SpeaksForRules(settings=SCRIPTED).judge(shallow())

    assert asyncio.run(cell()).by == "vlm"


def test_trials_in_threads_do_not_wait_for_each_other() -> None:
    both = threading.Barrier(2, timeout=20)

    class Meeting(SpeaksForRules):
        def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
            both.wait()
            return super().answer(messages, info)

    verdicts: list[Verdict] = []
    threads = [
        threading.Thread(
            target=lambda: verdicts.append(Meeting(settings=SCRIPTED).judge(shallow()))
        )
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [v.by for v in verdicts] == ["vlm", "vlm"]


_ASKS = """
import sys
sys.path.insert(0, "{tests}")
from vlm_cases import shallow
from pliant.reasoners import vlm
from pliant.reasoners.vlm.settings import Settings
mind = vlm(Settings(model="small", base_url="{address}", deadline_s={deadline}))
print("asking", flush=True)
try:
    print(mind.judge(shallow()).fallback)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize("interrupted", [True, False])
def test_a_process_ends_at_once_and_leaves_nothing_open(interrupted: bool) -> None:
    """By Ctrl-C while a server keeps silent, and after a deadline; with warnings as errors."""

    def silent(server: Loopback, handler: Handler) -> None:
        server.stopped.wait()
        handler.drop()

    with loopback(silent) as server:
        script = _ASKS.format(
            tests=Path(__file__).parent,
            address=server.base_url,
            deadline=600 if interrupted else 0.5,
        )
        process = subprocess.Popen(
            [sys.executable, "-W", "error", "-c", script],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )
        if interrupted:
            while not server.received:
                assert process.poll() is None
                time.sleep(0.05)
            process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=100)
    assert out.splitlines()[-1] == (
        "interrupted" if interrupted else "no usable reply within 0.5 s"
    )
    assert process.returncode == 0
    assert err == ""


# --- settings and models -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"modle": "x"}, "unknown field of the VLM 'modle'"),
        ({"deadline_s": 0}, "deadline_s is 0"),
        ({"deadline_s": float("nan")}, "deadline_s is nan"),
        ({"temperature": 3}, "from 0 to 2"),
        ({"history": -1}, "0 or more"),
        ({"step_limit_mm": 0.5}, "1 or more"),
        ({"max_usd": 0}, "above 0"),
        ({"usd_per_million": (-1, 1)}, "prices are 0 or more"),
        ({"plan": "free"}, "plan is 'free'"),
        ({"base_url": "localhost:8000"}, "with http or https"),
        ({"base_url": "http://[::1"}, "with http or https"),
        ({"base_url": "http://h:99999/v1"}, "with http or https"),
        ({"base_url": "http://local host/v1"}, "with http or https"),
        ({"base_url": "http://example.org\\.evil.example/v1"}, "with http or https"),
        ({"base_url": "http://ex\u0430mple.org/v1"}, "with http or https"),  # a Cyrillic a
    ],
)
def test_settings_that_cannot_be_are_refused_in_one_line(fields: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says) as raised:
        from_fields(fields)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", ["output", "plan", "judge", "recover", "detail", "effort"])
def test_a_word_in_the_place_of_a_choice_is_refused(name: str) -> None:
    """It would compare equal to the choice, and be taken for another where identity decides."""
    wrong: dict[str, Any] = {name: "native"}
    with pytest.raises(InputError, match=f"{name} is 'native': give one of "):
        Settings(**wrong)


def test_the_papers_preset_has_no_rules_no_history_and_absolute_goals_behind_it() -> None:
    paper = from_fields({"preset": "paper", "model": "scripted"})
    assert (paper.judge, paper.recover, paper.plan) == (Decider.VLM, Decider.VLM, Plans.ABSOLUTE)
    assert (paper.output_mode, paper.one_call, paper.history) == (Output.TOOL, False, 0)
    assert not (paper.fallback)
    assert not (paper.measurements)
    assert not (paper.belief)
    assert not (paper.skip_agreed)
    assert from_fields({"plan": "bounded", "preset": "paper"}).plan is Plans.BOUNDED
    with pytest.raises(InputError, match="unknown preset of the VLM 'papr'"):
        from_fields({"preset": "papr"})


def test_options_beside_a_preset_win_though_they_are_the_defaults() -> None:
    chosen = tyro.cli(ModelOptions, args=["--plan", "bounded", "--preset=paper", "--model", "m"])
    assert chosen.settings == from_fields({"preset": "paper", "plan": "bounded", "model": "m"})
    assert chosen.settings.plan is Plans.BOUNDED
    assert tyro.cli(ModelOptions, args=[]).given == {}


def test_a_model_alone_judges_and_plans_as_the_paper_has_it() -> None:
    mind = SpeaksForRules(settings=from_fields({"preset": "paper", "model": "scripted"}))
    case, verdict = first_failure()
    recovery = mind.recover(case, mind.judge(case))
    assert recovery is not None
    assert recovery.is_own
    assert recovery.steps == rules_say(case, verdict).steps
    assert not any("Earlier executions" in e.request for e in recovery.exchanges)


@pytest.mark.parametrize(
    "address",
    ["http://me:s3cret@h/v1", "ftp://me:s3cret@h/", "http://h/v1?key=s3cret", "http://h/v1#s3cret"],
)
@pytest.mark.parametrize(
    "make", [lambda a: Settings(base_url=a), lambda a: from_fields({"base_url": a})]
)
def test_an_address_with_a_secret_is_refused_without_repeating_it(
    make: Callable[[str], Settings], address: str
) -> None:
    with pytest.raises(InputError, match="PLIANT_VLM_KEY") as raised:
        make(address)
    assert "s3cret" not in str(raised.value)


@pytest.mark.parametrize(
    ("model", "says"),
    [
        (None, "give --model, such as local"),
        ("openai:gpt-4o", "set the environment variable OPENAI_API_KEY"),
        ("gpt-4o", "give provider:name"),
        ("nobody:nothing", "give provider:name"),
        ("groq:llama", r"pip install '.\[vlm\]'"),
    ],
)
def test_a_model_that_cannot_be_asked_is_refused_in_one_line(
    model: str | None, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pliant.reasoners import vlm

    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    with pytest.raises(InputError, match=says) as raised:
        vlm(Settings(model=model))
    assert "\n" not in str(raised.value)
