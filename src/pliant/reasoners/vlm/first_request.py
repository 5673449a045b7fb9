"""Makes one small request before anything moves: whether the model can be asked at all."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field
from pydantic_ai.messages import UserContent
from pydantic_ai.models import Model

from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.conversation import ask
from pliant.reasoners.vlm.replies import Strict, Words
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.tape import NoTape
from pliant.reasoners.vlm.wire import Budget, Wire
from pliant.records import Exchange

_SIZE = (224, 224)  # pixels: some models refuse smaller ones
_GREEN = (0, 158, 115)


class Seen(Strict):
    """What you see."""

    colour: Words = Field(description="The colour of the picture, in a word")


@dataclass(frozen=True, kw_only=True)
class FirstAnswer:
    """The outcome of a model's first request: `problem` says why there is no usable reply; empty:
    there is one. `is_final`: asking again would change nothing."""

    problem: str
    is_final: bool
    exchanges: tuple[Exchange, ...]

    def __str__(self) -> str:
        tokens = sum(e.tokens for e in self.exchanges)
        costs = [e.cost_usd for e in self.exchanges if e.cost_usd is not None]
        cost = f", {sum(costs):.4f} USD" if costs else ""
        took_s = sum(e.latency_s for e in self.exchanges)
        return f"{took_s:.1f} s, {tokens} tokens{cost}"


def first_answer(settings: Settings, asked: Model) -> FirstAnswer:
    """Ask for the colour of a picture, as every decision is asked for: with the same client, form
    of reply, settings and deadline."""
    content: list[UserContent] = ["Which colour has this picture?"]
    if settings.picture:
        content.append(prompt.picture(np.full((*_SIZE, 3), _GREEN, np.uint8)))
    else:
        content = ["Which colour has the sky by day?"]
    answer = ask(
        Wire(asked, Budget(settings), NoTape()),
        settings,
        stage="first",
        instructions="You are asked whether you can be asked. Answer in one word.",
        content=content,
        reply=Seen,
        deadline_s=settings.deadline_s,
    )
    return FirstAnswer(problem=answer.problem, is_final=answer.is_final, exchanges=answer.exchanges)
