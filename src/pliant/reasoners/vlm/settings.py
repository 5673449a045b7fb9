"""Settings of a vision-language model as the reasoner: which one, what it is shown, what it
decides, how it answers, and what it may spend. Needs no model's library."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pliant.errors import InputError, unknown, within
from pliant.paths import located

LOCAL = "local"
"""The model that comes with pliant, as it may be named; `local:FOLDER` is one tuned from it."""
SHIPPED = "pliant-vlm-1"
"""The model that comes with pliant, as records and tables name it."""
_TUNED = f"{LOCAL}:"


class Plans(StrEnum):
    """The form in which the model writes a plan."""

    BOUNDED = "bounded"  # where to resume, and whole-millimetre changes within bounds
    ABSOLUTE = "absolute"  # the paper's: a list of skills with absolute goals


class Output(StrEnum):
    """The way in which a reply's structure is asked for."""

    TOOL = "tool"  # function calling, as in the paper
    NATIVE = "native"  # the server enforces a JSON schema
    PROMPTED = "prompted"  # the schema stands in the prompt


class Decider(StrEnum):
    VLM = "vlm"
    RULES = "rules"


class Detail(StrEnum):
    """The resolution at which a hosted model looks at pictures."""

    LOW = "low"
    HIGH = "high"


class Effort(StrEnum):
    """How much a model that thinks is to think before it answers."""

    LOW = "low"
    MEDIUM = "medium"
    HIGH = "high"


_CHOSEN: Mapping[str, type[StrEnum]] = {
    "plan": Plans,
    "output": Output,
    "judge": Decider,
    "recover": Decider,
    "detail": Detail,
    "effort": Effort,
}  # a plain word in their place would be taken for none of them


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Every choice about the VLM; they are fields of an experiment file and options of `run`, from
    which `from_fields` makes them.

    Raises:
        InputError: a value is out of range, or a web address is none or holds a password.
    """

    __pydantic_config__ = ConfigDict(strict=False, extra="forbid")

    model: str | None = None
    """Provider and name, such as openai:gpt-4o; local, the default, or local:FOLDER; or the name
    that the server at `base_url` knows."""
    base_url: str | None = None
    """An OpenAI-compatible server, such as http://localhost:8000/v1; its key is read from
    PLIANT_VLM_KEY, if PLIANT_VLM_KEY_FOR names it."""
    output: Output | None = None
    """tool, native or prompted; None: native with `base_url`, else tool."""
    plan: Plans = Plans.BOUNDED
    """The form of a plan: bounded, or absolute as in the paper."""
    judge: Decider = Decider.VLM
    """Who judges: vlm or rules."""
    recover: Decider = Decider.VLM
    """Who analyses and plans: vlm or rules."""
    probes: bool = False
    """Let it look and touch before it plans, where the method has probes."""
    picture: bool = True
    """Show the picture taken after the skill."""
    picture_crop: tuple[int, int, int, int] | None = None
    """Send this part of each picture [px]: left, top, width, height."""
    picture_px: int | None = None
    """The width that pictures are shrunk to before they are sent; None: as taken."""
    oblique_picture: bool = False
    """Show the hole from above, too, as it was before the peg came down."""
    goal_picture: bool = True
    """Show the goal picture when Insertion is judged."""
    pose_check: bool = True
    """Tell what the pose check found."""
    table_i: bool = True
    """Tell Table I's message."""
    measurements: bool = False
    """Tell what was measured in millimetres, which the paper's model was not told."""
    belief: bool = True
    """Where the skills go by them: tell measurements and belief all the same."""
    brief: bool = False
    """Instruct it in a few words: for a model that was trained on the task."""
    history: int = 5
    """Earlier executions told."""
    one_call: bool = False
    """Analyse and plan in one call instead of two."""
    skip_agreed: bool = False
    """Do not ask for a verdict where all checks agree."""
    step_limit_mm: float = 40.0
    """The most that one plan may change a goal."""
    clamp_mm: float = 10.0
    """What a change that was refused twice is cut down to."""
    fallback: bool = True
    """Let the rules answer where the model gives nothing usable; else stop."""
    temperature: float | None = 0.0
    """Of the model's sampling; not sent to a model known to refuse it. None: sent to none."""
    effort: Effort | None = None
    """Of a model that thinks: low, medium or high; None: the model's own."""
    detail: Detail = Detail.HIGH
    """Resolution of pictures for hosted models: low or high."""
    deadline_s: float = 180.0
    """For one decision, asking again included."""
    reply_tokens: int = 8000
    """The longest reply, thoughts included."""
    max_requests: int = 200
    """Per trial; then the rules go on."""
    max_tokens: int = 500_000
    """Per trial, sent and received."""
    max_usd: float | None = None
    """Per trial, where the price is known."""
    usd_per_million: tuple[float, float] | None = None
    """The price of a million tokens sent and received, if pliant knows none."""

    def __post_init__(self) -> None:
        for name, kind in _CHOSEN.items():
            value = getattr(self, name)
            if value is not None and not isinstance(value, kind):
                raise InputError(f"{name} is {value!r}: give one of {', '.join(map(str, kind))}")
        for name in ("clamp_mm", "deadline_s", "reply_tokens", "max_requests", "max_tokens"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise InputError(f"{name} is {value:g}: it must be above 0")
        if not 1 <= self.step_limit_mm < math.inf:
            raise InputError(f"step_limit_mm is {self.step_limit_mm:g}: it must be 1 or more")
        if self.picture_px is not None and not 16 <= self.picture_px <= 4096:
            raise InputError(f"picture_px is {self.picture_px}: it must be from 16 to 4096")
        if self.picture_crop is not None:
            left, top, width, height = self.picture_crop
            if min(left, top) < 0 or min(width, height) < 16:
                raise InputError(
                    f"picture_crop is {self.picture_crop}: left and top must be 0 or more, width"
                    " and height 16 or more"
                )
        if self.history < 0:
            raise InputError(f"history is {self.history}: it must be 0 or more executions")
        if self.probes and self.recover is not Decider.VLM:
            raise InputError("probes are for whoever plans, and here the rules do: leave them out")
        if self.temperature is not None and not 0 <= self.temperature <= 2:
            raise InputError(f"temperature is {self.temperature:g}: it must be from 0 to 2")
        if self.max_usd is not None and not self.max_usd > 0:
            raise InputError(f"max_usd is {self.max_usd:g}: it must be above 0")
        if self.usd_per_million is not None and not all(
            0 <= price < math.inf for price in self.usd_per_million
        ):
            raise InputError(f"usd_per_million is {self.usd_per_million}: prices are 0 or more")
        if self.base_url is not None:
            _check_address(self.base_url)

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages that the model decides."""
        judging = ("judge",) if self.judge is Decider.VLM else ()
        if self.recover is Decider.RULES:
            return judging
        return (*judging, *(("probe",) if self.probes else ()), "analyse", "plan")

    @property
    def is_local(self) -> bool:
        """Whether pliant serves the model itself."""
        return self.base_url is None and is_pliants(self.model)

    @property
    def is_hosted(self) -> bool:
        """Whether it is a provider's model, which may cost money."""
        return self.base_url is None and not self.is_local

    @property
    def folder(self) -> Path | None:
        """The folder of a tuned model that pliant serves itself; None: the model is another."""
        if not self.is_local or not str(self.model).startswith(_TUNED):
            return None
        return Path(str(self.model).removeprefix(_TUNED))

    @property
    def name(self) -> str | None:
        """The model's name in records and tables: a folder's without its own folder."""
        return self.model if self.folder is None else f"{_TUNED}{self.folder.name}"

    @property
    def output_mode(self) -> Output:
        if self.output is not None:
            return self.output
        return Output.TOOL if self.base_url is None else Output.NATIVE


PRESETS: Mapping[str, Mapping[str, Any]] = {
    "paper": {
        "output": "tool",
        "plan": "absolute",
        "judge": "vlm",
        "recover": "vlm",
        "one_call": False,
        "skip_agreed": False,
        "measurements": False,
        "belief": False,
        "history": 0,
        "step_limit_mm": 1000.0,
        "fallback": False,
    },
}
"""Settings by name, as fields of a file. `paper` is the paper's own setting: the model judges and
plans in two stages with absolute goals by function calling, sees no earlier execution and no
measurement in millimetres, and no rules stand behind it; a goal may change as far as the envelope
lets it."""

BROUGHT: Mapping[str, Any] = {
    "output": "native",
    "picture_crop": [160, 10, 320, 320],
    "picture_px": 192,
    "brief": True,
    "history": 3,
}
"""What the model that comes with pliant was trained with, and one tuned from it: its defaults."""


def from_fields(given: Mapping[str, Any]) -> Settings:
    """Settings from the fields of a file, in YAML's types. The field `preset` gives those of
    `PRESETS`; what a model brings wins over it, and the other fields over both. Without a model and
    a server's address it is the one that comes with pliant; an empty `model` is none.

    Raises:
        InputError: a field is unknown, or its value is not valid.
    """
    given = dict(given)
    preset = given.pop("preset", None)
    if preset is not None and preset not in PRESETS:
        with within("preset"):
            raise unknown("preset of the VLM", str(preset), [*PRESETS])
    if given.get("base_url") is None:
        given["model"] = located_model(given.get("model", LOCAL))
        if given["model"] == LOCAL:
            given["model"] = SHIPPED
    brought = BROUGHT if is_pliants(given.get("model")) else {}
    given = {**PRESETS.get(preset, {}), **brought, **given}
    names = [f.name for f in fields(Settings)]
    for name in given:
        if name not in names:
            with within(name):
                raise unknown("field of the VLM", name, names)
    try:
        return _adapter().validate_json(json.dumps(dict(given)), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, InputError):
            cause.place = tuple(name for name in names if str(cause).startswith(f"{name} "))
            raise cause from error
        field, value = first["loc"][0] if first["loc"] else "settings", first["input"]
        with within(field):
            raise InputError(f"VLM: {field} is {value!r}: {first['msg'].lower()}") from error


def located_model(name: Any, folder: Path | None = None) -> Any:
    """A model's name with the folder of a tuned one as an absolute path, which counts from
    `folder`, or without it from the current one."""
    if not isinstance(name, str) or not name.startswith(_TUNED):
        return name
    return f"{_TUNED}{located(name.removeprefix(_TUNED), folder)}"


def is_pliants(model: object) -> bool:
    """Whether a model, served by whomever, is the one that comes with pliant, or tuned from it."""
    return isinstance(model, str) and (model in (LOCAL, SHIPPED) or model.startswith(_TUNED))


@lru_cache
def _adapter() -> TypeAdapter[Settings]:
    return TypeAdapter(Settings)


def _check_address(address: str) -> None:
    try:
        parts = urlsplit(address)
        secret = parts.username or parts.password or parts.query or parts.fragment
        usable = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # a port or an IPv6 address that is none
        secret, usable = None, False
    if secret:
        raise InputError(
            "base_url holds a name, a password, a query or a fragment, which would be stored with"
            " the results: give the address alone, and the key in PLIANT_VLM_KEY"
        )
    if not usable or not address.isascii() or not address.isprintable() or {*" \\"} & {*address}:
        raise InputError(
            f"base_url is {address!r}: it must be like http://localhost:8000/v1, with http or https"
        )
