"""Twelve ways in which a provider gives no usable reply, each as the one line that a person reads.

`python tests/providers/test_provider_refusals.py` prints them all.
"""

from dataclasses import dataclass

import pytest
from anthropic_rules import Messages
from documents import ROOT
from families import Family, asked
from google_rules import Gemini
from openai_rules import Chat, Responses
from own_rules import Vllm
from strict import Answer, Asked, Refused, Said
from vlm_cases import simulated

from pliant.reasoners.vlm.settings import Output

pytestmark = pytest.mark.system  # where all clients are installed

FAMILIES = [
    Family("openai-chat:gpt-5", Chat()),
    Family("openai:gpt-5", Responses()),
    Family("anthropic:claude-opus-5", Messages()),
    Family("google:gemini-2.5-flash", Gemini()),
    Family("small", Vllm(), {"output": Output.TOOL}),
]


def refusing(status: int, message: str, **details: object) -> Answer:
    def answer(asked: Asked) -> Said:
        raise Refused(status, message, **details)

    return answer


def saying(said: Said) -> Answer:
    return lambda asked: said


WAIT = {"headers": {"Retry-After": "3600"}, "wait": 3600}


@dataclass(frozen=True)
class Way:
    """A way to give no usable reply: how the line reads, and how many requests it takes."""

    name: str
    answer: Answer
    reads: str
    requests: int = 1


WAYS = [
    Way(
        "401",
        refusing(401, "Incorrect API key provided."),
        "401: Incorrect API key provided; see that the key is this server's",
    ),
    Way(
        "403",
        refusing(403, "Your account may not use this model."),
        "403: Your account may not use this model; see what the key may do",
    ),
    Way(
        "404",
        refusing(404, "The model does not exist."),
        "404: The model does not exist; see that --model and the address are right",
    ),
    Way(
        "429 with retry-after",
        refusing(429, "Rate limit reached.", **WAIT),
        "429: Rate limit reached; it says to wait 3600 s, and this decision has ",
    ),
    Way(
        "429 without retry-after",
        refusing(429, "Rate limit reached."),
        "429: Rate limit reached; asked 3 times; wait, or send fewer at once",
        requests=3,
    ),
    Way("400", refusing(400, "Unknown parameter: 'cache'."), "400: Unknown parameter: 'cache'."),
    Way(
        "413",
        refusing(413, "Request exceeds the maximum size."),
        "413: Request exceeds the maximum size; send less with --no-goal-picture or fewer"
        " --history",
    ),
    Way(
        "500",
        refusing(500, "Internal server error."),
        "500: Internal server error; asked 3 times",
        requests=3,
    ),
    Way(
        "529",
        refusing(529, "Overloaded."),
        "529: Overloaded; asked 3 times; the provider has too much to do: try later",
        requests=3,
    ),
    Way(
        "cut reply",
        saying(Said(tool="judge", fields={"pose_check": "succ"}, end="length")),
        "the reply was cut at 8000 tokens: give more with --reply-tokens",
        requests=2,
    ),
    Way("empty reply", saying(Said()), "the reply is empty", requests=2),
    Way(
        "refusal",
        saying(Said(words="I cannot help with that.", end="refusal")),
        "the model refused: ",
    ),
    Way(
        "tool call that does not exist",
        saying(Said(tool="move_to", fields={"y_mm": 3})),
        "Unknown tool name: 'move_to'. Available tools: ",
        requests=2,
    ),
]


def line(family: Family, way: Way) -> tuple[str, int]:
    """The line, and how many requests it took."""
    with asked(family, way.answer) as (server, mind):
        verdict = mind.judge(simulated().judged[-1])
    assert verdict.by == "rules"
    return verdict.fallback, len(server.bodies)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
@pytest.mark.parametrize("family", FAMILIES, ids=str)
def test_each_refusal_is_told_in_one_line_with_its_cause(family: Family, way: Way) -> None:
    told, requests = line(family, way)
    assert way.reads in told
    assert "\n" not in told
    assert len(told) <= 300
    assert requests == way.requests


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_the_documentation_shows_each_line(way: Way) -> None:
    page = (ROOT / "docs" / "how-to" / "providers.md").read_text(encoding="utf-8")
    assert f"| {way.name} | {way.reads}" in page


if __name__ == "__main__":
    for way in WAYS:
        print(way.name)
        for family in FAMILIES:
            told, requests = line(family, way)
            print(f"  {family}, {requests}: {told}")
