"""What stands before the question is the same in every stage, and is read from a cache.

The server counts four characters as a token, and knows a beginning again as its provider documents
it: by itself, or up to the marks of the client.
"""

import json

import pytest
from anthropic_rules import Messages
from families import Family, asked
from google_rules import Gemini
from loopback import Fields
from openai_rules import Chat, Responses
from own_rules import LlamaCpp, Vllm
from pydantic import BaseModel
from strict import Asked, Said
from vlm_cases import simulated
from voices import analysis, bounded, judgement

from pliant.methods.planar import Planar
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.conversation import ask
from pliant.reasoners.vlm.replies import Analysis, Judgement, bounded_plan
from pliant.reasoners.vlm.settings import Effort, Output
from pliant.reasoners.vlm.tape import Tape
from pliant.reasoners.vlm.wire import Budget, Wire

pytestmark = pytest.mark.system  # where all clients are installed

FORMS: dict[str, type[BaseModel]] = {
    "judge": Judgement,
    "analyse": Analysis,
    "plan": bounded_plan(40.0, Planar()),
}
TOLD = "You supervise a robot arm that inserts a peg into a hole. " * 300  # about 4,400 tokens


def right() -> dict[str, Fields]:
    """A usable reply for each stage."""
    case, verdict = simulated().recovered[0]
    recovery = Rules().recover(case, verdict)
    assert recovery is not None
    fields = (judgement(verdict), analysis(recovery, case), bounded(recovery, case))
    return dict(zip(FORMS, fields, strict=True))


def tokens(family: Family) -> list[tuple[int, int, int]]:
    """Tokens sent, read from the cache and written to it, for each stage of a trial."""
    stages = iter(right().items())

    def answer(asked: Asked) -> Said:
        form, fields = next(stages)
        return Said(tool=form, fields=fields) if asked.tools else Said(words=json.dumps(fields))

    with asked(family, answer) as (server, mind):
        wire = Wire(mind.asked, Budget(mind.settings), Tape())
        answers = [
            ask(
                wire,
                mind.settings,
                stage=stage,
                instructions=TOLD,
                content=[f"Now {stage}."],
                reply=form,
                deadline_s=30,
                forms=FORMS,
            )
            for stage, form in FORMS.items()
        ]
    assert [answer.problem for answer in answers] == [""] * 3
    assert [e.cached_tokens for a in answers for e in a.exchanges] == [
        usage.read for usage in server.usages
    ]
    return [(usage.sent, usage.read, usage.written) for usage in server.usages]


CACHED = [
    Family("openai-chat:gpt-4o", Chat()),
    Family("openai:gpt-5", Responses(), {"effort": Effort.LOW}),
    Family("openai:gpt-5.6-sol", Responses()),
    Family("openai-chat:gpt-5.6-sol", Chat()),
    Family("google:gemini-2.5-flash", Gemini()),
    Family("small", Vllm()),
    Family("small", LlamaCpp()),
    Family("anthropic:claude-haiku-4-5", Messages()),
    Family("anthropic:claude-opus-5", Messages(), {"effort": Effort.LOW}, forces=False),
    Family("openai-chat:gpt-4o", Chat(), {"output": Output.PROMPTED}),
]


@pytest.mark.parametrize("family", CACHED, ids=str)
def test_each_stage_after_the_first_reads_what_is_the_same_from_the_cache(family: Family) -> None:
    first, *later = tokens(family)
    assert first[1] == 0
    for sent, read, written in later:
        assert read > 4096
        assert written == 0
        assert sent - read < 600  # the question, and what a form adds


@pytest.mark.parametrize(
    "family",
    [
        Family("anthropic:claude-haiku-4-5", Messages()),
        Family("openai:gpt-5.6-sol", Responses()),
    ],
    ids=str,
)
def test_what_is_the_same_is_marked_where_a_class_wants_it_marked(family: Family) -> None:
    first, *later = tokens(family)
    assert first[2] == later[0][1] == later[1][1]  # written once, read twice


def test_a_schema_that_stands_first_keeps_the_stages_apart_at_openai() -> None:
    """So `native` is not said to be cached there across stages."""
    native = Family("openai-chat:gpt-4o", Chat(), {"output": Output.NATIVE})
    assert [read for _, read, _ in tokens(native)] == [0, 0, 0]
