"""`pliant experiment`: many trials, on every core or on a cluster, resumable."""

from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from pliant.cli.model import ModelOptions
from pliant.cli.ranges import Ranges
from pliant.experiment import plan, runner, tables
from pliant.experiment.progress import Shown
from pliant.experiment.tables_text import markdown
from pliant.experiment.work import Save


def experiment(
    file: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    pegs: tuple[str, ...] | None = None,
    conditions: tuple[str, ...] | None = None,
    reasoners: tuple[str, ...] | None = None,
    trials: int | None = None,
    first_seed: int | None = None,
    level: str | None = None,
    goals: Path | None = None,
    out: Path = Path("runs/experiment"),
    workers: int | None = None,
    ray: str | None = None,
    save: Annotated[Save, tyro.conf.EnumChoicesFromValues] = Save.NONE,
    time_limit_s: float = runner.TIME_LIMIT_S,
    ranges: Annotated[Ranges, tyro.conf.arg(name="")] = Ranges(),  # noqa: B008
    model: Annotated[ModelOptions, tyro.conf.arg(name="")] = ModelOptions(),  # noqa: B008
) -> int:
    """Run an experiment, or go on with one that was interrupted: the same command does both.

    Args:
        file: an experiment file (YAML) with the same fields; options given here replace its own.
        pegs: shipped pegs or peg files.
        conditions: of none, friction, pose and all.
        reasoners: rules, messages, sweep, retry, none, oracle, vlm, or your own
            (path/to/file.py:Class).
        trials: per cell; default 30.
        first_seed: default 1; seeds pair across cells.
        level: the rung of the ladder.
        goals: a taught goals file in place of the shipped one.
        out: the result folder.
        workers: processes; default one per core.
        ray: address of a Ray cluster to run on instead.
        save: whose trials' full records to keep.
        time_limit_s: of one trial, after which its worker is ended.
        ranges: ranges in place of the conditions' own.
        model: the model behind the reasoner vlm.
    """
    given = {
        "pegs": pegs,
        "conditions": conditions and [ranges.applied_to(name) for name in conditions],
        "reasoners": reasoners,
        "trials": trials,
        "first_seed": first_seed,
        "level": level,
        "goals": None if goals is None else str(goals),
        "vlm": model.given or None,
    }
    overrides = {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
    if file is not None:
        planned = plan.load(file, overrides)
    else:
        default = {"pegs": ["circle"], "conditions": ["all"], "reasoners": ["rules"]}
        planned = plan.from_fields(default, overrides)
    model.check(planned)
    console = Console()
    ended = runner.run(
        planned,
        out,
        workers=workers,
        ray=ray,
        save=save,
        time_limit_s=time_limit_s,
        watcher=Shown(planned, console),
        record=model.record,
        replay=model.replay,
    )
    if not ended.complete:
        console.print(f"{ended.done} of {ended.total} trials are done; the same command goes on")
        return 1
    text = markdown(tables.write(out))
    console.print(text, markup=False, highlight=False, soft_wrap=True)
    console.print(f"results: {out}", markup=False, highlight=False)
    return 0
