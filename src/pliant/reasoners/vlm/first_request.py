"""Makes one small request before anything moves: whether the model can be asked at all."""

import numpy as np
from pydantic import Field
from pydantic_ai.messages import UserContent
from pydantic_ai.models import Model

from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.conversation import ModelAnswer, ask
from pliant.reasoners.vlm.replies import Strict, Words
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.tape import Tape
from pliant.reasoners.vlm.wire import Budget, Wire

_SIZE = (224, 224)  # pixels: some models refuse smaller ones
_GREEN = (0, 158, 115)


class Seen(Strict):
    """What you see."""

    colour: Words = Field(description="The colour of the picture, in a word")


def first_answer(settings: Settings, asked: Model) -> ModelAnswer[Seen]:
    """Ask for the colour of a picture, as every decision is asked for: with the same client, form
    of reply, settings and deadline."""
    content: list[UserContent] = ["Which colour has this picture?"]
    if settings.picture:
        content.append(prompt.picture(np.full((*_SIZE, 3), _GREEN, np.uint8), settings))
    else:
        content = ["Which colour has the sky by day?"]
    return ask(
        Wire(asked, Budget(settings), Tape()),
        settings,
        stage="first",
        instructions="You are asked whether you can be asked. Answer in one word.",
        content=content,
        reply=Seen,
        deadline_s=settings.deadline_s,
    )
