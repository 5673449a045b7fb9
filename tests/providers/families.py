"""The families of providers and classes of models that are asked, each with its rules."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from anthropic_rules import Messages
from google_rules import Gemini
from honest import Honest
from openai_rules import Chat, Responses
from own_rules import LlamaCpp, LmStudio, Ollama, Vllm
from strict import Answer, Rules, Strict, strict

from pliant.reasoners import vlm
from pliant.reasoners.vlm import wire
from pliant.reasoners.vlm.settings import Effort, Output, Settings

KEYS = ("GOOGLE_API_KEY", "ANTHROPIC_API_KEY", "OPENAI_API_KEY", "PLIANT_VLM_KEY")


@dataclass(frozen=True, eq=False)
class Family:
    """A class of models at a provider, and the settings that it is asked with. `forces`: the form
    that is wanted can be chosen for it. `caches`: what is the same in each request of a trial is
    long enough for its cache, and what is read from that is told."""

    model: str
    rules: Rules
    settings: dict[str, Any] = field(default_factory=dict)
    forces: bool = True
    caches: bool = True

    def __str__(self) -> str:
        served = f"{getattr(self.rules, 'name', '')} " if self.is_own else ""
        chosen = "".join(f" {name}={value}" for name, value in self.settings.items())
        return f"{served}{self.model}{chosen}"

    @property
    def is_own(self) -> bool:
        """Whether it is a server of one's own, which has an address and no provider."""
        return self.rules.variable == ""


FAMILIES = [
    Family("openai-chat:gpt-4o", Chat()),
    Family("openai-chat:gpt-5", Chat()),
    Family("openai-chat:o4-mini", Chat(), {"effort": Effort.HIGH}),
    Family("openai-chat:gpt-4o", Chat(), {"output": Output.NATIVE}),
    Family("openai:gpt-4o", Responses()),
    Family("openai:gpt-5-mini", Responses(), {"effort": Effort.LOW}),
    Family("openai:gpt-5.6-sol", Responses(), {"effort": Effort.MEDIUM}),
    Family("openai-chat:gpt-5.6-sol", Chat()),
    Family("openai:o3", Responses(), {"output": Output.PROMPTED}),
    Family("anthropic:claude-haiku-4-5", Messages()),
    Family("anthropic:claude-haiku-4-5", Messages(), {"effort": Effort.HIGH}, forces=False),
    Family("anthropic:claude-opus-5", Messages(), {"effort": Effort.MEDIUM}, forces=False),
    Family("anthropic:claude-sonnet-5-5", Messages(), forces=False),
    Family("anthropic:claude-haiku-4-5", Messages(), {"output": Output.PROMPTED}),
    Family("google:gemini-2.0-flash", Gemini()),
    Family("google:gemini-2.5-flash", Gemini(), {"effort": Effort.HIGH}),
    Family("google:gemini-3-pro-preview", Gemini(), {"effort": Effort.LOW}),
    Family("google:gemini-2.5-flash", Gemini(), {"output": Output.NATIVE}),
    *(
        Family("small", rules, settings)
        for rules in (Vllm(), Ollama(), LmStudio(), LlamaCpp())
        for settings in ({}, {"output": Output.TOOL, "effort": Effort.LOW})
    ),
]


@contextmanager
def asked(family: Family, answer: Answer, **settings: Any) -> Iterator[tuple[Strict, Any]]:
    """A server with the family's rules, and a reasoner that asks there, with keys as a user has
    them and no long waits before a request is tried again."""
    with strict(family.rules, answer) as server, pytest.MonkeyPatch.context() as patch:
        for name in KEYS:
            patch.setenv(name, "k-0123456789")
        patch.setattr(wire, "_PAUSE_S", 0.01)
        patch.setenv("PLIANT_VLM_KEY_FOR", server.base_url or server.loopback.base_url)
        chosen = {"deadline_s": 30, **family.settings, **settings}
        if family.is_own:
            chosen["base_url"] = server.loopback.base_url
        else:
            patch.setenv(family.rules.variable, server.base_url)
        yield server, vlm(Settings(model=family.model, **chosen))


@contextmanager
def asking(family: Family, **settings: Any) -> Iterator[tuple[Strict, Honest]]:
    """A server whose model is honest, and the reasoner that asks it."""
    honest = Honest()
    with asked(family, honest.answer, **settings) as (server, mind):
        yield server, honest.asks(mind)
