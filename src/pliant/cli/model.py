"""Options that choose a VLM and what it is told, the same for every command that reasons."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from pliant.errors import InputError
from pliant.experiment.cells import Experiment
from pliant.paths import located
from pliant.reasoners import refuse_silent
from pliant.reasoners.vlm.settings import PRESETS, Settings

_PRESET = "--preset"
GROUPS = {
    "the model behind the reasoner vlm": (
        *("model", "base-url", "preset", "temperature", "effort", "detail", "output"),
        *("record", "replay", "fallback-from-start"),
    ),
    "what the model decides, and is told": (
        *("judge", "recover", "probes", "plan", "one-call", "skip-agreed", "history", "picture"),
        *("oblique-picture", "goal-picture", "pose-check", "table-i", "measurements", "belief"),
    ),
    "what the model may do, and spend": (
        *("step-limit-mm", "clamp-mm", "fallback", "deadline-s", "reply-tokens", "max-requests"),
        *("max-tokens", "max-usd", "usd-per-million"),
    ),
}
"""Options in groups on a page of help."""
UNDECIDED = 3
"""Exit status: a model was asked, and decided nothing."""
_DEFAULT = Settings()


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """The model behind the reasoner `vlm`, and where its conversations are kept."""

    preset: Literal["paper"] | None = None
    """The paper's own setting: it alone, absolute goals; options beside it win."""
    vlm: Annotated[Settings, tyro.conf.arg(name=""), tyro.conf.EnumChoicesFromValues] = _DEFAULT
    record: Path | None = None
    """Keep all requests and replies: a file, for many trials a folder."""
    replay: Path | None = None
    """Answer from a recording, without a network."""
    fallback_from_start: bool = False
    """Where the model refuses its first request, let the rules decide."""

    @property
    def given(self) -> dict[str, Any]:
        """The settings that differ from their defaults, as fields of an experiment."""
        default = asdict(_DEFAULT)
        return {k: v for k, v in asdict(self.vlm).items() if v != default[k]}

    def placed(self) -> "ModelOptions":
        """The same options with absolute paths: a reasoner of one's own may change the current
        folder."""
        record, replay = (p and located(p) for p in (self.record, self.replay))
        return replace(self, record=record, replay=replay)

    def check(self, experiment: Experiment) -> None:
        """Check the options. Raises InputError when options for a model are given and no reasoner
        asks one."""
        self.refuse_without(is_asked=bool(experiment.models))

    def refuse_without(self, *, is_asked: bool) -> None:
        """Refuse options without a model. Raises InputError when options for a model are given and
        none is asked."""
        named = ("preset", "record", "replay")
        given = [name for name in named if getattr(self, name) is not None]
        given += ["fallback_from_start"] if self.fallback_from_start else []
        given += self.given
        if given and not is_asked:
            option = given[0].replace("_", "-")
            raise InputError(f"--{option} is for a VLM, and no reasoner is one: add vlm to them")

    def refuse_silent(self, settings: Settings, say: Callable[[str], None]) -> None:
        """Ask the model once before anything moves, unless its replies are recorded, or the rules
        may decide from the start. Raises InputError as `pliant.reasoners.refuse_silent`."""
        if self.replay is None and not self.fallback_from_start:
            refuse_silent(settings, say)


def with_preset(words: Sequence[str]) -> list[str]:
    """The words of a command line, with the options that its preset stands for right after the
    command: later ones win."""
    found = _parse_preset(words)
    options = []
    for name, value in PRESETS.get(found, {}).items() if found else ():
        option = name.replace("_", "-")
        if isinstance(value, bool):
            options.append(f"--{option}" if value else f"--no-{option}")
        else:
            options += [f"--{option}", str(value)]
    return [*words[:1], *options, *words[1:]]


def _parse_preset(words: Sequence[str]) -> str | None:
    """The preset that the words name last; None: none."""
    named = [after for word, after in pairwise(words) if word == _PRESET]
    named += [word.removeprefix(f"{_PRESET}=") for word in words if word.startswith(f"{_PRESET}=")]
    return named[-1] if named else None
