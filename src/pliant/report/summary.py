"""The data of an experiment's page, read from its folder: a finished one's Parquet files, or the
journal of one that is not finished."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pliant.errors import InputError
from pliant.experiment import growth, journal, results, tables
from pliant.experiment.measures import Row, names
from pliant.records import SCHEMA
from pliant.store import RUN

Document = Mapping[str, Any]
Names = growth.Names


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A summary of an experiment: `run` is run.json, `tables` what `pliant tables` gives, `trials`
    the rows of trials.parquet."""

    run: Document
    tables: Document
    trials: list[Row]

    @property
    def cells(self) -> Mapping[Names, Document]:
        """The experiment's cells by their names, as they are configured."""
        cells = self.run["configuration"].get("cells", [])
        return {growth.names(cell): cell for cell in cells}

    @property
    def planned(self) -> int:
        """The number of trials that the experiment has when it is finished."""
        return growth.planned(self.run["configuration"])


def read(folder: Path) -> Summary:
    """Read an experiment's folder, or the one of a single run.

    Raises:
        InputError: it is no such folder, holds no finished trial yet, or something in it is broken.
    """
    results.see_results(folder)
    run = _run(folder)
    if (folder / results.TRIALS_FILE).is_file():
        return _read(folder, run)
    path = folder / journal.FILE
    offsets = [entry.offset for entry in journal.scan(path)] if path.is_file() else []
    if not offsets:
        raise InputError(f"'{folder}' holds no finished trial yet: look again when one has ended")
    rows = list(journal.rows_at(path, iter(offsets)))
    places = {cell: n for n, cell in enumerate(map(growth.names, run["configuration"]["cells"]))}
    rows.sort(key=lambda r: (places.get(names(r.trial), len(places)), r.trial["seed"]))
    with TemporaryDirectory() as derived:
        results.write_rows(Path(derived), rows)
        return _read(Path(derived), run)


def _read(folder: Path, run: Document) -> Summary:
    trials = results.read_trials(folder).to_pylist()
    return Summary(run=run, tables=tables.build(folder), trials=trials)


def _run(folder: Path) -> Document:
    path = folder / RUN
    try:
        run = json.loads(path.read_bytes())
        if run["schema"] != SCHEMA:
            raise InputError(
                f"'{path}' has schema {run['schema']!r}; this pliant reads {SCHEMA}: use the one"
                " that wrote it"
            )
        cells = run["configuration"]["cells"]
        for cell in cells:
            growth.names(cell)
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be read: {error.strerror}; name the result folder of `pliant"
            " experiment` or `pliant run`"
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"'{path}' is broken ({error!r}): name the result folder of `pliant experiment` or"
            " `pliant run`"
        ) from error
    return run
