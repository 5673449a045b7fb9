"""The rules of Anthropic's Messages API.

Fields: https://platform.claude.com/docs/en/api/messages, of which the client's own types are
generated. The rest below https://platform.claude.com/docs/en/build-with-claude/: extended-thinking
(no temperature, no forced tool, a budget below `max_tokens`), adaptive-thinking and effort (newer
classes), prompt-caching (in the order tools, system, messages; at most four marks; least length by
class), mid-conversation-system-messages (roles), vision (pictures). Forcing a tool:
https://platform.claude.com/docs/en/agents-and-tools/tool-use/implement-tool-use. Errors:
https://platform.claude.com/docs/en/api/errors.
"""

import re
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import get_type_hints

from loopback import Fields, Received
from strict import Asked, Refused, Said, Usage, header, known, marked, picture, written

SAMPLING = frozenset({"temperature", "top_p", "top_k"})  # of older classes
NEWER = ("claude-opus-5", "claude-sonnet-5", "claude-haiku-5-5")  # no sampling, no thoughts budget
NOT_FORCED = ("claude-opus-5-5", "claude-sonnet-5-5")
THINKS = NEWER
SPEAK = ("user", "assistant")
SYSTEM = ("claude-opus-4-8", "claude-opus-5", "claude-sonnet-5-5", "claude-haiku-5-5")
LEAST = {  # tokens; else 1,024
    "claude-haiku-4-5": 4096,
    "claude-opus-4-5": 4096,
    "claude-opus-4-6": 4096,
    "claude-opus-4-7": 2048,
}
PICTURES = ("image/png", "image/jpeg", "image/gif", "image/webp")
KINDS = {
    400: "invalid_request_error",
    401: "authentication_error",
    403: "permission_error",
    404: "not_found_error",
    413: "request_too_large",
    429: "rate_limit_error",
    500: "api_error",
    529: "overloaded_error",
}
NAME = re.compile(r"[a-zA-Z0-9_-]{1,128}")


@cache
def fields() -> frozenset[str]:
    """The fields of a request, from the client's own types; it is not installed everywhere."""
    params = import_module("anthropic.types.beta.message_create_params")
    return (frozenset(get_type_hints(params.MessageCreateParamsNonStreaming)) | SAMPLING) - {
        "betas"
    }


def bad(message: str) -> Refused:
    return Refused(400, message)


@dataclass
class Messages:
    """The Messages API."""

    variable: str = "ANTHROPIC_BASE_URL"
    suffix: str = ""

    def read(self, received: Received) -> Asked:
        body, model = received.body, str(received.body.get("model"))
        if received.path.partition("?")[0] != "/v1/messages":
            raise Refused(404, "Not found")
        key = header(received, "x-api-key") or header(received, "authorization")[len("Bearer ") :]
        if not key.startswith("k-"):
            raise Refused(401, "invalid x-api-key")
        if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", header(received, "anthropic-version")):
            raise bad("anthropic-version: header is required")
        if (unknown := known(body, fields())) is not None:
            raise bad(f"{unknown}: Extra inputs are not permitted")
        if not isinstance(body.get("max_tokens"), int):
            raise bad("max_tokens: Field required")
        thinks = self.thinking(body, model)
        self.sampling(body, model, thinks)
        tools = tuple(self.tool(tool) for tool in body.get("tools", ()))
        text, pictures = self.messages(body["messages"], model)
        prefix, marks = self.marks(body)
        return Asked(
            tools=tools,
            choice=self.choice(body, model, tools, thinks),
            pictures=pictures,
            text=text,
            prefix=prefix,
            marks=marks,
            model=model,
            effort=str(body.get("output_config", {}).get("effort", "")),
        )

    def thinking(self, body: Fields, model: str) -> str:
        """The kind of thinking: enabled, adaptive, or none."""
        told = body.get(
            "thinking", {"type": "adaptive" if model.startswith(THINKS) else "disabled"}
        )
        if told["type"] == "enabled":
            if model.startswith(NEWER):
                raise bad('"thinking.type.enabled" is not supported for this model. Use'
                          ' "thinking.type.adaptive" and "output_config.effort".')  # fmt: skip
            if told["budget_tokens"] < 1024:
                raise bad("thinking.enabled.budget_tokens: Input should be greater than or equal to"
                          " 1024")  # fmt: skip
            if told["budget_tokens"] >= body["max_tokens"]:
                raise bad("`max_tokens` must be greater than `thinking.budget_tokens`.")
        if told["type"] == "adaptive" and not model.startswith((*NEWER, "claude-opus-4-6")):
            raise bad("adaptive thinking is not supported on this model")
        if "effort" in body.get("output_config", {}) and not model.startswith(NEWER):
            raise bad("This model does not support the effort parameter.")
        return "" if told["type"] == "disabled" else str(told["type"])

    def sampling(self, body: Fields, model: str, thinks: str) -> None:
        given = [name for name in ("temperature", "top_p", "top_k") if name in body]
        if given and model.startswith(NEWER):
            raise bad(f"`{given[0]}` is deprecated for this model.")
        if thinks and body.get("temperature", 1) != 1:
            raise bad("`temperature` may only be set to 1 when thinking is enabled.")
        if not 0 <= body.get("temperature", 1) <= 1:
            raise bad("temperature: range: 0..1")

    def tool(self, tool: Fields) -> str:
        allowed = {"name", "description", "input_schema", "cache_control", "strict", "type"}
        if unknown := known(tool, frozenset(allowed)):
            raise bad(f"tools.0.custom.{unknown}: Extra inputs are not permitted")
        if not NAME.fullmatch(tool["name"]):
            raise bad("tools.0.custom.name: String should match pattern '^[a-zA-Z0-9_-]{1,128}$'")
        if tool["input_schema"].get("type") != "object":
            raise bad("tools.0.custom.input_schema.type: Field required")
        if {"oneOf", "anyOf", "allOf"} & set(tool["input_schema"]):
            raise bad("tools.0.custom.input_schema: input_schema does not support oneOf, allOf, or"
                      " anyOf at the top level")  # fmt: skip
        return str(tool["name"])

    def choice(self, body: Fields, model: str, tools: tuple[str, ...], thinks: str) -> str | None:
        choice = body.get("tool_choice", {"type": "auto"})
        if "tool_choice" in body and not tools:
            raise bad("tool_choice: may only be specified while providing tools")
        if choice["type"] not in ("auto", "any", "tool", "none"):
            raise bad("tool_choice: Input tag does not match any of the expected tags")
        if choice["type"] in ("auto", "none"):
            return None
        if model.startswith(NOT_FORCED):
            raise bad("tool_choice: forcing tool use is not supported on this model")
        if thinks == "enabled":
            raise bad("Thinking may not be enabled when tool_choice forces tool use.")
        if choice["type"] == "any":
            return tools[0] if len(tools) == 1 else None
        if choice["name"] not in tools:
            raise bad(f"tool_choice.tool.name: Tool '{choice['name']}' not found in provided tools")
        return str(choice["name"])

    def messages(self, messages: list[Fields], model: str) -> tuple[str, tuple[bytes, ...]]:
        words: list[str] = []
        pictures: list[bytes] = []
        waiting: set[str] = set()
        if not messages or messages[0]["role"] != "user":
            raise bad("messages: first message must use the user role")
        for n, message in enumerate(messages):
            speaks = ("user", "assistant", "system") if n and model.startswith(SYSTEM) else SPEAK
            if message["role"] not in speaks:
                raise bad(f"messages.{n}.role: Input should be 'user' or 'assistant'")
            content = message["content"]
            parts = content if isinstance(content, list) else [{"type": "text", "text": content}]
            if not parts:
                raise bad(f"messages.{n}: user messages must have non-empty content")
            results = {p["tool_use_id"] for p in parts if p["type"] == "tool_result"}
            if results != waiting:
                raise bad(f"messages.{n - 1}: `tool_use` ids were found without `tool_result`"
                          " blocks immediately after")  # fmt: skip
            waiting = {part["id"] for part in parts if part["type"] == "tool_use"}
            for part in parts:
                if part["type"] == "text":
                    if not part["text"].strip():
                        raise bad("messages: text content blocks must be non-empty")
                    words += [part["text"]] if message["role"] == "user" else []
                elif part["type"] == "image":
                    pictures.append(self.image(part["source"], n))
                elif part["type"] not in ("tool_use", "tool_result", "thinking"):
                    raise bad(f"messages.{n}.content: Input tag '{part['type']}' does not match")
        return "\n".join(words), tuple(pictures)

    def image(self, source: Fields, n: int) -> bytes:
        if set(source) != {"type", "media_type", "data"} or source["type"] != "base64":
            raise bad(f"messages.{n}.content.image.source: invalid")
        try:
            return picture(source["data"], source["media_type"], kinds=PICTURES)
        except ValueError as error:
            raise bad(f"messages.{n}.content.image.source.base64.data: {error}") from error

    def marks(self, body: Fields) -> tuple[str, tuple[int, ...]]:
        """The text that the cache goes by, and where it is marked."""
        system = body.get("system", [])
        system = system if isinstance(system, list) else [{"type": "text", "text": system}]
        blocks = [*body.get("tools", ()), *system]
        for message in body["messages"]:
            content = message["content"]
            blocks += content if isinstance(content, list) else [{"text": content}]
        text, marks = "", []
        for block in blocks:
            text += written({k: v for k, v in block.items() if k != "cache_control"})
            if (mark := block.get("cache_control")) is not None:
                if mark.get("type") != "ephemeral" or mark.get("ttl", "5m") not in ("5m", "1h"):
                    raise bad("cache_control: Input should be 'ephemeral' with ttl '5m' or '1h'")
                marks.append(len(text))
        if len(marks) > 4:
            raise bad(
                f"A maximum of 4 blocks with cache_control may be provided. Found {len(marks)}."
            )
        return text, tuple(marks)

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage:
        least = next((n for name, n in LEAST.items() if asked.model.startswith(name)), 1024)
        return marked(asked, earlier, least=least)

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields:
        content: list[Fields] = []
        if said.thoughts:
            content.append({"type": "thinking", "thinking": said.thoughts, "signature": "c2ln"})
        if said.words and said.end != "refusal":
            content.append({"type": "text", "text": said.words})
        if said.tool:
            call = {"type": "tool_use", "id": "toolu_1", "name": said.tool, "input": said.fields}
            content.append(call)
        stop = {"length": "max_tokens", "refusal": "refusal"}.get(said.end)
        details = {"type": "refusal", "category": None, "explanation": said.words}
        return {
            "id": "msg_1",
            "type": "message",
            "role": "assistant",
            "model": asked.model,
            "content": content,
            "stop_reason": stop or ("tool_use" if said.tool else "end_turn"),
            "stop_sequence": None,
            "stop_details": details if said.end == "refusal" else None,
            "usage": {
                "input_tokens": usage.sent - usage.read - usage.written,
                "cache_read_input_tokens": usage.read,
                "cache_creation_input_tokens": usage.written,
                "output_tokens": usage.received,
            },
        }

    def error(self, refused: Refused) -> Fields:
        told = {"type": KINDS[refused.status], "message": refused.message}
        return {"type": "error", "error": told, "request_id": "req_1"}
