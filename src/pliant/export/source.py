"""The stored run that a data set is made from: which trials kept their record, and their split."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant import folders
from pliant.conditions import NOMINAL
from pliant.errors import InputError
from pliant.experiment import faults, results
from pliant.experiment.rows import Row
from pliant.sim.replay import FILE as TRAJECTORY
from pliant.store import MOST_JSON, RUN, TRIAL, trial_folder

SPLITS = TRAIN, TEST = "train", "test"
HELD_OUT = 5  # every fifth seed


@dataclass(frozen=True, kw_only=True)
class Saved:
    """A trial whose record was kept: its folder, its row of trials.parquet, its split."""

    folder: Path
    row: Row
    split: str

    @property
    def trial_id(self) -> str:
        return str(self.row["trial_id"])


@dataclass(frozen=True, kw_only=True)
class Source:
    """A finished run: `trials` in all, and those `saved`, train before test."""

    folder: Path
    run: Mapping[str, Any]  # run.json
    trials: int
    saved: tuple[Saved, ...]

    def one(self) -> Saved:
        """The only trial that was chosen.

        Raises:
            InputError: there are several.
        """
        if len(self.saved) > 1:
            raise InputError(
                f"'{self.folder}' holds {len(self.saved)} trials: choose one with --trial, for"
                f" example --trial {self.saved[0].trial_id}"
            )
        return self.saved[0]


def open_run(folder: Path, *chosen: str) -> Source:
    """Read which trials of a run can be exported: all that kept their record, or those `chosen` by
    their trial_id. One in which nothing was measured is no failure: it is left out, unless it is
    named.

    Raises:
        InputError: the run is not finished, kept no trial's record, or has no such trial.
    """
    results.see_results(folder)
    folders.refuse_links(folder)
    rows = results.read_trials(folder).to_pylist()
    found = splits(rows)
    saved = [
        Saved(folder=kept, row=row, split=split)
        for row, split in zip(rows, found, strict=True)
        if (chosen or not faults.is_fault(row))
        and ((kept := trial_folder(folder, row["trial_id"])) / TRIAL).is_file()
    ]
    if not saved:
        raise InputError(
            f"'{folder}' kept no trial's record: make a run with 'pliant experiment … --save all'"
            " (or failures), or with 'pliant run', and export that"
        )
    if chosen:
        kept_ids = {s.trial_id for s in saved}
        for trial_id in chosen:
            if trial_id not in kept_ids:
                raise InputError(
                    f"'{folder}' kept no record of a trial '{trial_id}': its folder 'trials' has"
                    " those that can be chosen"
                )
        saved = [s for s in saved if s.trial_id in chosen]
    saved.sort(key=lambda s: s.split == TEST)
    return Source(folder=folder, run=_run_json(folder), trials=len(rows), saved=tuple(saved))


def replayable(source: Source) -> tuple[Saved, ...]:
    """The saved trials whose motion can be replayed: simulated, with at least one execution.

    Raises:
        InputError: there is none.
    """
    found = tuple(
        s for s in source.saved if s.row["executions"] and (s.folder / TRAJECTORY).is_file()
    )
    if not found:
        raise InputError(
            f"'{source.folder}' kept no trial whose motion can be replayed: a simulated one"
            " that ended at least one execution"
        )
    return found


def counts(trials: tuple[Saved, ...]) -> dict[str, int]:
    """The number of trials in each split."""
    counted = Counter(s.split for s in trials)
    return {split: counted[split] for split in SPLITS}


def splits(rows: Sequence[Row]) -> list[str]:
    """Each trial's split: test if the lowest seed that drew the same setup is a held-out one. Where
    nothing is drawn, every seed gives the same trial, and all of them go the same way."""
    setups = [tuple(row[f"drawn_{name}"] for name in NOMINAL) for row in rows]
    first: dict[tuple[float, ...], int] = {}
    for setup, row in zip(setups, rows, strict=True):
        first[setup] = min(first.get(setup, row["seed"]), row["seed"])
    return [TRAIN if first[setup] % HELD_OUT else TEST for setup in setups]


def _run_json(folder: Path) -> Mapping[str, Any]:
    path = folder / RUN
    try:
        document = json.loads(folders.read(path, MOST_JSON))
    except (OSError, ValueError) as error:
        raise InputError(
            f"'{path}' cannot be read ({error}): it says what made the run, and every data set must"
            " say so too; run it again"
        ) from error
    if not isinstance(document, dict):
        raise InputError(f"'{path}' is not what pliant writes: run it again")
    return document
