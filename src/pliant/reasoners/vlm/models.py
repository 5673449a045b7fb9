"""A model by its name: any provider of the library, or any OpenAI-compatible server."""

import os
import re
from dataclasses import replace
from typing import Any, cast

from pydantic_ai.exceptions import ModelHTTPError, ModelRequestRejectedError, UserError
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models import Model, ModelRequestParameters, infer_model
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.profiles import ModelProfile
from pydantic_ai.settings import ModelSettings

from pliant.errors import InputError
from pliant.network import keep_direct, origin
from pliant.reasoners.vlm import local
from pliant.reasoners.vlm.causes import NO_KEY, address, refusal, said
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.tape import Replayer
from pliant.reasoners.vlm.words import one_line

KEY = "PLIANT_VLM_KEY"
"""Environment variable with the key of the server at `base_url`."""

KEY_FOR = "PLIANT_VLM_KEY_FOR"
"""Environment variable with the address of the server that a key is for; no other gets it."""

_HOMES = {
    "openai": "https://api.openai.com:443",
    "anthropic": "https://api.anthropic.com:443",
    "google": "https://generativelanguage.googleapis.com:443",
}
"""The servers where the keys go that the providers' own variables hold, by the client's
`system`."""

_THOUGHTS = {"low": 2048, "medium": 8192, "high": 24_576}
"""Tokens of thoughts by effort, for models that count them."""

_NEEDS_KEY = (401, 403)
_ACCOUNT = ("OpenAI-Organization", "OpenAI-Project")  # headers that its client adds for OpenAI


def model_of(settings: Settings) -> Model:
    """The model that settings name, ready to be asked. Nothing is sent yet. One of pliant's own is
    served from now on.

    Raises:
        InputError: no model is named, it is unknown, its library or its key is missing, or it
            cannot be served.
    """
    if not settings.model:
        raise InputError(
            "the reasoner vlm has no model: give --model, such as local or openai:gpt-4o; with"
            " --base-url the one that the server there knows"
        )
    try:
        if settings.is_local:
            return _served(str(settings.name), local.base_url(settings), None, "")
        if settings.base_url is None:
            return _thinking(_inferred(settings.model), settings)
        key, withheld = _key(settings.base_url)
        return _served(settings.model.removeprefix("openai:"), settings.base_url, key, withheld)
    except ImportError as error:
        if "socksio" in str(error):
            raise InputError(
                "the environment names a SOCKS proxy (ALL_PROXY or such), and the package 'socksio'"
                " is missing: pip install socksio, or unset the variable"
            ) from error
        raise InputError(
            f"model '{settings.model}': its provider's library is missing;"
            " pip install '.[vlm]' in a checkout, or pydantic-ai-slim with that provider's extra"
        ) from error
    except InputError:
        raise
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


def as_taken(model: Model, given: ModelSettings) -> ModelSettings:
    """The settings of a request as the model's class takes them: without a temperature or a choice
    of form that it refuses, and with thoughts that leave half of the reply to the answer where
    the class counts them."""
    profile, taken = model.profile, given.copy()
    asked = given.get("thinking")
    thinks = bool(asked) or profile.get("thinking_enabled_by_default", False)
    if not _takes_temperature(model, profile, thinks):
        taken.pop("temperature", None)
    if not _can_be_forced(profile, thinks):
        taken.pop("tool_choice", None)
    if asked:
        most = min(_THOUGHTS[str(asked)], given.get("max_tokens", 0) // 2)
        taken |= _counted(model, profile, most)
    return taken


def _takes_temperature(model: Model, profile: ModelProfile, thinks: bool) -> bool:
    fixed = bool(profile.get("anthropic_disallows_sampling_settings"))
    classes = model.system == "anthropic" or bool(profile.get("openai_supports_reasoning"))
    return not fixed and not (thinks and classes)


def _can_be_forced(profile: ModelProfile, thinks: bool) -> bool:
    """Whether a form can be chosen for the model, and it thinks all the same where it does."""
    if not profile.get("supports_forced_tool_choice", True):
        return False
    return not thinks or (
        profile.get("supports_forced_tool_choice_with_thinking", True)
        and not profile.get("forced_tool_choice_disables_thinking", False)
    )


def _counted(model: Model, profile: ModelProfile, most: int) -> ModelSettings:
    """The longest thoughts, where a class counts them in tokens; others know efforts alone."""
    by_level = profile.get("google_supports_thinking_level", True)
    if model.system == "google" and not by_level:
        thoughts: dict[str, Any] = {"include_thoughts": True, "thinking_budget": most}
        return ModelSettings(google_thinking_config=thoughts)  # type: ignore[typeddict-unknown-key]
    adapts = profile.get("anthropic_supports_adaptive_thinking", False)
    if model.system == "anthropic" and not adapts:
        thoughts = {"type": "enabled", "budget_tokens": most}
        return ModelSettings(anthropic_thinking=thoughts)  # type: ignore[typeddict-unknown-key]
    return ModelSettings()


def _thinking(model: Model, settings: Settings) -> Model:
    """The model; raises InputError where an effort is asked of one that does not think."""
    if settings.effort is not None and not model.profile.get("supports_thinking", False):
        raise InputError(
            f"model '{settings.model}' does not think, as far as its client knows, and --effort"
            f" {settings.effort} is for those that do: leave it out"
        )
    return model


def _inferred(name: str) -> Model:
    """A provider's model, at that provider's own server or the one that `KEY_FOR` names. Where
    variables of the provider point it at this machine, its client is made again, since it has read
    the proxies by then.

    Raises:
        InputError: variables of the provider point it elsewhere, and its key would go there.
    """
    model = infer_model(name)
    home = _HOMES.get(model.system)
    if home is not None and model.base_url and origin(model.base_url) not in (home, _key_is_for()):
        raise InputError(
            f"model '{name}': the environment points its provider to {address(model.base_url)},"
            f" and the provider's key is for {address(home)} alone: unset that variable"
            f" ({model.system.upper()}_BASE_URL or such), or, if the key is meant for that server,"
            f" set {KEY_FOR} to its address"
        )
    return infer_model(name) if model.base_url and keep_direct(model.base_url) else model


def _served(name: str, base_url: str, key: str | None, withheld: str) -> Model:
    """The model that the server at `base_url` knows as `name`; where it has no key, `withheld` says
    why."""
    from openai import omit
    from openai.types.chat import ChatCompletion
    from pydantic_ai.models.openai import OpenAIChatModel, OpenAIChatModelSettings
    from pydantic_ai.profiles.openai import OpenAIModelProfile
    from pydantic_ai.providers.openai import OpenAIProvider

    class Served(OpenAIChatModel):
        """The client of a server's model: keeps what the server says of its version, hears an error
        that comes with the status of a success, and takes the server's word on how the longest
        reply is called."""

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
            model_settings, model_request_parameters = plain(
                model_settings or {}, model_request_parameters
            )
            try:
                return await ask(messages, model_settings, model_request_parameters)
            except ModelHTTPError as error:
                if error.status_code in _NEEDS_KEY and not key:
                    body = f"{said(error.body) or 'no reason given'}; {withheld}"
                    raise refusal(error.status_code, body, self.model_name) from error
                if not isinstance(error, ModelRequestRejectedError):
                    raise
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

    def plain(
        given: ModelSettings, parameters: ModelRequestParameters
    ) -> tuple[ModelSettings, ModelRequestParameters]:
        """The request as any such server understands it: the form that is wanted is offered
        alone, since some refuse a choice by name and some ignore it; the effort is passed on."""
        sent = cast(OpenAIChatModelSettings, {**given})
        choice = sent.pop("tool_choice", None)
        if isinstance(choice, list):
            offered = [tool for tool in parameters.output_tools if tool.name in choice]
            parameters = replace(parameters, output_tools=offered)
        effort = sent.pop("thinking", None)
        if effort in ("low", "medium", "high"):
            sent["openai_reasoning_effort"] = effort
        return sent, parameters

    keep_direct(base_url)
    return Served(
        name,
        provider=OpenAIProvider(base_url=base_url, api_key=key or "none"),
        settings=ModelSettings(extra_headers=dict.fromkeys(_ACCOUNT, omit)),  # type: ignore[arg-type]
    )


def _key(base_url: str) -> tuple[str | None, str]:
    """The key for the server at `base_url`, if any, and the words for why it gets none.

    Raises:
        InputError: the environment would send it something that may be meant for another.
    """
    if os.environ.get("OPENAI_CUSTOM_HEADERS"):
        raise InputError(
            f"OPENAI_CUSTOM_HEADERS is set, and its headers would be sent to {base_url}: unset it"
        )
    given, is_for = os.environ.get(KEY), _key_is_for()
    if given and is_for is None:
        raise InputError(
            f"{KEY} is set, and not for which server, so that any could get it: set {KEY_FOR}"
            f" to the address it is for, such as {address(base_url)}, or unset {KEY}"
        )
    key = given if is_for == origin(base_url) else None
    whose = f"{KEY} is for {address(is_for)}" if is_for and given else f"{KEY} is not set"
    return key, f"{NO_KEY} to {address(base_url)}: {whose} (and {KEY_FOR} says for which)"


def _key_is_for() -> str | None:
    """The server that the environment's key is for; None: it does not say.

    Raises:
        InputError: what it says is no address.
    """
    given = os.environ.get(KEY_FOR)
    try:
        return origin(given) if given else None
    except ValueError as error:
        raise InputError(  # what it holds may be a key
            f"{KEY_FOR} holds no server's address: {error}, such as http://localhost:8000"
        ) from error


def recorded(tape: Replayer) -> Model:
    """A stand-in for the model whose replies a recording holds: it is never asked itself."""

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
