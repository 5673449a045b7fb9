"""`pliant bench-reasoner`: any reasoner, scored on a fixed set of cases, without a simulator."""

import sys
from collections.abc import Mapping
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated

import tyro

from pliant.cli.model import UNDECIDED, ModelOptions
from pliant.cli.steps import counted
from pliant.console import Console, complain
from pliant.errors import InputError
from pliant.experiment.bench import coin, run, table
from pliant.experiment.bench.blind import Pictures
from pliant.experiment.bench.cases import SHIPPED, Cases
from pliant.experiment.bench.marks import Make
from pliant.files import write_json
from pliant.own import located_own, short_name
from pliant.paths import located
from pliant.paths import shown as named
from pliant.reasoners import VLM, reasoner, vlm
from pliant.recovery import Reasoner


def bench_reasoner(
    reasoners: Annotated[tuple[str, ...], tyro.conf.Positional],
    *,
    cases: Path | None = None,
    limit: int | None = None,
    pictures: Annotated[Pictures, tyro.conf.EnumChoicesFromValues] = Pictures.OWN,
    out: Path | None = None,
    model: Annotated[ModelOptions, tyro.conf.arg(name="")] = ModelOptions(),  # noqa: B008
) -> int:
    """Score reasoners on the case set: what they accept and reject, and what they plan.

    Args:
        reasoners: coin, rules, messages, sweep, retry, none, vlm, or your own
            (path/to/file.py:Class); several are set side by side.
        cases: a case set of your own in place of the one that ships.
        limit: only so many cases, from the first.
        pictures: own, or a control that nobody can see by: black ones, or those of others.
        out: also write all scores as JSON to this file.
        model: the model behind the reasoner vlm; recordings are a folder with a file per case.
    """
    out, model = None if out is None else located(out), model.placed()
    chosen = Cases(SHIPPED if cases is None else located(cases))
    makers = _makers(reasoners, model)
    if out is not None:
        _check_writable(out)
    if VLM in reasoners:
        model.refuse_silent(model.settings, partial(print, file=sys.stderr))
    total = len(makers) * (len(chosen) if limit is None else min(limit, len(chosen)))
    marked = count(1)
    with counted("cases") as steps:
        document = run.run(
            makers,
            chosen,
            limit=limit,
            pictures=pictures,
            on_mark=lambda name, mark: steps.tell(next(marked), total, name),
        )
    if out is not None:
        if out.exists():
            complain(f"pliant: '{named(out)}' was there, and is replaced")
        write_json(out, document)
    console = Console(soft_wrap=True)
    console.print(table.markdown(document), highlight=False, end="")
    if silent := table.undecided(document):
        told = f"{', '.join(silent)} decided nothing: the row is not its own"
        console.print(told, style="bold", highlight=False)
        return UNDECIDED
    return 0


def _makers(names: tuple[str, ...], model: ModelOptions) -> Mapping[str, Make]:
    """Makers of the reasoners to be asked, by the name shown. Each reasoner is made once here, so
    that one that cannot be made is refused before anything is asked."""
    model.refuse_without(is_asked=VLM in names)
    settings = model.settings
    if settings.probes:
        raise InputError("--probes: nothing moves here, so that nobody can probe; leave it out")
    makers: dict[str, Make] = {}
    for name in map(located_own, names):
        if [*map(located_own, names)].count(name) > 1:
            raise InputError(f"reasoner '{short_name(name)}' is given twice: give it once")
        if name == VLM:
            vlm(settings, replay=_recording(model.replay, "0001"))
            makers[f"{VLM} ({settings.name})" if settings.name else VLM] = _vlm_for(model)
        elif name == coin.NAME:
            makers[name] = lambda case: coin.Coin()
        else:
            reasoner(name)
            called = short_name(name)
            if called in makers and called != name:
                raise InputError(f"two reasoners are both named {called}: rename the file of one")
            makers[called] = lambda case, name=name: reasoner(name)  # type: ignore[misc]
    return makers


def _vlm_for(model: ModelOptions) -> Make:
    def make(case: str) -> Reasoner:
        record, replay = (_recording(folder, case) for folder in (model.record, model.replay))
        return vlm(model.settings, record=record, replay=replay)

    return make


def _recording(folder: Path | None, case: str) -> Path | None:
    return None if folder is None else folder / f"{case}.jsonl"


def _check_writable(out: Path) -> None:
    """Refuse a file that could not be written, before anything is asked."""
    folder = next(parent for parent in out.absolute().parents if parent.exists())
    try:
        with TemporaryFile(dir=folder):  # who is root may write anywhere, but not in /proc
            is_writable = not out.is_dir()
    except OSError:
        is_writable = False
    if not is_writable:
        raise InputError(f"'{out}' cannot be written: choose another file for --out")
