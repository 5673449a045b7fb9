"""Options that choose a VLM and what it is told, the same for every command that reasons."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict, get_type_hints

import tyro

from pliant import usage
from pliant.errors import InputError
from pliant.experiment.cells import Experiment
from pliant.paths import located
from pliant.reasoners import recorded_model, refuse_silent
from pliant.reasoners.vlm.settings import LOCAL, Settings, from_fields

GROUPS = {
    "the model behind the reasoner vlm": (
        *("model", "base-url", "preset", "temperature", "effort", "detail", "output"),
        *("record", "replay", "fallback-from-start"),
    ),
    "what the model decides, and is told": (
        *("judge", "recover", "probes", "plan", "one-call", "skip-agreed", "history", "brief"),
        *(
            "picture",
            "picture-crop",
            "picture-px",
            "oblique-picture",
            "goal-picture",
            "pose-check",
            "table-i",
            "measurements",
            "belief",
        ),
    ),
    "what the model may do, and spend": (
        *("step-limit-mm", "clamp-mm", "fallback", "deadline-s", "reply-tokens", "max-requests"),
        *("max-tokens", "max-usd", "usd-per-million"),
    ),
}
"""Options in groups on a page of help."""
UNDECIDED = 3
"""Exit status: a model was asked, and decided nothing."""
if TYPE_CHECKING:
    _Given = dict[str, Any]
else:  # what is not given is not in it
    _HINTS = get_type_hints(Settings)
    _Given = TypedDict("_Given", {f.name: _HINTS[f.name] for f in fields(Settings)}, total=False)


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """The model behind the reasoner `vlm`, and where its conversations are kept."""

    preset: Literal["paper"] | None = None
    """The paper's own setting: it alone, absolute goals; options beside it win."""
    vlm: Annotated[
        _Given, tyro.conf.arg(name=""), tyro.conf.EnumChoicesFromValues, usage.Shown(Settings)
    ] = field(default_factory=dict)
    record: Path | None = None
    """Keep all requests and replies: a file, for many trials a folder."""
    replay: Path | None = None
    """Answer from a recording, without a network."""
    fallback_from_start: bool = False
    """Where the model refuses its first request, let the rules decide."""

    @property
    def given(self) -> dict[str, Any]:
        """What was given of the settings, and the preset, as fields of an experiment."""
        return {"preset": self.preset, **self.vlm} if self.preset else dict(self.vlm)

    @property
    def unnamed(self) -> str | None:
        """The model where none is named: the one that comes with pliant; with recorded replies one
        of pliant's own that gave them, or None for any.

        Raises:
            InputError: the recording cannot be used.
        """
        if self.replay is None:
            return LOCAL
        recordings = sorted(self.replay.glob("*.jsonl")) if self.replay.is_dir() else [self.replay]
        return recorded_model(recordings[0]) if recordings else None

    @property
    def settings(self) -> Settings:
        """The settings of a model that no experiment file names.

        Raises:
            InputError: a value is not valid, or the recording cannot be used.
        """
        recorded = {} if self.replay is None else {"model": self.unnamed}
        return from_fields({**recorded, **self.given})

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
        named = ("record", "replay")
        given = [name for name in named if getattr(self, name) is not None]
        given += ["fallback_from_start"] if self.fallback_from_start else []
        given = [*self.given, *given]
        if given and not is_asked:
            option = given[0].replace("_", "-")
            raise InputError(f"--{option} is for a VLM, and no reasoner is one: add vlm to them")

    def refuse_silent(self, settings: Settings, say: Callable[[str], None]) -> None:
        """Ask the model once before anything moves, unless its replies are recorded, or the rules
        may decide from the start. Raises InputError as `pliant.reasoners.refuse_silent`."""
        if self.replay is None and not self.fallback_from_start:
            refuse_silent(settings, say)
