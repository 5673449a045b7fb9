"""`pliant experiment`: many trials, on every core or on a cluster, resumable."""

import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.prompt import Confirm

from pliant import signals
from pliant.cli.cells import attended, where_trials_are
from pliant.cli.model import UNDECIDED, ModelOptions
from pliant.cli.ranges import Ranges
from pliant.cli.tables import made_of
from pliant.console import Console
from pliant.errors import InputError
from pliant.experiment import growth, holdings, plan, price, runner
from pliant.experiment.cells import WHOLE, Experiment
from pliant.experiment.measures import is_undecided
from pliant.experiment.one import whole
from pliant.experiment.progress import Shown
from pliant.experiment.tables_text import markdown
from pliant.experiment.trust import Named, refuse
from pliant.experiment.work import Save
from pliant.paths import located, shown

if TYPE_CHECKING:
    from pliant.cli.following import Watched


def experiment(
    file: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    pegs: tuple[str, ...] | None = None,
    conditions: tuple[str, ...] | None = None,
    reasoners: tuple[str, ...] | None = None,
    trials: int | None = None,
    first_seed: int | None = None,
    level: str | None = None,
    method: str | None = None,
    goals: Path | None = None,
    cell: str = "sim",
    out: Path = Path("runs/experiment"),
    workers: int | None = None,
    ray: str | None = None,
    save: Annotated[Save, tyro.conf.EnumChoicesFromValues] = Save.NONE,
    time_limit_s: float = runner.TIME_LIMIT_S,
    again: Literal["faults"] | None = None,
    watch: bool = False,
    yes: bool = False,
    trust: bool = False,
    ranges: Annotated[Ranges, tyro.conf.arg(name="")] = Ranges(),  # noqa: B008
    model: Annotated[ModelOptions, tyro.conf.arg(name="")] = ModelOptions(),  # noqa: B008
) -> int:
    """Run an experiment, or go on with one: the same command goes on where it was interrupted, and
    one with more trials, pegs, conditions or reasoners adds them to the same folder.

    Args:
        file: an experiment file (YAML) with the same fields; options given here replace its own.
            Files that it names are looked for from its folder.
        pegs: shipped pegs or peg files; default circle, or the level's.
        conditions: of none, friction, pose and all.
        reasoners: rules, messages, sweep, retry, none, oracle, vlm, or your own
            (path/to/file.py:Class).
        trials: per cell; default 30.
        first_seed: default 1; seeds pair across cells.
        level: the rung of the ladder, L0 to L9, or a scenario such as wrong_peg; L0 is the
            paper's grid.
        method: planar (the paper's), guided, also without some of its mechanisms (guided-ease), or
            your own (path/to/file.py:Class); default the level's.
        goals: a taught goals file in place of the cell's or the shipped one.
        cell: sim, the path of a cell's file (.yaml), or your own as path/to/file.py:Class. At a
            real cell you are told what to place, and asked how each trial went.
        out: the result folder.
        workers: processes; default one per core. Simulated cell only, as are the next three.
        ray: address of a Ray cluster to run on instead.
        save: whose trials' full records to keep; of other cells, all are.
        time_limit_s: of one trial, after which its worker is ended.
        again: faults repeats the trials in which nothing was measured, and no others.
        watch: serve the experiment's page to browsers on this machine while it fills, and after the
            last trial until Ctrl-C.
        yes: do not ask before a hosted model is paid.
        trust: do not ask before code is run, or a model asked, that the file names.
        ranges: ranges in place of the conditions' own.
        model: the model behind the reasoner vlm.
    """
    for name, number in (("trials", trials), ("first_seed", first_seed)):
        if number is not None:
            whole(f"--{name.replace('_', '-')}", number, *WHOLE[name])
    if conditions is None and (option := ranges.first_given) is not None:
        if file is not None:
            raise InputError(
                f"{option} is drawn in place of a condition's own range: give --conditions beside"
                " it, or write the range into the file"
            )
        conditions = ("all",)
    out, model, console = located(out), model.placed(), Console(stderr=True)
    given = {
        "pegs": pegs,
        "conditions": conditions and [ranges.applied_to(name) for name in conditions],
        "reasoners": reasoners,
        "trials": trials,
        "first_seed": first_seed,
        "level": level,
        "method": method,
        "goals": None if goals is None else str(goals),
        "vlm": model.given or None,
    }
    overrides = {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
    if file is not None:
        planned = plan.load(
            file,
            overrides,
            agree=partial(_agree, console=console, trust=trust, model=model),
            unnamed=model.unnamed,
        )
    else:
        default = {"conditions": ["all"], "reasoners": ["rules"]}
        if level in (None, "L0"):
            default["pegs"] = ["circle"]
        planned = plan.from_fields(default, overrides, unnamed=model.unnamed)
    planned = replace(planned, where=where_trials_are(cell))
    is_simulated = planned.where.is_simulated
    if not is_simulated and (workers, ray) != (None, None):
        raise InputError("--workers and --ray are for the simulated cell: leave them out")
    model.check(planned)
    if model.replay is None:
        planned.check_models()
        _confirm(planned, console, yes)
    watched = _watched(planned, out, console) if watch else None
    with (
        nullcontext() if is_simulated else attended(planned) as engine,
        nullcontext() if watched is None else watched.filling(),
    ):
        ended = runner.run(
            planned,
            out,
            workers=workers,
            ray=ray,
            save=save,
            time_limit_s=time_limit_s,
            watcher=Shown(
                planned,
                console if is_simulated else Console(stderr=True, force_terminal=False),
            ),
            record=model.record,
            replay=model.replay,
            engine=engine,
            again=again is not None,
            fallback_from_start=model.fallback_from_start,
        )
    status = _told(ended, planned, out, console)
    if watched is not None and ended.complete:
        watched.stay()
    return status


def _watched(planned: Experiment, out: Path, console: Console) -> "Watched":
    from pliant.cli.following import Watched

    goals = None if planned.goals is None else Path(planned.goals)
    return Watched(out, goals, partial(_say, console))


def _told(ended: runner.Finished, planned: Experiment, out: Path, console: Console) -> int:
    """Say how the run ended, and print its tables on standard output; return the command's
    status."""
    if not ended.complete:
        console.print(f"{ended.done} of {ended.total} trials are done; the same command goes on")
        return signals.exit_status() if ended.interrupted else 1
    larger = growth.planned(holdings.held(out)) > len(planned)
    part = {spec.trial_id for spec in planned.specs()} if larger else None
    document = made_of(out, part)
    text = markdown(document)
    printed = Console(highlight=False, soft_wrap=True)
    printed.print(text)
    printed.print(f"results: {shown(out)}")
    if larger:
        _say(
            console,
            f"the folder holds more than these {len(planned)} trials: pliant tables {shown(out)}"
            " shows all",
        )
    undecided = [cell for cell in document["cells"] if is_undecided(cell["own"])]
    names = dict.fromkeys(cell["reasoner"] for cell in undecided)
    if names:
        _say(
            console,
            f"the model of {', '.join(names)} decided nothing in {len(undecided)} of"
            f" {len(document['cells'])} cells: their rows are not its own; mend the cause, and run"
            " them again into another folder (--out)",
            style="bold",
        )
    if ended.faults:
        _say(
            console,
            f"{ended.faults} of {ended.total} trials were faults, of which nothing is known: see"
            f" above; {runner.advice(planned)}",
        )
        return 1
    return UNDECIDED if names else 0


def _agree(named: Named, *, console: Console, trust: bool, model: ModelOptions) -> None:
    """Say what the file leads to, and ask. A recording is replayed without a server.

    Raises:
        InputError: nobody agreed, or nobody is there to ask.
    """
    if model.replay is not None:
        named = replace(named, servers=())
    if named.lines and not trust and not sys.stdin.isatty():
        refuse(named)  # which names it all
    for line in named.lines:
        _say(console, f"the experiment file names {line}")
    if named.lines and not trust:
        _go_on(console, "what the file names was not agreed to")


def _confirm(planned: Experiment, console: Console, yes: bool) -> None:
    """Say what a hosted model will cost, and ask.

    Raises:
        InputError: nobody agreed, or nobody is there to ask.
    """
    cost = price.estimate(planned)
    if cost is None:
        return
    if not yes and not sys.stdin.isatty():
        raise InputError(f"a hosted model costs money, {cost}: add --yes to agree")
    _say(console, str(cost))
    if not yes:
        _go_on(console, "the cost was not agreed to")


def _go_on(console: Console, why_not: str) -> None:
    """Ask whether to go on. Raises InputError where the answer is no."""
    if not Confirm.ask("Go on?", console=console, default=False):
        raise InputError(f"not begun: {why_not}")


def _say(console: Console, text: str, **how: Any) -> None:
    console.print(text, highlight=False, soft_wrap=True, **how)
