"""A whole trial, from the first request to inserted, through each provider's real client."""

import pytest
from anthropic_rules import Messages
from families import Family, asking
from google_rules import Gemini
from openai_rules import Chat, Responses
from own_rules import LlamaCpp, LmStudio, Ollama, Vllm

from pliant.conditions import condition
from pliant.methods.planar import Planar
from pliant.reasoners.vlm.settings import Effort
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

pytestmark = pytest.mark.system  # where all clients are installed

SEED = 6  # Fit fails twice, so that every stage is asked for
FAMILIES = [
    Family("openai-chat:gpt-4o", Chat()),
    Family("openai:gpt-5", Responses(), {"effort": Effort.MEDIUM}),
    Family("anthropic:claude-haiku-4-5", Messages(), caches=False),
    Family("anthropic:claude-sonnet-5-5", Messages(), {"effort": Effort.LOW}, forces=False),
    Family("google:gemini-2.5-flash", Gemini()),
    Family("google:gemini-3-pro-preview", Gemini(), {"effort": Effort.HIGH}, caches=False),
    *(Family("small", rules) for rules in (Vllm(), LlamaCpp())),
    *(Family("small", rules, caches=False) for rules in (Ollama(), LmStudio())),
]


@pytest.mark.parametrize("family", FAMILIES, ids=str)
def test_a_trial_is_judged_analysed_planned_and_inserted(family: Family) -> None:
    task = load_task("circle")
    with asking(family) as (server, mind):
        run = Run(
            robot=SimCell().prepare(task, condition("all").draw(SEED)),
            task=task,
            teaching=shipped().for_task(task),
            reasoner=mind,
            method=Planar(),
        )
        executions = list(run)
    assert server.refused == []
    assert run.end_reason == "inserted"
    made = [d for e in executions for d in (e.verdict, e.recovery) if d is not None]
    decisions = [d for d in made if d.exchanges]
    assert {(d.by, d.fallback) for d in decisions} == {("vlm", "")}
    exchanges = [exchange for d in decisions for exchange in d.exchanges]
    stages = [exchange.stage for exchange in exchanges]
    assert [stages.count(stage) for stage in ("judge", "analyse", "plan")] == [5, 2, 2]
    # Every picture that the record shows went over the wire, once, in the order of the requests.
    assert [len(a.pictures) for a in server.asked] == [len(e.pictures) for e in exchanges]
    assert sum(len(asked.pictures) for asked in server.asked) == len(exchanges) + 1
    # And the tokens that the provider counts, cached ones too, are those that the record has.
    assert [e.cached_tokens for e in exchanges] == [usage.read for usage in server.usages]
    first, *later = [usage.read for usage in server.usages]
    assert first == 0
    assert {read > 1024 for read in later} == {family.caches}
    assert [e.input_tokens for e in exchanges] == [usage.sent for usage in server.usages]
