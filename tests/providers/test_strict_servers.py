"""The servers of these tests are strict: a request that breaks a documented rule is refused.

Each begins with a request that a real client sent and that was taken, with one thing changed.
"""

import json
from functools import cache
from typing import Any

import pytest
from anthropic_rules import Messages
from families import Family, asking
from google_rules import Gemini
from loopback import Fields, Received
from openai_rules import Chat, Responses
from own_rules import LmStudio, Vllm
from strict import Refused
from vlm_cases import simulated

from pliant.reasoners.vlm.settings import Effort, Output

pytestmark = pytest.mark.system  # where all clients are installed

CHAT = Family("openai-chat:gpt-4o", Chat())
CHAT_REASONS = Family("openai-chat:gpt-5", Chat())
RESPONSES = Family("openai:gpt-5", Responses(), {"effort": Effort.LOW})
CLAUDE = Family("anthropic:claude-haiku-4-5", Messages())
CLAUDE_THINKS = Family("anthropic:claude-haiku-4-5", Messages(), {"effort": Effort.LOW})
CLAUDE_NEW = Family("anthropic:claude-sonnet-5-5", Messages())
GEMINI = Family("google:gemini-2.5-flash", Gemini(), {"effort": Effort.LOW})
GEMINI_NEW = Family("google:gemini-3-pro-preview", Gemini())
VLLM = Family("small", Vllm(), {"output": Output.TOOL})
LM_STUDIO = Family("small", LmStudio(), {"output": Output.TOOL})


@cache
def taken(family: Family) -> Received:
    """A request that the server took."""
    with asking(family) as (server, mind):
        mind.judge(simulated().judged[-1])
    assert server.refused == []
    return server.loopback.received[0]


def changed(body: Fields, path: tuple[Any, ...], value: Any) -> Fields:
    """The body with the value at a path; what is on the way there is made."""
    copy: Any = json.loads(json.dumps(body))
    node = copy
    for name in path[:-1]:
        node = node.setdefault(name, {}) if isinstance(node, dict) else node[name]
    node[path[-1]] = value
    return dict(copy)


TINY = "data:image/png;base64,iVBORw0KGgo="
NAMED = {"type": "function", "function": {"name": "steer"}}
CALL = {"role": "assistant", "tool_calls": [{"id": "c", "type": "function", "function": {}}]}
BROKEN: list[tuple[Family, tuple[Any, ...], Any, str]] = [
    (CHAT, ("cache_control",), True, "Unrecognized request argument supplied: cache_control"),
    (CHAT, ("temperature",), 3, "Invalid 'temperature'"),
    (CHAT, ("reasoning_effort",), "low", "Unsupported parameter: 'reasoning_effort'"),
    (CHAT, ("tool_choice",), NAMED, "Invalid value for 'tool_choice'"),
    (CHAT, ("tools",), [], "empty array"),
    (CHAT, ("tools", 0, "function", "name"), "no spaces", "does not match pattern"),
    (CHAT, ("tools", 0, "function", "parameters", "additionalProperties"), True, "to be false"),
    (CHAT, ("tools", 0, "function", "parameters", "required"), [], "include every key"),
    (CHAT, ("tools", 0, "function", "parameters", "allOf"), [], "'allOf' is not permitted"),
    (CHAT, ("messages", 1, "content", 1, "image_url", "url"), TINY, "Invalid image data"),
    (CHAT, ("messages", 1, "content", 1, "image_url", "detail"), "best", "image_url.detail"),
    (CHAT, ("messages", 1), CALL, "must be followed by tool messages"),
    (CHAT_REASONS, ("max_tokens",), 8000, "Use 'max_completion_tokens' instead"),
    (CHAT_REASONS, ("temperature",), 0.0, "Only the default \\(1\\) value is supported"),
    (CHAT_REASONS, ("top_p",), 0.5, "Unsupported parameter: 'top_p'"),
    (CHAT_REASONS, ("reasoning_effort",), "max", "does not support 'max'"),
    (RESPONSES, ("max_tokens",), 8000, "Unknown parameter: 'max_tokens'"),
    (RESPONSES, ("temperature",), 0.0, "Unsupported parameter: 'temperature'"),
    (RESPONSES, ("reasoning", "effort"), "huge", "does not support 'huge'"),
    (RESPONSES, ("max_output_tokens",), 5, "below minimum value"),
    (RESPONSES, ("tool_choice",), NAMED, "Invalid value for 'tool_choice'"),
    (RESPONSES, ("input", 0, "content", 1, "detail"), None, "Invalid value: 'detail'"),
    (CLAUDE, ("reasoning_effort",), "low", "Extra inputs are not permitted"),
    (CLAUDE, ("max_tokens",), None, "max_tokens: Field required"),
    (CLAUDE, ("temperature",), 1.5, "range: 0..1"),
    (CLAUDE, ("tool_choice",), {"type": "tool", "name": "steer"}, "not found in provided tools"),
    (CLAUDE, ("tools", 0, "input_schema", "anyOf"), [], "does not support oneOf"),
    (CLAUDE, ("output_config", "effort"), "low", "does not support the effort parameter"),
    (CLAUDE, ("system", 0, "cache_control"), {"type": "persistent"}, "should be 'ephemeral'"),
    (CLAUDE, ("messages", 0, "content", 1, "source", "media_type"), "image/bmp", "unsupported"),
    (CLAUDE, ("messages", 0, "role"), "assistant", "must use the user role"),
    (CLAUDE_THINKS, ("thinking", "budget_tokens"), 8000, "must be greater than"),
    (CLAUDE_THINKS, ("thinking", "budget_tokens"), 500, "greater than or equal to 1024"),
    (CLAUDE_THINKS, ("temperature",), 0.0, "may only be set to 1 when thinking"),
    (CLAUDE_THINKS, ("tool_choice",), {"type": "any"}, "when tool_choice forces tool use"),
    (CLAUDE_NEW, ("temperature",), 0.0, "deprecated for this model"),
    (CLAUDE_NEW, ("thinking",), {"type": "enabled", "budget_tokens": 2000}, "not supported"),
    (CLAUDE_NEW, ("tool_choice",), {"type": "any"}, "forcing tool use is not supported"),
    (GEMINI, ("max_tokens",), 8000, 'Unknown name "max_tokens"'),
    (GEMINI, ("generationConfig", "maxTokens"), 8000, 'Unknown name "maxTokens"'),
    (GEMINI, ("generationConfig", "thinkingConfig", "thinkingLevel"), "LOW", "only one of"),
    (GEMINI, ("generationConfig", "thinkingConfig"), {"thinkingLevel": "LOW"}, "not supported"),
    (GEMINI, ("generationConfig", "thinkingConfig"), {"thinkingBudget": 99_999}, "invalid"),
    (GEMINI, ("generationConfig", "responseMimeType"), "application/json", "unsupported"),
    (GEMINI, ("toolConfig", "functionCallingConfig", "mode"), "AUTO", "only when .* mode is ANY"),
    (GEMINI, ("tools",), [], "without function_declarations|must be declared"),
    (GEMINI, ("contents", 0, "role"), "assistant", "valid role: user, model"),
    (
        GEMINI_NEW,
        ("contents", 0),
        {"role": "model", "parts": [{"functionCall": {"name": "judge", "args": {}}}]},
        "missing a thought_signature",
    ),
    (VLLM, ("tool_choice",), "auto", "requires --enable-auto-tool-choice"),
    (LM_STUDIO, ("tool_choice",), NAMED, "Invalid tool_choice type: 'object'"),
    (LM_STUDIO, ("response_format",), {"type": "json_object"}, "must be 'json_schema' or 'text'"),
]


@pytest.mark.parametrize(
    ("family", "path", "value", "reads"),
    BROKEN,
    ids=lambda v: ".".join(map(str, v)) if isinstance(v, tuple) else None,
)
def test_a_request_that_breaks_a_rule_is_refused(
    family: Family, path: tuple[Any, ...], value: Any, reads: str
) -> None:
    received = taken(family)
    broken = Received(received.path, received.headers, changed(received.body, path, value))
    with pytest.raises(Refused, match=reads):
        family.rules.read(broken)


@pytest.mark.parametrize("family", [CHAT, RESPONSES, CLAUDE, GEMINI], ids=str)
def test_a_request_without_a_key_or_to_another_place_is_refused(family: Family) -> None:
    received = taken(family)
    with pytest.raises(Refused) as refused:
        family.rules.read(Received(received.path, {}, received.body))
    assert refused.value.status in (400, 401)
    with pytest.raises(Refused) as refused:
        family.rules.read(Received("/v2/elsewhere", received.headers, received.body))
    assert refused.value.status == 404
    assert "k-0123456789" in json.dumps(received.headers)
