"""The conversation for one decision of a model: sent, validated, asked again once, within one
deadline.

The arm is at rest meanwhile. Whatever a server does, the answer comes back in bounded time: a
usable reply, or why there is none.
"""

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_ai import Agent, ModelRetry, NativeOutput, PromptedOutput, ToolOutput
from pydantic_ai.exceptions import (
    AgentRunError,
    UnexpectedModelBehavior,
    UsageLimitExceeded,
)
from pydantic_ai.messages import UserContent
from pydantic_ai.output import OutputSpec
from pydantic_ai.settings import ModelSettings
from pydantic_ai.usage import UsageLimits

from pliant.errors import PliantError
from pliant.reasoners.vlm.causes import causes, why, will_not_pass
from pliant.reasoners.vlm.settings import Output, Settings
from pliant.reasoners.vlm.wire import Wire
from pliant.reasoners.vlm.words import one_line
from pliant.records import Exchange

T = TypeVar("T", bound=BaseModel)
_AGAIN = 1  # times a refused reply is asked for again
_TWICE = UsageLimits(request_limit=1 + _AGAIN)  # however many kinds of mistakes a model makes
_GRACE_S = 5.0  # beyond the deadline, for a client that does not heed it
_WAIT_S = 0.2


@dataclass(frozen=True, kw_only=True)
class ModelAnswer(Generic[T]):
    """The outcome of a question: `value` None where there is no usable reply, and `problem` says
    why. `is_final`: the same question would meet the same end, since it was refused, nobody was
    there, or no reply came in time. As text it says what was spent."""

    value: T | None
    problem: str
    exchanges: tuple[Exchange, ...] = ()
    is_final: bool = False

    def __str__(self) -> str:
        tokens = sum(e.tokens for e in self.exchanges)
        costs = [e.cost_usd for e in self.exchanges if e.cost_usd is not None]
        cost = f", {sum(costs):.4f} USD" if costs else ""
        took_s = sum(e.latency_s for e in self.exchanges)
        return f"{took_s:.1f} s, {tokens} tokens{cost}"


def ask(
    wire: Wire,
    settings: Settings,
    *,
    stage: str,
    instructions: str,
    content: Sequence[UserContent],
    reply: type[T],
    deadline_s: float,
    check: Callable[[T], str | None] = lambda _: None,
    forms: Mapping[str, type[BaseModel]] | None = None,
) -> ModelAnswer[T]:
    """Ask for a `reply`; `check` says why one cannot be used, and the model is told so once.

    `forms` are all that a trial asks for, by their stages. Function calling offers them in each
    stage, so that what stands before the question stays the same and can be cached. Which one is
    wanted is enforced where the model takes a choice; else a wrong one is refused as any other.

    Raises:
        InputError: a recording does not fit, or cannot be written.
    """
    offered: dict[str, type[BaseModel]] = {**(forms or {}), stage: reply}
    agent: Agent[None, Any] = Agent(
        wire,
        output_type=_output(settings.output_mode, offered, stage),
        instructions=instructions,
        retries={"output": _AGAIN},
        model_settings=_sampling(settings, deadline_s, stage if len(offered) > 1 else None),
    )
    refusals: list[str] = []

    @agent.output_validator
    def usable(value: T) -> T:
        if type(value) is not reply:
            refusals.append(f"it gave another form than {stage}, which was asked for")
            raise ModelRetry(f"This was not asked for. Call {stage}.")
        why = check(value)
        if why is not None:
            refusals.append(why)
            raise ModelRetry(f"This cannot be done: {why}. Answer again.")
        return value

    async def conversation() -> T:
        async with agent:  # closes its connections afterwards
            return (await agent.run(list(content), usage_limits=_TWICE)).output

    async def answered() -> T:
        return await asyncio.wait_for(conversation(), deadline_s)

    before = len(wire.exchanges)
    wire.stage, wire.until, wire.flaw = stage, time.monotonic() + deadline_s, ""
    value, problem, is_final = None, "", False
    try:
        value = _aside(answered, deadline_s + _GRACE_S)
    except PliantError:
        raise
    except TimeoutError:
        is_final = not any(exchange.reply for exchange in wire.exchanges[before:])
        problem = _after(refusals, f"no usable reply within {settings.deadline_s:g} s")
    except AgentRunError as error:
        is_final = will_not_pass(error)
        problem = _after(refusals, wire.flaw or _reason(error, wire))
    except Exception as error:  # a server may send anything, and a client library raise anything
        is_final = True
        problem = _after(refusals, f"{type(error).__name__}: {error}")
    return ModelAnswer(
        value=value,
        problem=problem,
        exchanges=_exchanges(wire.exchanges[before:], problem),
        is_final=is_final,
    )


def _output(mode: Output, offered: Mapping[str, type[BaseModel]], stage: str) -> OutputSpec[Any]:
    """The forms of a reply, as the library takes them. Without function calling there is one."""
    if mode is Output.TOOL:
        return [ToolOutput(form, name=name) for name, form in offered.items()]
    tag = NativeOutput if mode is Output.NATIVE else PromptedOutput
    return tag(offered[stage], name=stage)


def _sampling(settings: Settings, deadline_s: float, choice: str | None) -> ModelSettings:
    """The settings of a request; `choice` is the form to call where there are several. The wire
    adapts them to the model."""
    sampling = ModelSettings(
        max_tokens=settings.reply_tokens,
        timeout=deadline_s,
        max_retries=0,  # of the client's own: the wire counts them
        cache={"messages": False},  # what is the same in every request of a trial
    )
    if settings.temperature is not None:
        sampling["temperature"] = settings.temperature
    if settings.effort is not None:
        sampling["thinking"] = settings.effort.value
    if choice is not None and settings.output_mode is Output.TOOL:
        sampling["tool_choice"] = [choice]
    return sampling


def _reason(error: AgentRunError, wire: Wire) -> str:
    """The reason why a conversation ended: what was wrong with the last reply, where that was
    it."""
    if isinstance(error, UsageLimitExceeded):
        return "no usable reply to either request"
    if isinstance(error, UnexpectedModelBehavior):
        for cause in causes(error):
            if isinstance(cause, ValidationError):
                wrong = cause.errors(include_url=False, include_input=False, include_context=False)
                told = (f"{'.'.join(map(str, e['loc']))}: {e['msg']}".lstrip(": ") for e in wrong)
                return f"not the structure that was asked for: {'; '.join(told)}"
        if error.__cause__ is not None:
            return str(error.__cause__) or str(error)
    return why(error, wire.wrapped.base_url)


def _after(refusals: Sequence[str], reason: str) -> str:
    """The reason in one line, with that of a refusal before it."""
    reason = one_line(reason) or "no reason given"
    if not refusals:
        return reason
    told = one_line(refusals[-1])
    return told if told in reason else f"{told}; asked again: {reason}"


def _aside(conversation: Callable[[], Coroutine[Any, Any, T]], within_s: float) -> T:
    """Return what the conversation gives, held in a thread and an event loop of its own: a notebook
    already runs a loop. However it ends, by Ctrl-C too, both end with it.

    Raises:
        TimeoutError: it did not end within `within_s`.
    """
    begun: Future[asyncio.AbstractEventLoop] = Future()

    def run() -> None:
        with asyncio.Runner() as runner:  # cancels what is left
            begun.set_result(runner.get_loop())
            runner.get_loop().run_forever()

    thread = threading.Thread(target=run, name="vlm", daemon=True)
    thread.start()
    loop = begun.result()
    try:
        future = asyncio.run_coroutine_threadsafe(conversation(), loop)
        until = time.monotonic() + within_s
        while time.monotonic() < until:  # in short waits: a signal may reach the other thread
            if wait([future], _WAIT_S).done:
                return future.result()
        raise TimeoutError
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(_GRACE_S)


def _exchanges(exchanges: list[Exchange], problem: str) -> tuple[Exchange, ...]:
    """The exchanges of a conversation. One that another followed was refused, for what that one was
    told."""
    for n, following in enumerate(exchanges[1:]):
        exchanges[n] = replace(exchanges[n], refused=one_line(following.request))
    if exchanges and problem and not exchanges[-1].refused:
        exchanges[-1] = replace(exchanges[-1], refused=problem)
    return tuple(exchanges)
