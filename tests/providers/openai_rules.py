"""The rules of OpenAI's two protocols, Chat Completions and Responses.

Fields: https://platform.openai.com/docs/api-reference/chat/create and …/responses/create, of which
the client's own types are generated. Reasoning models (temperature, `max_tokens`, efforts):
https://developers.openai.com/api/docs/guides/reasoning. Schemas with `strict`:
https://developers.openai.com/api/docs/guides/structured-outputs, where lengths of texts are not
listed but taken: https://github.com/pydantic/pydantic-ai/pull/4490. Pictures:
https://developers.openai.com/api/docs/guides/images-vision. Cache (from 1,024 tokens, in steps of
128; from GPT-5.6 on up to marks): https://developers.openai.com/api/docs/guides/prompt-caching.
Errors: https://developers.openai.com/api/docs/guides/error-codes.
"""

import json
import re
from dataclasses import dataclass
from typing import Any, get_type_hints

from loopback import Fields, Received
from openai.types.chat.completion_create_params import CompletionCreateParamsNonStreaming
from openai.types.responses.response_create_params import ResponseCreateParamsNonStreaming
from strict import (
    Asked,
    Refused,
    Said,
    Usage,
    common,
    header,
    known,
    marked,
    picture,
    walk,
    written,
)

NAME = re.compile(r"[a-zA-Z0-9_-]{1,64}")
PICTURES = ("image/png", "image/jpeg", "image/gif", "image/webp")
REASONS = re.compile(r"(o[134]|gpt-5(?!-chat))")
EFFORTS = {
    "o": ("low", "medium", "high"),
    "gpt-5.6": ("none", "low", "medium", "high", "xhigh"),
    "gpt-5": ("minimal", "low", "medium", "high"),
}
MARKS = "gpt-5.6"  # from here on a client may say what is to be cached
SAMPLING = ("top_p", "presence_penalty", "frequency_penalty", "logprobs", "logit_bias")
NOT_STRICT = (
    "allOf", "oneOf", "not", "dependentRequired", "dependentSchemas", "if", "then", "else",
    "patternProperties", "propertyNames", "minProperties", "maxProperties", "unevaluatedProperties",
    "contains", "minContains", "maxContains", "uniqueItems", "default",
)  # fmt: skip
CHAT = frozenset(get_type_hints(CompletionCreateParamsNonStreaming))
REASONING = frozenset({"effort", "summary", "generate_summary", "context", "mode"})
RESPONSES = frozenset(get_type_hints(ResponseCreateParamsNonStreaming))


def bad(message: str, param: str | None = None, code: str | None = None) -> Refused:
    return Refused(400, message, type="invalid_request_error", param=param, code=code)


def unsupported(name: str, instead: str = "is not supported with this model.") -> Refused:
    return bad(f"Unsupported parameter: '{name}' {instead}", name, "unsupported_parameter")


def check_schema(schema: Fields, where: str) -> None:
    """What `strict` demands of a schema."""

    def invalid(what: str) -> Refused:
        return bad(f"Invalid schema for {where}: {what}", "tools", "invalid_function_parameters")

    if schema.get("type") != "object" or "anyOf" in schema:
        raise invalid("schema must have type 'object' and not have 'anyOf' at the top level.")
    for part in walk(schema):
        for name in NOT_STRICT:
            if name in part:
                raise invalid(f"'{name}' is not permitted.")
        if part.get("type") == "object" or "properties" in part:
            if part.get("additionalProperties") is not False:
                raise invalid("'additionalProperties' is required to be supplied and to be false.")
            if sorted(part.get("required", ())) != sorted(part.get("properties", {})):
                raise invalid("'required' must include every key in properties.")


def check_key(received: Received) -> None:
    if not header(received, "Authorization").startswith("Bearer k-"):
        raise Refused(401, "Incorrect API key provided.", code="invalid_api_key")


def data_url(url: Any) -> bytes:
    match = re.fullmatch(r"data:([a-z]+/[a-z]+);base64,(.*)", str(url), re.DOTALL)
    if match is None:
        raise bad("Invalid image URL: it must be a valid base64 data URL or an http(s) URL.")
    try:
        return picture(match[2], match[1], kinds=PICTURES, most=50_000_000)
    except ValueError as error:
        raise bad(f"Invalid image data: {error}", code="invalid_image_format") from error


def check_effort(model: str, effort: Any, name: str) -> None:
    if not REASONS.match(model):
        raise unsupported(name)
    taken = next(efforts for prefix, efforts in EFFORTS.items() if model.startswith(prefix))
    if effort not in taken:
        raise bad(
            f"Unsupported value: '{name}' does not support '{effort}' with this model. Supported"
            f" values are: {', '.join(taken)}.",
            name,
            "unsupported_value",
        )


def check_tool(tool: Fields, where: str) -> str:
    name = tool.get("name", "")
    if not NAME.fullmatch(name):
        raise bad(f"Invalid '{where}.name': string does not match pattern.", where)
    if unknown := known(tool, frozenset({"type", "name", "description", "parameters", "strict"})):
        raise bad(f"Unknown parameter: '{where}.{unknown}'.", where, "unknown_parameter")
    if tool.get("strict"):
        check_schema(tool["parameters"], f"function '{name}'")
    return str(name)


@dataclass
class Chat:
    """Chat Completions."""

    variable: str = "OPENAI_BASE_URL"
    suffix: str = "/v1"

    def read(self, received: Received) -> Asked:
        body, model = received.body, str(received.body.get("model"))
        self.check_request(received)
        tools = tuple(self.tool(tool) for tool in body.get("tools", ()))
        if "tools" in body and not tools:
            raise bad("Invalid 'tools': empty array. Expected an array with minimum length 1.")
        text, pictures = self.messages(body["messages"])
        if form := body.get("response_format"):
            self.check_format(form)
        return Asked(
            tools=tools,
            choice=self.choice(body, tools),
            pictures=pictures,
            text=text,
            prefix=self.prefix(body),
            marks=self.marks(body),
            model=model,
            effort=str(body.get("reasoning_effort", "")),
        )

    def prefix(self, body: Fields) -> str:
        """Tools and schema come before the words."""
        form = body.get("response_format") or body.get("text", {}).get("format")
        words = body["messages"] if "messages" in body else body["input"]
        return written([body.get("tools"), form, body.get("instructions"), words])

    def marks(self, body: Fields) -> tuple[int, ...]:
        """Where the client marks the prefix; none: the cache works by itself."""
        mode = body.get("prompt_cache_options", {}).get("mode")
        text = self.prefix(body)
        at = tuple(match.end() for match in re.finditer('"prompt_cache_breakpoint"', text))
        if (mode or at) and not str(body["model"]).startswith(MARKS):
            raise unsupported("prompt_cache_options")
        if mode not in (None, "implicit", "explicit"):
            raise bad("Invalid value: 'prompt_cache_options.mode'.")
        return at if mode == "explicit" else ()

    def check_request(self, received: Received) -> None:
        body, model = received.body, str(received.body.get("model"))
        if received.path != "/v1/chat/completions":
            raise Refused(404, f"Invalid URL (POST {received.path})")
        check_key(received)
        if (unknown := known(body, CHAT)) is not None:
            raise bad(f"Unrecognized request argument supplied: {unknown}")
        if REASONS.match(model):
            if "max_tokens" in body:
                raise unsupported(
                    "max_tokens",
                    "is not supported with this model. Use 'max_completion_tokens' instead.",
                )
            if body.get("temperature", 1) != 1:
                raise bad(
                    f"Unsupported value: 'temperature' does not support {body['temperature']} with"
                    " this model. Only the default (1) value is supported.",
                    "temperature",
                    "unsupported_value",
                )
            for name in SAMPLING:
                if name in body:
                    raise unsupported(name)
        if "reasoning_effort" in body:
            check_effort(model, body["reasoning_effort"], "reasoning_effort")
        if not 0 <= body.get("temperature", 1) <= 2:
            raise bad("Invalid 'temperature': decimal above maximum value.", "temperature")

    def tool(self, tool: Fields) -> str:
        if tool.get("type") != "function" or set(tool) != {"type", "function"}:
            raise bad("Invalid value: 'tools[0].type'.", "tools")
        return check_tool(tool["function"], "tools[0].function")

    def choice(self, body: Fields, tools: tuple[str, ...]) -> str | None:
        """The tool that is to be called, if one is named or there is no other."""
        choice = body.get("tool_choice", "auto")
        if "tool_choice" in body and not tools:
            raise bad("Invalid value for 'tool_choice': 'tool_choice' is only allowed when 'tools'"
                      " are specified.", "tool_choice")  # fmt: skip
        if isinstance(choice, dict):
            if choice.get("type") != "function" or set(choice) != {"type", "function"}:
                raise bad("Invalid value for 'tool_choice'.", "tool_choice")
            if choice["function"]["name"] not in tools:
                raise bad("Invalid value for 'tool_choice': no such tool.", "tool_choice")
            return str(choice["function"]["name"])
        if choice not in ("none", "auto", "required"):
            raise bad("Invalid value for 'tool_choice'.", "tool_choice")
        return tools[0] if choice == "required" and len(tools) == 1 else None

    def check_format(self, form: Fields) -> None:
        if form.get("type") == "json_schema":
            named = form["json_schema"]
            if not NAME.fullmatch(named.get("name", "")):
                raise bad("Missing required parameter: 'response_format.json_schema.name'.")
            if named.get("strict"):
                check_schema(named["schema"], f"response_format '{named['name']}'")
        elif form.get("type") not in ("text", "json_object"):
            raise bad("Invalid value: 'response_format.type'.")

    def messages(self, messages: list[Fields]) -> tuple[str, tuple[bytes, ...]]:
        words: list[str] = []
        pictures: list[bytes] = []
        waiting: set[str] = set()
        for message in messages:
            role = message.get("role")
            if role == "tool":
                if message.get("tool_call_id") not in waiting:
                    raise bad("Invalid parameter: messages with role 'tool' must be a response to a"
                              " preceding message with 'tool_calls'.", "messages")  # fmt: skip
                waiting.remove(message["tool_call_id"])
            elif waiting:
                raise bad("An assistant message with 'tool_calls' must be followed by tool messages"
                          " responding to each 'tool_call_id'.", "messages")  # fmt: skip
            if role not in ("system", "developer", "user", "assistant", "tool"):
                raise bad(f"Invalid value: '{role}'. Supported values are: 'system', …", "messages")
            waiting |= {call["id"] for call in message.get("tool_calls") or ()}
            content = message.get("content")
            if content is None and role != "assistant":
                raise bad("Invalid value for 'content': expected a string, got null.", "messages")
            parts: list[Fields] = (
                [{"type": "text", "text": content}] if isinstance(content, str) else content or []
            )
            for part in parts:
                if part["type"] == "text":
                    words += [part["text"]] if role == "user" else []
                elif part["type"] == "image_url" and role == "user":
                    if part["image_url"].get("detail", "auto") not in ("low", "high", "auto"):
                        raise bad("Invalid value: 'image_url.detail'.", "messages")
                    pictures.append(data_url(part["image_url"]["url"]))
                else:
                    raise bad(f"Invalid content type '{part['type']}' for role '{role}'.")
        if waiting:
            raise bad(
                "An assistant message with 'tool_calls' must be followed by tool messages"
                " responding to each 'tool_call_id'.",
                "messages",
            )
        return "\n".join(words), tuple(pictures)

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage:
        if asked.marks:
            return marked(asked, earlier, least=1024)
        return common(asked, earlier, least=1024, step=128)

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields:
        message: Fields = {"role": "assistant", "content": said.words or None, "refusal": None}
        finish = {"done": "stop", "length": "length", "refusal": "stop"}[said.end]
        if said.end == "refusal":
            message |= {"content": None, "refusal": said.words}
        if said.tool:
            function = {"name": said.tool, "arguments": json.dumps(said.fields)}
            message["tool_calls"] = [{"id": "call_1", "type": "function", "function": function}]
            # With a tool that was named it ends as any text does.
            finish = "stop" if asked.choice and said.end == "done" else "tool_calls"
            finish = "length" if said.end == "length" else finish
        return {
            "id": "chatcmpl-1",
            "object": "chat.completion",
            "created": 1_700_000_000,
            "model": f"{asked.model}-2026-01-01",
            "choices": [{"index": 0, "message": message, "finish_reason": finish}],
            "usage": {
                "prompt_tokens": usage.sent,
                "completion_tokens": usage.received,
                "total_tokens": usage.sent + usage.received,
                "prompt_tokens_details": {
                    "cached_tokens": usage.read,
                    "cache_write_tokens": usage.written,
                    "audio_tokens": 0,
                },
                "completion_tokens_details": {"reasoning_tokens": usage.thoughts},
            },
        }

    def error(self, refused: Refused) -> Fields:
        told = {"type": None, "param": None, "code": None} | refused.details
        told.pop("headers", None)
        return {"error": {"message": refused.message, **told}}


@dataclass
class Responses(Chat):
    """The Responses API."""

    def read(self, received: Received) -> Asked:
        body, model = received.body, str(received.body.get("model"))
        if received.path != "/v1/responses":
            raise Refused(404, f"Invalid URL (POST {received.path})")
        check_key(received)
        if (unknown := known(body, RESPONSES)) is not None:
            raise bad(f"Unknown parameter: '{unknown}'.", unknown, "unknown_parameter")
        for name in ("temperature", "top_p"):
            if name in body and REASONS.match(model):
                raise unsupported(name)
        reasoning = body.get("reasoning", {})
        if (unknown := known(reasoning, REASONING)) is not None:
            raise bad(f"Unknown parameter: 'reasoning.{unknown}'.", code="unknown_parameter")
        effort = reasoning.get("effort", "")
        if "effort" in reasoning:
            check_effort(model, effort, "reasoning.effort")
        if body.get("max_output_tokens", 16) < 16:
            raise bad("Invalid 'max_output_tokens': integer below minimum value.")
        tools = []
        for tool in body.get("tools", ()):
            if tool.get("type") != "function":
                raise bad("Invalid value: 'tools[0].type'.", "tools")
            tools.append(check_tool(tool, "tools[0]"))
        form = body.get("text", {}).get("format", {})
        if form.get("type") == "json_schema" and form.get("strict"):
            check_schema(form["schema"], f"response_format '{form['name']}'")
        text, pictures = self.items(body["input"])
        return Asked(
            tools=tuple(tools),
            choice=self.named(body, tuple(tools)),
            pictures=pictures,
            text=text,
            prefix=self.prefix(body),
            marks=self.marks(body),
            model=model,
            effort=str(effort),
        )

    def named(self, body: Fields, tools: tuple[str, ...]) -> str | None:
        choice = body.get("tool_choice", "auto")
        if not isinstance(choice, dict):
            return tools[0] if choice == "required" and len(tools) == 1 else None
        if set(choice) != {"type", "name"} or choice["type"] != "function":
            raise bad("Invalid value for 'tool_choice'.", "tool_choice")
        if choice["name"] not in tools:
            raise bad(f"Tool choice '{choice['name']}' not found in 'tools' parameter.")
        return str(choice["name"])

    def items(self, items: list[Fields]) -> tuple[str, tuple[bytes, ...]]:
        words: list[str] = []
        pictures: list[bytes] = []
        calls: set[str] = set()
        for item in items:
            kind = item.get("type", "message")
            if kind == "function_call":
                calls.add(item["call_id"])
            elif kind == "function_call_output":
                if item["call_id"] not in calls:
                    raise bad(f"No tool call found for function call output with call_id {item}.")
                calls.remove(item["call_id"])
            elif kind == "message":
                content = item["content"]
                parts = content if isinstance(content, list) else [{"text": content}]
                for part in parts:
                    kind = part.get("type", "input_text")
                    if kind == "input_image":
                        if part.get("detail") not in ("low", "high", "auto"):
                            raise bad("Invalid value: 'detail'.", "input")
                        pictures.append(data_url(part["image_url"]))
                    elif kind in ("input_text", "output_text"):
                        words.append(part["text"])
                    else:
                        raise bad(f"Invalid value: '{kind}'. Supported values are: 'input_text', …")
            elif kind != "reasoning":
                raise bad(f"Invalid value: '{kind}'.", "input")
        if calls:
            raise bad(f"No tool output found for function call {calls.pop()}.", "input")
        return "\n".join(words), tuple(pictures)

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields:
        output: list[Fields] = []
        if said.thoughts or usage.thoughts:
            output.append({"id": "rs_1", "type": "reasoning", "summary": []})
        part: Fields = {"type": "output_text", "text": said.words, "annotations": []}
        if said.end == "refusal":
            part = {"type": "refusal", "refusal": said.words}
        if said.tool:
            output.append(
                {
                    "type": "function_call",
                    "id": "fc_1",
                    "call_id": "call_1",
                    "name": said.tool,
                    "arguments": json.dumps(said.fields),
                    "status": "completed",
                }
            )
        elif said.words:
            message = {"type": "message", "id": "msg_1", "role": "assistant", "content": [part]}
            output.append(message | {"status": "completed"})
        is_cut = said.end == "length"
        return {
            "id": "resp_1",
            "object": "response",
            "created_at": 1_700_000_000,
            "model": f"{asked.model}-2026-01-01",
            "status": "incomplete" if is_cut else "completed",
            "incomplete_details": {"reason": "max_output_tokens"} if is_cut else None,
            "output": output,
            "parallel_tool_calls": True,
            "tool_choice": "auto",
            "tools": [],
            "usage": {
                "input_tokens": usage.sent,
                "output_tokens": usage.received,
                "total_tokens": usage.sent + usage.received,
                "input_tokens_details": {
                    "cached_tokens": usage.read,
                    "cache_write_tokens": usage.written,
                },
                "output_tokens_details": {"reasoning_tokens": usage.thoughts},
            },
        }
