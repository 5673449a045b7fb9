"""The Parquet files of a run, derived from its journal in canonical order: by cell, then seed."""

from collections.abc import Iterable, Iterator
from itertools import groupby, islice
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.errors import InputError
from pliant.experiment.columns import EXECUTIONS, TRIALS, Column, schema
from pliant.experiment.journal import rows_at
from pliant.experiment.rows import Row, Rows
from pliant.records import SCHEMA

TRIALS_FILE, EXECUTIONS_FILE = "trials.parquet", "executions.parquet"
_BATCH = 2000  # trials in memory at a time, and rows of a row group
T = TypeVar("T")


def write(folder: Path, journal: Path, offsets: Iterable[int]) -> None:
    """Write both Parquet files from the journal lines at `offsets`, in that order; whole or not.

    Raises:
        InputError: a line is damaged, or the files cannot be written.
    """
    write_rows(folder, rows_at(journal, iter(offsets)))


def write_rows(folder: Path, rows: Iterable[Rows]) -> None:
    """Write both Parquet files from rows in memory, as one experiment's or one trial's.

    Raises:
        InputError: the files cannot be written.
    """
    names = (TRIALS_FILE, EXECUTIONS_FILE)
    partial = [folder / f".{name}.part" for name in names]
    trials, executions = schema(TRIALS), schema(EXECUTIONS)
    try:
        with (
            pq.ParquetWriter(partial[0], trials) as trial_file,
            pq.ParquetWriter(partial[1], executions) as execution_file,
        ):
            for batch in _batches(rows):
                trial_file.write_table(_table([r.trial for r in batch], trials))
                execution_file.write_table(
                    _table([e for r in batch for e in r.executions], executions)
                )
        for path, name in zip(partial, names, strict=True):
            path.replace(folder / name)
    except OSError as error:
        raise InputError(
            f"the results cannot be written to '{folder}': {error.strerror or error}; free space"
            " or choose another folder, and run the same command again"
        ) from error


def read_trials(folder: Path) -> pa.Table:
    """trials.parquet of a finished run.

    Raises:
        InputError: the file is missing or broken, or has another schema.
    """
    path = folder / TRIALS_FILE
    _check(path, TRIALS)
    return pq.read_table(path)


def each_trials_executions(folder: Path) -> Iterator[list[Row]]:
    """The rows of executions.parquet, trial by trial, a batch in memory at a time.

    Raises:
        InputError: as `read_trials`.
    """
    path = folder / EXECUTIONS_FILE
    _check(path, EXECUTIONS)
    batches = pq.ParquetFile(path).iter_batches(batch_size=_BATCH)
    rows = (row for batch in batches for row in batch.to_pylist())
    for _, group in groupby(rows, key=lambda row: row["trial_id"]):
        yield list(group)


def _check(path: Path, columns: tuple[Column, ...]) -> None:
    if not path.is_file():
        raise InputError(
            f"'{path}' does not exist: name the folder of a finished experiment, or finish it with"
            " the command that began it"
        )
    try:
        written = pq.read_schema(path)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(f"'{path}' cannot be read: {str(error).splitlines()[0]}") from error
    found = (written.metadata or {}).get(b"pliant_schema", b"none").decode()
    if found != str(SCHEMA) or not written.equals(schema(columns)):
        raise InputError(
            f"'{path}' has schema {found}, or other columns; this pliant reads {SCHEMA}: use the"
            " one that wrote it"
        )


def _table(rows: list[Row], target: pa.Schema) -> pa.Table:
    return pa.Table.from_pylist(rows, schema=target)


def _batches(items: Iterable[T]) -> Iterator[list[T]]:
    iterator = iter(items)
    while batch := list(islice(iterator, _BATCH)):
        yield batch
