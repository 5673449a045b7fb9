"""What each provider's classes of models are sent, and what comes of their odder replies."""

import time
from typing import Any

import pytest
from anthropic_rules import Messages
from families import FAMILIES, Family, asked, asking
from google_rules import Gemini
from honest import Honest
from openai_rules import Chat, Responses
from own_rules import LlamaCpp, Ollama, Vllm
from strict import Answer, Asked, Refused, Said
from vlm_cases import simulated

from pliant.errors import InputError
from pliant.reasoners import vlm
from pliant.reasoners.vlm.settings import Effort, Settings
from pliant.records import Verdict

pytestmark = pytest.mark.system  # where all clients are installed

CLAUDE = Family("anthropic:claude-opus-5", Messages())


@pytest.mark.parametrize("family", FAMILIES, ids=str)
def test_a_judgement_and_a_recovery_are_asked_for_within_the_providers_rules(
    family: Family,
) -> None:
    with asking(family) as (server, mind):
        verdict = mind.judge(simulated().judged[-1])
        recovery = mind.recover(*simulated().recovered[0])
    assert server.refused == []
    assert (verdict.by, verdict.fallback) == ("vlm", "")
    assert recovery is not None
    assert (recovery.by, recovery.fallback) == ("vlm", "")
    assert [len(asked.pictures) for asked in server.asked] == [2, 1, 1]
    tools = {asked.tools for asked in server.asked}
    if family.is_own:  # each form alone, or none where the server enforces a schema
        assert tools in ({()}, {("judge",), ("analyse",), ("plan",)})
    else:
        assert tools in ({()}, {("judge", "analyse", "plan")})
    if any(asked.tools for asked in server.asked):
        forced = [asked.choice for asked in server.asked]
        assert forced == (["judge", "analyse", "plan"] if family.forces else [None] * 3)
    effort = family.settings.get("effort", "")
    if not any(name in family.model for name in ("haiku", "gemini-2.5")):  # which count thoughts
        assert {asked.effort.lower() for asked in server.asked} == {effort}


def after(first: Said, honest: Honest) -> Answer:
    """An answer that is honest from the second request on."""
    said = [first]
    return lambda asked: said.pop() if said else honest.answer(asked)


def judged(family: Family, first: Said) -> tuple[Verdict, list[str], list[Asked]]:
    """A verdict after another first reply, what the server refused, and what it was asked."""
    honest = Honest()
    with asked(family, after(first, honest)) as (server, mind):
        verdict = honest.asks(mind).judge(simulated().judged[-1])
    return verdict, server.refused, server.asked


@pytest.mark.parametrize("family", FAMILIES, ids=str)
def test_a_reply_that_cannot_be_used_is_asked_for_again_within_the_rules(family: Family) -> None:
    first = Said(words='{"success": 7}', thoughts="Hm.")
    if "tool" in str(family.settings.get("output", "tool")) and not (
        family.is_own and "output" not in family.settings
    ):
        first = Said(tool="judge", fields={"success": 7}, thoughts="Hm.")
    verdict, refused, requests = judged(family, first)
    assert refused == []
    assert (verdict.by, verdict.fallback) == ("vlm", "")
    assert len(requests) == 2
    assert verdict.exchanges[0].refused


def test_another_form_than_the_one_asked_for_is_refused_with_the_reason() -> None:
    plan = {"resume_from": "fit", "retreat_first": True}
    plan |= {"fit_y_change_mm": 1, "align_y_change_mm": 1, "insertion_z_change_mm": 0}
    verdict, refused, requests = judged(CLAUDE, Said(tool="plan", fields=plan))
    assert refused == []
    assert verdict.by == "vlm"
    assert "This was not asked for. Call judge." in verdict.exchanges[0].refused
    assert len(requests) == 2


def test_long_thoughts_do_not_cost_the_answer() -> None:
    honest = Honest()

    def thinks(asked: Asked) -> Said:
        said = honest.answer(asked)
        return Said(tool=said.tool, fields=said.fields, thoughts="so " * 10_000)

    with asked(CLAUDE, thinks) as (_, mind):
        verdict = honest.asks(mind).judge(simulated().judged[-1])
    assert (verdict.by, verdict.fallback) == ("vlm", "")
    assert len(verdict.exchanges[0].reply) < 25_000


@pytest.mark.parametrize(
    "family",
    [
        Family("openai-chat:gpt-4o", Chat()),
        Family("openai:gpt-5", Responses()),
        CLAUDE,
        Family("google:gemini-2.5-flash", Gemini()),
        Family("small", Vllm()),
    ],
    ids=str,
)
def test_a_wait_that_fits_the_deadline_is_waited(family: Family) -> None:
    honest, since = Honest(), []

    def limited(asked: Asked) -> Said:
        since.append(time.monotonic())
        if len(since) == 1:
            raise Refused(429, "Slow down.", headers={"Retry-After": "1"}, wait=1)
        return honest.answer(asked)

    with asked(family, limited) as (_, mind):
        verdict = honest.asks(mind).judge(simulated().judged[-1])
    assert (verdict.by, verdict.fallback) == ("vlm", "")
    assert since[1] - since[0] >= 1


@pytest.mark.parametrize(
    ("model", "rules"),
    [("anthropic:claude-haiku-4-5", Messages()), ("google:gemini-2.5-flash", Gemini())],
)
@pytest.mark.parametrize(("effort", "most"), [(Effort.LOW, 2048), (Effort.HIGH, 4000)])
def test_thoughts_that_are_counted_leave_half_of_the_reply(
    model: str, rules: Any, effort: Effort, most: int
) -> None:
    with asking(Family(model, rules, {"effort": effort})) as (server, mind):
        assert mind.judge(simulated().judged[-1]).by == "vlm"
    (body,) = server.bodies
    if "google" in model:
        config = body["generationConfig"]
        assert config["maxOutputTokens"] == 8000
        assert config["thinkingConfig"]["thinking_budget"] == most
    else:
        assert body["max_tokens"] == 8000
        assert body["thinking"] == {"type": "enabled", "budget_tokens": most}


def test_an_effort_is_refused_for_a_model_that_does_not_think(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "k-0123456789")
    with pytest.raises(InputError, match=r"'openai:gpt-4o' does not think.*leave it out$"):
        vlm(Settings(model="openai:gpt-4o", effort=Effort.LOW))


@pytest.mark.parametrize(
    ("rules", "reads"),
    [
        (Vllm(context=4096), "400: 'max_tokens' or 'max_completion_tokens' is too large: 8000."),
        (LlamaCpp(sees=False), "500: image input is not supported - hint: if this is unexpected"),
        (Ollama(), "404: model 'small' not found"),
    ],
)
def test_what_a_server_of_ones_own_cannot_do_is_told_in_its_words(rules: Any, reads: str) -> None:
    def missing(asked: Asked) -> Said:
        raise Refused(404, "model 'small' not found")

    with asked(Family("small", rules), missing) as (_, mind):
        assert mind.judge(simulated().judged[-1]).fallback.startswith(reads)
