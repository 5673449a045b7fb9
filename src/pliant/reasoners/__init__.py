"""Reasoners by name: the controls, the rules, a VLM, or a user's own as `my_reasoner.py:Mine`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pliant.envelope import Limits
from pliant.errors import InputError, installing, unknown
from pliant.own import make_own, own_file
from pliant.reasoners.controls import Messages, OpenLoop, Retry, Sweep
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import local
from pliant.reasoners.vlm.settings import Settings, is_pliants
from pliant.recovery import Reasoner

if TYPE_CHECKING:
    from pliant.reasoners.vlm.conversation import ModelAnswer
    from pliant.reasoners.vlm.first_request import Seen

VLM = "vlm"

REASONERS: Mapping[str, type[Rules]] = {
    "rules": Rules,
    "messages": Messages,
    "sweep": Sweep,
    "retry": Retry,
    "none": OpenLoop,
}


def reasoner(name: str) -> Reasoner:
    """Make a reasoner; one per trial, so that it may remember within the trial.

    Raises:
        InputError: the name is unknown, or the file or class it points to cannot be used.
    """
    if name in REASONERS:
        return REASONERS[name]()
    if own_file(name) is None:
        raise unknown(
            "reasoner",
            name,
            [*REASONERS, VLM],
            "in simulation oracle, or your own as path/to/file.py:Class",
        )
    made: Reasoner = make_own(
        "reasoner", name, ("judge", "recover", "name"), "pliant.recovery.Reasoner"
    )
    return made


def vlm(
    settings: Settings,
    *,
    name: str = VLM,
    limits: Limits | None = None,
    record: Path | None = None,
    replay: Path | None = None,
) -> Reasoner:
    """Make a reasoner that asks a vision-language model; one per trial. `name` signs its verdicts.
    `record` is a file to keep its conversations in, `replay` one to answer from without a network.

    Raises:
        InputError: the extra is not installed, the model is unknown or lacks its key, or a
            recording cannot be used.
    """
    if replay is None:
        _needs_extra_of(settings)
    else:
        needs_extra()
    from pliant.reasoners.vlm.models import model_of, recorded
    from pliant.reasoners.vlm.reasoner import Vlm
    from pliant.reasoners.vlm.tape import Recorder, Replayer, Tape

    limits = limits or Limits()
    if replay is not None:
        tape = Replayer(replay)
        return Vlm(settings=settings, limits=limits, name=name, tape=tape, asked=recorded(tape))
    asked = model_of(settings)
    kept = Tape() if record is None else Recorder(record)
    return Vlm(settings=settings, limits=limits, name=name, tape=kept, asked=asked)


def recorded_model(recording: Path) -> str | None:
    """The model that replied in a recording, where it is one of pliant's own; None: it is another.

    Raises:
        InputError: the extra is not installed, or the recording cannot be used.
    """
    needs_extra()
    from pliant.reasoners.vlm.tape import Replayer

    found = Replayer(recording).model
    return found if is_pliants(found) else None


def first_answer(settings: Settings) -> "ModelAnswer[Seen] | None":
    """Make one small request to the model, before anything moves; None: no decision is asked of it.

    Raises:
        InputError: as for `vlm`.
    """
    if not settings.stages:
        return None
    _needs_extra_of(settings)
    from pliant.reasoners.vlm.first_request import first_answer as ask
    from pliant.reasoners.vlm.models import model_of

    return ask(settings, model_of(settings))


def refuse_silent(settings: Settings, say: Callable[[str], None]) -> None:
    """Ask a model for the first time, and tell `say` what came of it.

    Raises:
        InputError: the request was refused in a way that will not pass, or as for `vlm`.
    """
    found = first_answer(settings)
    if found is None:
        return
    who = f"model '{settings.name}'"
    if found.problem and found.is_final:
        raise InputError(
            f"{who} cannot be asked: {found.problem}; nothing has moved: mend it,"
            " or let the rules decide from the start with --fallback-from-start"
        )
    if found.problem:
        say(f"{who}, asked first ({found}), gave no usable reply: {found.problem}")
    else:
        say(f"{who}, asked first, answered ({found})")


def _needs_extra_of(settings: Settings) -> None:
    """Raise InputError if what asks the model that settings name is not installed."""
    if settings.is_local:
        local.installed(settings)
    else:
        needs_extra()


def needs_extra(what: str = "the reasoner vlm") -> None:
    """Raise InputError if the library of the models is not installed, which `what` needs."""
    try:
        import pydantic_ai  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "pydantic_ai":
            raise
        raise InputError(f"{what} needs the extra 'vlm': {installing('vlm')}") from error
