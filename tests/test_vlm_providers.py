"""Each provider's real client sends the pictures, asked for structure, in that provider's form."""

import base64
import json
from typing import Any

import pytest
from loopback import Fields, Handler, Loopback, completion, loopback
from vlm_cases import simulated
from voices import judgement

from pliant.errors import InputError
from pliant.reasoners import vlm
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.settings import Detail, Output, Settings
from pliant.records import Case

pytestmark = pytest.mark.system  # where all clients are installed

PNG = base64.b64encode(b"\x89PNG\r\n").decode()[:8]


def case() -> Case:
    """Of an Insertion: the goal picture is shown as well."""
    return simulated().judged[-1]


def spoken() -> Fields:
    return judgement(Rules().judge(case()))


def google(body: Fields) -> Fields:
    part: Fields = {"text": json.dumps(spoken())}
    if body.get("tools"):
        part = {"functionCall": {"name": "judge", "args": spoken()}}
    return {
        "candidates": [{"content": {"role": "model", "parts": [part]}, "finishReason": "STOP"}],
        "modelVersion": "gemini",
        "usageMetadata": {"promptTokenCount": 900, "candidatesTokenCount": 60},
    }


def anthropic(body: Fields) -> Fields:
    part: Fields = {"type": "text", "text": json.dumps(spoken())}
    if body.get("tools"):
        part = {"type": "tool_use", "id": "toolu_1", "name": "judge", "input": spoken()}
    return {
        "id": "msg_1",
        "type": "message",
        "role": "assistant",
        "model": "claude",
        "content": [part],
        "stop_reason": "tool_use" if body.get("tools") else "end_turn",
        "stop_sequence": None,
        "usage": {"input_tokens": 900, "output_tokens": 60},
    }


def responses(body: Fields) -> Fields:
    text = {"type": "output_text", "text": json.dumps(spoken()), "annotations": []}
    part: Fields = {"type": "message", "id": "m", "role": "assistant", "status": "completed"}
    part["content"] = [text]
    if body.get("tools"):
        part = {"type": "function_call", "id": "f", "call_id": "c", "name": "judge"}
        part |= {"arguments": json.dumps(spoken()), "status": "completed"}
    return {
        "id": "resp_1",
        "object": "response",
        "created_at": 1_700_000_000,
        "model": "gpt",
        "status": "completed",
        "output": [part],
        "parallel_tool_calls": True,
        "tool_choice": "auto",
        "tools": [],
        "usage": {
            "input_tokens": 900,
            "output_tokens": 60,
            "total_tokens": 960,
            "input_tokens_details": {"cached_tokens": 0, "cache_write_tokens": 0},
            "output_tokens_details": {"reasoning_tokens": 0},
        },
    }


def chat(body: Fields) -> Fields:
    return dict(json.loads(completion(body, json.dumps(spoken()))))


PROVIDERS = {
    "google:gemini-2.5-flash": (google, "GOOGLE_GEMINI_BASE_URL", ""),
    "anthropic:claude-sonnet-5-5": (anthropic, "ANTHROPIC_BASE_URL", ""),
    "openai-responses:gpt-4o": (responses, "OPENAI_BASE_URL", "/v1"),
    "openai-chat:gpt-4o": (chat, "OPENAI_BASE_URL", "/v1"),
}


def found(node: Any, name: str) -> list[Any]:
    """Every value of that name, however deep."""
    if isinstance(node, dict):
        own = [node[name]] if name in node else []
        return own + [value for child in node.values() for value in found(child, name)]
    return [v for child in node for v in found(child, name)] if isinstance(node, list) else []


def pictures(body: Fields) -> int:
    """How many PNGs a request carries, in any provider's form."""
    inline = [data.get("data", "") for data in found(body, "inlineData")]
    blocks = [source.get("data", "") for source in found(body, "source")]
    urls = [u["url"] if isinstance(u, dict) else u for u in found(body, "image_url")]
    return sum(PNG in data[:40] for data in (*inline, *blocks, *urls))


@pytest.fixture(autouse=True)
def keys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of real providers."""
    for name in ("GOOGLE_API_KEY", "ANTHROPIC_API_KEY", "OPENAI_API_KEY"):
        monkeypatch.setenv(name, "k-0123456789")
    monkeypatch.delenv("PLIANT_VLM_KEY_FOR", raising=False)


@pytest.mark.parametrize("output", [Output.TOOL, Output.PROMPTED])
@pytest.mark.parametrize("model", list(PROVIDERS))
def test_the_pictures_reach_every_provider(
    model: str, output: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    reply, variable, path = PROVIDERS[model]

    def behave(server: Loopback, handler: Handler) -> None:
        handler.send(json.dumps(reply(handler.received.body)).encode())

    with loopback(behave) as server:
        monkeypatch.setenv(variable, server.base_url.removesuffix("/v1") + path)
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", server.base_url)
        mind = vlm(Settings(model=model, output=output, detail=Detail.LOW, deadline_s=30))
        verdict = mind.judge(case())
    assert verdict.fallback == ""
    assert verdict.by == "vlm"
    (received,) = server.received
    assert pictures(received.body) == len(verdict.exchanges[0].pictures) == 2
    details = ["low", "low"] if model.startswith("openai") else []
    assert found(received.body, "detail") == details
    assert found(received.body, "videoMetadata") == []


def answered(server: Loopback, handler: Handler) -> None:
    handler.send(b"{}")


@pytest.mark.parametrize("model", list(PROVIDERS))
def test_a_providers_key_is_for_that_provider_alone(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, variable, path = PROVIDERS[model]
    with loopback(answered) as server:
        monkeypatch.setenv(variable, server.base_url.removesuffix("/v1") + path)
        with pytest.raises(InputError, match=r"points its provider to http://127.0.0.1:\d+.* set"):
            vlm(Settings(model=model))
    assert server.received == []
    monkeypatch.delenv(variable)
    vlm(Settings(model=model))  # to its own server it goes


@pytest.mark.parametrize("code", [307, 308])
@pytest.mark.parametrize("model", list(PROVIDERS))
def test_no_client_follows_a_redirect_and_its_target_is_named(
    model: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, variable, path = PROVIDERS[model]

    def redirect(server: Loopback, handler: Handler) -> None:
        handler.send(b"", status=code, Location=f"{theirs.base_url}/elsewhere?key=secret")

    with loopback(answered) as theirs, loopback(redirect) as mine:
        monkeypatch.setenv(variable, mine.base_url.removesuffix("/v1") + path)
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", mine.base_url)
        verdict = vlm(Settings(model=model, deadline_s=30)).judge(case())
    assert len(mine.received) == 1
    assert theirs.received == []
    assert f"asked on to {theirs.base_url}/elsewhere: it is not followed" in verdict.fallback
    assert "\n" not in verdict.fallback
