"""The habits of servers that one runs oneself, where they differ from OpenAI's.

vLLM: https://docs.vllm.ai/en/latest/serving/openai_compatible_server.html and
https://docs.vllm.ai/en/latest/features/tool_calling.html. Ollama:
https://docs.ollama.com/api/openai-compatibility. LM Studio:
https://lmstudio.ai/docs/developer/openai-compat/structured-output and
https://github.com/lmstudio-ai/lmstudio-bug-tracker/issues/670. llama.cpp:
https://github.com/ggml-org/llama.cpp/blob/master/tools/server/README.md.
"""

import json
from dataclasses import dataclass

from loopback import Fields, Received
from openai_rules import Chat, check_key
from strict import Asked, Refused, Said, Usage, common, tokens, written


@dataclass
class Own(Chat):
    """What they have in common: a key may be anything, unknown fields are passed over, a schema is
    enforced as it is, and a picture comes as base64."""

    variable: str = ""
    name: str = "own"

    def check_request(self, received: Received) -> None:
        if received.path != "/v1/chat/completions":
            raise Refused(404, "Not Found")

    def prefix(self, body: Fields) -> str:
        """A schema is a grammar for the reply, and no part of the prompt."""
        return written([body.get("tools"), body["messages"]])

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage:
        return Usage(sent=tokens(asked.prefix))

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields:
        reply = super().reply(asked, said, usage)
        reply["model"] = asked.model
        reply["usage"].pop("completion_tokens_details")
        return reply


@dataclass
class Vllm(Own):
    """vLLM: refuses `auto` unless it was started for it, and a request that is beyond the context;
    counts cached tokens in blocks of 16 if started with --enable-prompt-tokens-details."""

    name: str = "vllm"
    context: int = 32_768
    key: bool = False

    def check_request(self, received: Received) -> None:
        super().check_request(received)
        body = received.body
        if self.key:
            check_key(received)
        if body.get("tools") and body.get("tool_choice", "auto") == "auto":
            raise Refused(
                400,
                '"auto" tool choice requires --enable-auto-tool-choice and --tool-call-parser to be'
                " set",
            )
        longest = int(body.get("max_completion_tokens") or body.get("max_tokens") or 0)
        if longest > self.context:
            raise Refused(
                400,
                f"'max_tokens' or 'max_completion_tokens' is too large: {longest}. This model's"
                f" maximum context length is {self.context} tokens.",
            )

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage:
        return common(asked, earlier, least=16, step=16)

    def error(self, refused: Refused) -> Fields:
        kind = {404: "NotFoundError", 401: "Unauthorized"}.get(refused.status, "BadRequestError")
        told = {"message": refused.message, "type": kind, "param": None, "code": refused.status}
        return {"error": told}


@dataclass
class Ollama(Own):
    """Ollama: passes over a choice of tool, so that a model with several may call any; counts no
    cached tokens."""

    name: str = "ollama"

    def choice(self, body: Fields, tools: tuple[str, ...]) -> str | None:
        return tools[0] if len(tools) == 1 else None

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields:
        reply = super().reply(asked, said, usage)
        reply["usage"].pop("prompt_tokens_details")
        return reply | {"system_fingerprint": "fp_ollama"}


@dataclass
class LmStudio(Own):
    """LM Studio: refuses a choice of tool by name, and a form that is not `json_schema` or
    `text`; its error is a bare string."""

    name: str = "lmstudio"

    def check_request(self, received: Received) -> None:
        super().check_request(received)
        body = received.body
        if isinstance(body.get("tool_choice", ""), dict):
            raise Refused(
                400,
                "Invalid tool_choice type: 'object'. Supported string values: none, auto, required",
            )
        if body.get("response_format", {}).get("type", "text") not in ("json_schema", "text"):
            raise Refused(400, "'response_format.type' must be 'json_schema' or 'text'")

    def error(self, refused: Refused) -> Fields:
        return {"error": refused.message}


@dataclass
class LlamaCpp(Own):
    """llama.cpp: refuses a grammar beside tools, and pictures unless started with --mmproj; takes a
    choice by name for `auto`; keeps the last prompt and counts what of it it needed not read."""

    name: str = "llamacpp"
    sees: bool = True

    def check_request(self, received: Received) -> None:
        super().check_request(received)
        body = received.body
        if body.get("tools") and body.get("response_format", {}).get("type") == "json_schema":
            raise Refused(400, "Cannot use custom grammar constraints with tools.")
        if not self.sees and "image_url" in json.dumps(body["messages"]):
            raise Refused(
                500,
                "image input is not supported - hint: if this is unexpected, you may need to"
                " provide the mmproj",
            )

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage:
        return common(asked, earlier[-1:], least=1)

    def error(self, refused: Refused) -> Fields:
        kind = "server_error" if refused.status == 500 else "invalid_request_error"
        return {"error": {"code": refused.status, "message": refused.message, "type": kind}}
