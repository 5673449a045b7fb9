"""The real server that other tests speak to, and what it and its model can and cannot do."""

import base64
import json
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from local_model import COLOURS, NAME, PICTURE_TOKENS
from openai import BadRequestError, OpenAI
from openai.types.chat import (
    ChatCompletionContentPartImageParam,
    ChatCompletionToolChoiceOptionParam,
    ChatCompletionUserMessageParam,
)

pytestmark = pytest.mark.system
pytest_plugins = ["local_model"]

PLAN = {
    "type": "object",
    "properties": {
        "resume_from": {"enum": ["fit", "align", "insertion"]},
        "y_mm": {"type": "integer", "minimum": -5, "maximum": 5},
    },
    "required": ["resume_from", "y_mm"],
    "additionalProperties": False,
}


@pytest.fixture
def client(local_model_url: str) -> Iterator[OpenAI]:
    with OpenAI(base_url=local_model_url, api_key="none", max_retries=0) as client:
        yield client


def asked(
    text: str, *pictures: ChatCompletionContentPartImageParam
) -> list[ChatCompletionUserMessageParam]:
    return [{"role": "user", "content": [{"type": "text", "text": text}, *pictures]}]


def picture(
    *, kind: str = "png", rgb: tuple[int, int, int] = (0, 0, 0), size: tuple[int, int] = (96, 96)
) -> ChatCompletionContentPartImageParam:
    """Of one colour; `size` is (height, width) [px]."""
    _, data = cv2.imencode(f".{kind}", np.full((*size, 3), rgb[::-1], np.uint8))
    url = f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}


def test_it_answers(client: OpenAI) -> None:
    reply = client.chat.completions.create(
        model=NAME, messages=asked("What is a spring?"), max_tokens=12, temperature=0
    )
    assert reply.choices[0].message.content
    assert reply.usage is not None
    assert 0 < reply.usage.completion_tokens <= 12


@pytest.mark.parametrize("kind", ["png", "jpeg"])
def test_a_picture_costs_its_tokens(client: OpenAI, kind: str) -> None:
    def cost(*pictures: ChatCompletionContentPartImageParam) -> int:
        reply = client.chat.completions.create(
            model=NAME, messages=asked("What is this?", *pictures), max_tokens=1
        )
        assert reply.usage is not None
        return reply.usage.prompt_tokens

    large = picture(kind=kind, size=(480, 640))
    assert cost(large, large) == cost() + 2 * PICTURE_TOKENS


@pytest.mark.parametrize("colour", ["red", "yellow", "white"])
def test_it_reads_a_pictures_colour_as_its_name(client: OpenAI, colour: str) -> None:
    r, g, b = COLOURS[colour]
    reply = client.chat.completions.create(
        model=NAME,
        messages=asked("Repeat the word:", picture(rgb=(255 * r, 255 * g, 255 * b))),
        max_tokens=12,
        temperature=0,
    )
    assert colour in (reply.choices[0].message.content or "")


def test_what_is_not_a_picture_is_refused(client: OpenAI) -> None:
    broken = picture()
    broken["image_url"]["url"] = broken["image_url"]["url"][:60]
    with pytest.raises(BadRequestError, match="image"):
        client.chat.completions.create(model=NAME, messages=asked("What is this?", broken))


@pytest.mark.parametrize("seed", range(5))
def test_a_schema_binds_its_reply(client: OpenAI, seed: int) -> None:
    reply = client.chat.completions.create(
        model=NAME,
        messages=asked("Move by 400 mm: answer with y_mm = 400."),
        response_format={
            "type": "json_schema",
            "json_schema": {"name": "plan", "strict": True, "schema": PLAN},
        },
        max_tokens=60,
        temperature=1,
        seed=seed,
    )
    plan = json.loads(reply.choices[0].message.content or "")
    assert plan.keys() == {"resume_from", "y_mm"}
    assert plan["resume_from"] in {"fit", "align", "insertion"}
    assert -5 <= plan["y_mm"] <= 5


@pytest.mark.parametrize("choice", ["required", {"type": "function", "function": {"name": "plan"}}])
def test_a_demanded_function_is_not_called(
    client: OpenAI, choice: ChatCompletionToolChoiceOptionParam
) -> None:
    """The model's chat template knows no functions, and the server says nothing of it: who speaks
    to a server by function calls must be ready for prose."""
    reply = client.chat.completions.create(
        model=NAME,
        messages=asked("Call the function plan."),
        tools=[{"type": "function", "function": {"name": "plan", "parameters": PLAN}}],
        tool_choice=choice,
        max_tokens=12,
        temperature=0,
    )
    assert not reply.choices[0].message.tool_calls
    assert reply.choices[0].message.content
