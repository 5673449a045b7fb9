"""Every request to a model passes here: it is counted against the trial's budget, tried again a
bounded number of times, recorded or replayed, and written down for the trial's record."""

import asyncio
import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from pydantic_ai.exceptions import AgentRunError, ModelAPIError
from pydantic_ai.messages import (
    BinaryContent,
    ModelMessage,
    ModelRequest,
    ModelResponse,
    TextPart,
    ThinkingPart,
    ToolCallPart,
    UserPromptPart,
)
from pydantic_ai.models import Model, ModelRequestParameters
from pydantic_ai.models.wrapper import WrapperModel
from pydantic_ai.settings import ModelSettings

from pliant import pictures
from pliant.reasoners.vlm.causes import MAY_PASS, why
from pliant.reasoners.vlm.models import as_taken, takes_detail
from pliant.reasoners.vlm.settings import Detail, Settings
from pliant.reasoners.vlm.tape import RESPONSE, Reply, Request, Tape
from pliant.reasoners.vlm.words import printable, without_keys

TRIES = 3  # of one request, where trying again may help
_PAUSE_S = 0.5  # before the second try; doubled after that
_END_OF_THOUGHTS = "</think>"
_MOST_ANSWER = 20_000  # characters; what is beyond is cut off
_MOST_THOUGHTS = 20  # characters per token that the reply may have
_ANYTHING: TypeAdapter[Any] = TypeAdapter(Any)


class OutOfBudget(AgentRunError):
    """Raised when the trial may spend no more on its model."""


@dataclass
class Budget:
    """The budget of a trial for its model, with what it has spent."""

    settings: Settings
    requests: int = 0
    tokens: int = 0
    usd: float = 0.0

    def check(self) -> None:
        """Raise OutOfBudget where nothing is left."""
        most = self.settings
        if self.requests >= most.max_requests:
            raise OutOfBudget(f"the trial's {most.max_requests} requests are spent")
        if self.tokens >= most.max_tokens:
            raise OutOfBudget(f"the trial's {most.max_tokens} tokens are spent")
        if most.max_usd is not None and self.usd >= most.max_usd:
            raise OutOfBudget(f"the trial's {most.max_usd:g} USD are spent")


@dataclass(frozen=True, kw_only=True)
class Call:
    """One request as it is kept: `error` where no reply came, `note` what is odd about it, `flaw`
    why the reply, by its form, may not be usable."""

    request: str
    pictures: tuple[NDArray[np.uint8], ...]
    reply: str = ""
    model: str = ""
    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    latency_s: float = 0.0
    cost_usd: float | None = None
    error: str = ""
    note: str = ""
    flaw: str = ""


@dataclass(init=False)
class Wire(WrapperModel):
    """A model behind the budget and the tape. `calls` grows by one with each request; none is tried
    again after `until` (monotonic clock)."""

    budget: Budget
    tape: Tape
    calls: list[Call] = field(default_factory=list)
    until: float = math.inf

    def __init__(self, wrapped: Model, budget: Budget, tape: Tape) -> None:
        super().__init__(wrapped)
        self.budget, self.tape, self.calls, self.until = budget, tape, [], math.inf

    def prepare_messages(
        self,
        messages: list[ModelMessage],
        model_request_parameters: ModelRequestParameters | None = None,
    ) -> list[ModelMessage]:
        """Return the messages as they are, since a recording is replayed without the model that
        they are prepared for; that happens when it is asked."""
        return messages

    async def request(
        self,
        messages: list[ModelMessage],
        model_settings: ModelSettings | None,
        model_request_parameters: ModelRequestParameters,
    ) -> ModelResponse:
        self.budget.check()
        self.budget.requests += 1
        request = Request(
            words=_words(messages, model_settings, model_request_parameters),
            pictures=tuple(p.data for p in _pictures(messages)),
        )
        found = self.tape.find(request)
        if found is not None:
            return self._answered(messages, found, found.same_pictures)
        started = time.perf_counter()
        try:
            response = await self._tried(messages, model_settings, model_request_parameters)
            latency_s = _since(started)
            said = RESPONSE.validate_json(without_keys(RESPONSE.dump_json(response).decode()))
            said = _cut(_without_orphan(said), self.budget.settings.reply_tokens)
            message = RESPONSE.dump_python(said, mode="json")
            reply = Reply(message=message, error="", latency_s=latency_s)
        except asyncio.CancelledError:
            self._failed(request, messages, "no reply before the deadline", started)
            raise
        except Exception as error:
            self._failed(request, messages, why(error, self.wrapped.base_url), started)
            raise
        self.tape.keep(request, reply)
        return self._answered(messages, reply, same_pictures=True)

    async def _tried(
        self,
        messages: list[ModelMessage],
        settings: ModelSettings | None,
        parameters: ModelRequestParameters,
    ) -> ModelResponse:
        if takes_detail(self.wrapped):
            messages = [_detailed(m, self.budget.settings.detail) for m in messages]
        prepared = self.wrapped.prepare_messages(messages, parameters)
        settings = as_taken(self.wrapped, settings or {})
        for attempt in range(1, TRIES + 1):
            try:
                return await self.wrapped.request(prepared, settings, parameters)
            except MAY_PASS as error:
                if attempt == TRIES:
                    error.add_note(f"asked {TRIES} times")
                    raise
                asked = error.retry_after
                pause = asked if asked is not None else _PAUSE_S * 2 ** (attempt - 1)
                left = self.until - time.monotonic()
                if pause >= left:
                    if asked is not None:
                        error.add_note(
                            f"it says to wait {asked:.0f} s, and this decision has {left:.0f} s"
                            " left: --deadline-s allows more"
                        )
                    raise
                await asyncio.sleep(pause)
        raise AssertionError("the last try returns or raises")

    def _answered(
        self, messages: list[ModelMessage], reply: Reply, same_pictures: bool
    ) -> ModelResponse:
        """The reply as a message, written down and counted."""
        note = "" if same_pictures else "replayed; a picture differs from the recorded one"
        if reply.message is None:
            self.calls.append(_call(messages, error=reply.error, latency_s=reply.latency_s))
            raise ModelAPIError("recorded", reply.error)
        response = _without_orphan(RESPONSE.validate_python(reply.message))
        usage, cost = response.usage, self._cost(response)
        self.budget.tokens += usage.input_tokens + usage.output_tokens
        self.budget.usd += cost or 0.0
        self.calls.append(
            _call(
                messages,
                reply=_beginning(_text(response)),
                model=response.model_name or self.wrapped.model_name,
                input_tokens=usage.input_tokens,
                cached_tokens=usage.cache_read_tokens,
                output_tokens=usage.output_tokens,
                latency_s=reply.latency_s,
                cost_usd=cost,
                note=note,
                flaw=_flaw(response, self.budget.settings.reply_tokens),
            )
        )
        return response

    def _failed(
        self, request: Request, messages: list[ModelMessage], why: str, started: float
    ) -> None:
        waited = _since(started)
        self.tape.keep(request, Reply(message=None, error=why, latency_s=waited))
        model = self.wrapped.model_name
        self.calls.append(_call(messages, error=why, latency_s=waited, model=model))

    def _cost(self, response: ModelResponse) -> float | None:
        price = self.budget.settings.usd_per_million
        if price is not None:
            usage = response.usage
            return (price[0] * usage.input_tokens + price[1] * usage.output_tokens) / 1e6
        try:
            return float(response.cost().total_price)
        except (AssertionError, LookupError, ValueError):  # a model without a published price
            return None


def _since(started: float) -> float:
    """The seconds since `started`, as exactly as they are recorded."""
    return round(time.perf_counter() - started, 4)


# --- messages as words and pictures ---------------------------------------------------------------


def _words(
    messages: list[ModelMessage],
    settings: ModelSettings | None,
    parameters: ModelRequestParameters,
) -> dict[str, Any]:
    """Everything that decides a reply but the pictures and the model."""
    schema = [tool.parameters_json_schema for tool in parameters.output_tools]
    if parameters.output_object is not None:
        schema.append(parameters.output_object.json_schema)
    chosen = settings or {}
    effort = chosen.get("thinking")
    choice = chosen.get("tool_choice")
    return {
        "instructions": _instructions(messages),
        "messages": "\n\n".join(_text(message) for message in messages),
        "output": {
            "mode": parameters.output_mode,
            "schema": schema,
            **({"choice": choice} if choice else {}),
        },
        "sampling": {
            **{k: chosen.get(k) for k in ("temperature", "max_tokens")},
            **({"effort": effort} if effort else {}),
        },
    }


def _instructions(messages: list[ModelMessage]) -> str:
    found = (m.instructions for m in messages if isinstance(m, ModelRequest) and m.instructions)
    return next(found, "")


def _call(messages: list[ModelMessage], **rest: Any) -> Call:
    """A call that begins with the newest message of a conversation, with its instructions where it
    is the first."""
    instructions = _instructions(messages)
    text = _beginning(_text(messages[-1]))  # what a refused reply was echoes in it
    return Call(
        request=f"{instructions}\n\n{text}" if len(messages) == 1 and instructions else text,
        pictures=tuple(pictures.decoded(p.data) for p in _pictures(messages[-1:])),
        **rest,
    )


def _cut(response: ModelResponse, tokens: int) -> ModelResponse:
    """Cut a reply to its beginning where its answer or its thoughts are far too long."""
    thoughts = [part for part in response.parts if isinstance(part, ThinkingPart)]
    answer = [part for part in response.parts if not isinstance(part, ThinkingPart)]
    text = _text(replace(response, parts=answer))
    if len(text) > _MOST_ANSWER:
        return replace(response, parts=[TextPart(_beginning(text))])
    if sum(len(part.content) for part in thoughts) > _MOST_THOUGHTS * tokens:
        told = "\n".join(part.content for part in thoughts)
        return replace(response, parts=[ThinkingPart(_beginning(told)), *answer])
    return response


def _beginning(text: str) -> str:
    """The text, or as much as is kept of it."""
    extra = len(text) - _MOST_ANSWER
    return f"{text[:_MOST_ANSWER]} … and {extra} characters more, cut off" if extra > 0 else text


def _without_orphan(response: ModelResponse) -> ModelResponse:
    """Part a reply's thoughts from what follows them where they end with a mark that nothing began,
    as templates that begin them themselves leave it."""
    parts: list[Any] = []
    for part in response.parts:
        thoughts, mark, rest = (
            part.content.partition(_END_OF_THOUGHTS) if isinstance(part, TextPart) else ("", "", "")
        )
        is_json = thoughts.lstrip().startswith("{")  # then the mark stands in a value
        if mark and not is_json:
            parts += [ThinkingPart(thoughts.strip()), TextPart(rest.strip())]
        else:
            parts.append(part)
    return response if len(parts) == len(response.parts) else replace(response, parts=parts)


def _flaw(response: ModelResponse, reply_tokens: int) -> str:
    """A note on a reply's form that a person should read, where it turns out not to be
    usable."""
    has_answer = any(
        isinstance(part, ToolCallPart) or (isinstance(part, TextPart) and part.content.strip())
        for part in response.parts
    )
    if response.finish_reason == "content_filter":
        return f"the model refused: {_refusal(response)}"
    if response.finish_reason == "length":
        what = "the reply was" if has_answer else "its thoughts took the whole reply, which was"
        return f"{what} cut at {reply_tokens} tokens: give more with --reply-tokens"
    if has_answer:
        return ""
    has_thoughts = any(isinstance(part, ThinkingPart) for part in response.parts)
    return "the reply holds thoughts and no answer" if has_thoughts else "the reply is empty"


def _refusal(response: ModelResponse) -> str:
    """The words for a refusal: the model's own, or else what its provider calls the reason."""
    details = response.provider_details or {}
    named = (details.get(name) for name in ("refusal", "block_reason", "finish_reason"))
    return next((str(words) for words in named if words), "") or "no reason given"


def _detailed(message: ModelMessage, detail: Detail) -> ModelMessage:
    """The message with each picture marked for the resolution at which it is to be looked at."""
    if not isinstance(message, ModelRequest):
        return message
    marked = {"detail": str(detail)}
    return replace(
        message,
        parts=[
            replace(
                part,
                content=[
                    replace(item, vendor_metadata=marked)
                    if isinstance(item, BinaryContent)
                    else item
                    for item in part.content
                ],
            )
            if isinstance(part, UserPromptPart) and not isinstance(part.content, str)
            else part
            for part in message.parts
        ],
    )


def _pictures(messages: Iterable[ModelMessage]) -> list[BinaryContent]:
    return [
        item
        for message in messages
        for part in message.parts
        if isinstance(part, UserPromptPart) and not isinstance(part.content, str)
        for item in part.content
        if isinstance(item, BinaryContent)
    ]


def _text(message: ModelMessage) -> str:
    return printable("\n".join(filter(None, (_part_text(part) for part in message.parts))))


def _part_text(part: Any) -> str:
    if isinstance(part, ToolCallPart):
        return f"{part.tool_name}({part.args_as_json_str()})"
    content = getattr(part, "content", "")
    if isinstance(content, str):
        return content
    if isinstance(part, UserPromptPart):
        return "\n".join("[picture]" if not isinstance(c, str) else c for c in content)
    return _ANYTHING.dump_json(content).decode()
