"""`pliant.compare` and `pliant.Results`: an experiment from Python, with its results as one expects
them in a notebook."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from pliant import html
from pliant.console import Console
from pliant.errors import InputError
from pliant.experiment import plan, results, runner, tables, tables_text
from pliant.experiment.columns import EXECUTIONS, schema
from pliant.experiment.progress import Shown, Watcher
from pliant.paths import located, shown

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path("runs/experiment")


@dataclass(frozen=True)
class Results:
    """The results of a finished experiment, in its folder: a row per trial (`trials`), a row per
    execution (`executions`), and the paper's `tables`. A notebook shows Table II. `folder` is one
    of `pliant experiment`, or of `compare`.

    Raises:
        InputError: on the first look at them: the folder holds no finished experiment.
    """

    folder: Path | str

    @cached_property
    def trials(self) -> pa.Table:
        """A row per trial: docs/data.md describes the columns."""
        return results.read_trials(Path(self.folder))

    @cached_property
    def executions(self) -> pa.Table:
        """A row per execution, those of a trial together."""
        rows = (row for group in results.each_trials_executions(Path(self.folder)) for row in group)
        return pa.Table.from_pylist(list(rows), schema=schema(EXECUTIONS))

    @cached_property
    def tables(self) -> Mapping[str, Any]:
        """Every table of `pliant tables --json`; percentages from 0 to 100."""
        return tables.build(Path(self.folder))

    def to_pandas(self) -> "pd.DataFrame":
        """The trials as a frame of pandas, a row per trial.

        Raises:
            InputError: pandas is not installed.
        """
        return _framed(self.trials)

    def executions_to_pandas(self) -> "pd.DataFrame":
        """The executions as a frame of pandas; `trial_id` leads to the trial.

        Raises:
            InputError: pandas is not installed.
        """
        return _framed(self.executions)

    def __len__(self) -> int:
        return len(self.trials)

    def __repr__(self) -> str:
        return f"<Results {shown(Path(self.folder))}: {len(self)} trials>"

    def _repr_html_(self) -> str:
        """A notebook's view: Table II."""
        shown = tables_text.success(self.tables["cells"])
        rows = (html.row("td", row) for row in shown.rows)
        table = html.tag("table", html.row("th", shown.head), *rows)
        return html.join(html.tag("p", repr(self)), table)


def compare(
    *,
    pegs: str | Sequence[str] = "circle",
    conditions: str | Sequence[Any] = "all",
    reasoners: str | Sequence[str] = "rules",
    trials: int = 30,
    first_seed: int = 1,
    level: str | None = None,
    method: str | None = None,
    out: Path | str = FOLDER,
    workers: int | None = None,
    watcher: Watcher | None = None,
) -> Results:
    """Run every combination on the same seeds, or what is missing of it in the folder `out`, and
    return the results. As `pliant experiment`, whose options these are; `workers` None: every core,
    `watcher` None: progress is shown on standard error.

    In a script, call it below `if __name__ == "__main__":`, since workers import the script.

    Raises:
        InputError: something given cannot be used, or the folder holds something else.
        KeyboardInterrupt: it was interrupted: what is finished is kept, and the same call goes on.
    """
    fields = {
        "pegs": _listed(pegs),
        "conditions": _listed(conditions),
        "reasoners": _listed(reasoners),
        "trials": trials,
        "first_seed": first_seed,
        "level": level,
        "method": method,
    }
    experiment = plan.from_fields({k: v for k, v in fields.items() if v is not None})
    folder = located(Path(out))
    told = Shown(experiment, Console(stderr=True))
    ended = runner.run(experiment, folder, workers=workers, watcher=watcher or told)
    if not ended.complete:
        raise KeyboardInterrupt(f"{ended.done} of {ended.total} trials are done in '{folder}'")
    return Results(folder)


def _listed(given: str | Sequence[Any]) -> list[Any]:
    return list(given) if isinstance(given, list | tuple) else [given]


def _framed(table: pa.Table) -> "pd.DataFrame":
    try:
        return table.to_pandas()
    except ImportError as error:
        raise InputError("pandas is not installed: pip install pandas") from error
