"""A model by its name: any provider of the library, or any OpenAI-compatible server."""

import os
import re
from typing import Any

from pydantic_ai.exceptions import ModelRequestRejectedError, UserError
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models import Model, ModelRequestParameters, infer_model
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.settings import ModelSettings

from pliant.errors import InputError
from pliant.network import keep_direct
from pliant.reasoners.vlm.causes import refusal
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.tape import Replayer
from pliant.reasoners.vlm.words import one_line

KEY = "PLIANT_VLM_KEY"
"""Environment variable with the key of the server at `base_url`. What a provider's own variables
hold is never sent to another address."""

_ACCOUNT = ("OpenAI-Organization", "OpenAI-Project")  # headers that its client adds for OpenAI


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
            return _inferred(settings.model)
        return _served(settings.model.removeprefix("openai:"), settings.base_url)
    except ImportError as error:
        if "socksio" in str(error):
            raise InputError(
                "the environment names a SOCKS proxy (ALL_PROXY or such), and the package 'socksio'"
                " is missing: pip install socksio, or unset the variable"
            ) from error
        raise InputError(
            f"model '{settings.model}': its provider's library is missing;"
            " pip install 'pliant[vlm]', or pydantic-ai-slim with that provider's extra"
        ) from error
    except (UserError, ValueError) as error:
        raise InputError(f"model '{settings.model}': {_advice(error)}") from error


def takes_detail(model: Model) -> bool:
    """Whether the model's client sends on the resolution at which a picture is to be looked at, as
    those of OpenAI's protocol do. To others the field is unknown, or means something else."""
    try:
        from pydantic_ai.models.openai import OpenAIChatModel, OpenAIResponsesModel
    except ImportError:
        return False
    return isinstance(model, OpenAIChatModel | OpenAIResponsesModel)


def _inferred(name: str) -> Model:
    """A provider's model. Where variables of that provider point it at this machine, its client is
    made again, since it has read the proxies by then."""
    model = infer_model(name)
    return infer_model(name) if model.base_url and keep_direct(model.base_url) else model


def _served(name: str, base_url: str) -> Model:
    """The model that the server at `base_url` knows as `name`."""
    from openai import omit
    from openai.types.chat import ChatCompletion
    from pydantic_ai.models.openai import OpenAIChatModel
    from pydantic_ai.profiles.openai import OpenAIModelProfile
    from pydantic_ai.providers.openai import OpenAIProvider

    class Served(OpenAIChatModel):
        """Keeps what the server says of its version, hears an error that comes with the status of a
        success, and takes the server's word on how the longest reply is called."""

        _is_new = False

        @property
        def profile(self) -> OpenAIModelProfile:
            named = OpenAIModelProfile(openai_chat_supports_max_completion_tokens=self._is_new)
            return {**super().profile, **named}

        async def request(
            self,
            messages: list[ModelMessage],
            model_settings: ModelSettings | None,
            model_request_parameters: ModelRequestParameters,
        ) -> ModelResponse:
            ask = super().request
            try:
                return await ask(messages, model_settings, model_request_parameters)
            except ModelRequestRejectedError as error:
                if self._is_new or "max_completion_tokens" not in str(error):
                    raise
            self._is_new = True
            return await ask(messages, model_settings, model_request_parameters)

        def _validate_completion(self, response: ChatCompletion) -> Any:
            error = getattr(response, "error", None)
            if error and not response.choices:
                code = error.get("code") if isinstance(error, dict) else None
                raise refusal(code if isinstance(code, int) else 0, error, self.model_name)
            return super()._validate_completion(response)

        def _process_provider_details(self, response: ChatCompletion) -> dict[str, Any] | None:
            details = super()._process_provider_details(response) or {}
            return details | {"system_fingerprint": response.system_fingerprint}

    if os.environ.get("OPENAI_CUSTOM_HEADERS"):
        raise InputError(
            f"OPENAI_CUSTOM_HEADERS is set, and its headers would be sent to {base_url}: unset it"
        )
    keep_direct(base_url)
    return Served(
        name,
        provider=OpenAIProvider(base_url=base_url, api_key=os.environ.get(KEY) or "none"),
        settings=ModelSettings(extra_headers=dict.fromkeys(_ACCOUNT, omit)),  # type: ignore[arg-type]
    )


def recorded(tape: Replayer) -> Model:
    """In place of the model whose replies a recording holds: it is never asked itself."""

    def asked(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        raise AssertionError("the recording answers first")

    return FunctionModel(asked, model_name=tape.model)


def _advice(error: Exception) -> str:
    """The library's own words in one line; which variable to set, where a key is missing."""
    variable = re.search(r"`([A-Z][A-Z_]*)` environment variable", str(error))
    if variable is not None:
        return f"set the environment variable {variable[1]}"
    if str(error).startswith("Unknown model"):
        return "it is not known; give provider:name, such as openai:gpt-4o"
    return one_line(str(error))
