"""A model by its name: any provider of the library, or any OpenAI-compatible server."""

import os
import re

from pydantic_ai.exceptions import UserError
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models import Model, infer_model
from pydantic_ai.models.function import AgentInfo, FunctionModel

from pliant.errors import InputError
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.tape import Replayer

KEY = "PLIANT_VLM_KEY"
"""Environment variable with the key of the server at `base_url`. A provider's own key is never
sent to another address."""


def model_of(settings: Settings) -> Model:
    """The model that settings name, ready to be asked. Nothing is sent yet.

    Raises:
        InputError: no model is named, it is unknown, its library or its key is missing.
    """
    if not settings.model:
        raise InputError(
            "the reasoner vlm has no model: give --model, such as openai:gpt-4o, or --base-url and"
            " the --model that the server there knows"
        )
    try:
        if settings.base_url is None:
            return infer_model(settings.model)
        from pydantic_ai.models.openai import OpenAIChatModel
        from pydantic_ai.providers.openai import OpenAIProvider

        provider = OpenAIProvider(base_url=settings.base_url, api_key=os.environ.get(KEY, "none"))
        return OpenAIChatModel(settings.model.removeprefix("openai:"), provider=provider)
    except ImportError as error:
        raise InputError(
            f"model '{settings.model}': its provider's library is missing;"
            " pip install 'pliant[vlm]', or pydantic-ai-slim with that provider's extra"
        ) from error
    except (UserError, ValueError) as error:
        raise InputError(f"model '{settings.model}': {_advice(error)}") from error


def recorded(tape: Replayer) -> Model:
    """In place of the model whose replies a recording holds: it is never asked itself."""

    def asked(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        raise AssertionError("the recording answers first")

    return FunctionModel(asked, model_name=tape.model)


def _advice(error: Exception) -> str:
    """The library's own words in one line; which variable to set, where a key is missing."""
    variable = re.search(r"`([A-Z][A-Z_]*)` environment variable", str(error))
    if variable is not None:
        return f"it needs a key; set the environment variable {variable[1]}"
    return " ".join(str(error).split()) + "; give provider:name, such as openai:gpt-4o"
