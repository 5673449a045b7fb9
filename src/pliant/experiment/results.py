"""The Parquet files of a run, derived from its journal in canonical order: by cell, then seed."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, islice
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pliant import folders, store
from pliant.errors import InputError
from pliant.experiment.columns import EXECUTIONS, TRIALS, Column, schema
from pliant.experiment.journal import FILE, OUTDATED, Busy, Journal, rows_at, scan
from pliant.experiment.rows import Row, Rows
from pliant.records import SCHEMA

TRIALS_FILE, EXECUTIONS_FILE = "trials.parquet", "executions.parquet"
_BATCH = 2000  # trials in memory at a time, and rows of a row group
_MOST_AT_ONCE = 1 << 28  # [bytes] of a batch of rows, were every text the longest
_MOST_BYTES = 1 << 31  # of all rows in memory: ten times those of a million trials' numbers
_MOST_SAID = 200  # characters of Arrow's own words
_AGAIN = "write it again with the command that began the experiment"
_WHOSE = (
    *("trial_id", "cell", "level", "peg", "method", "condition", "reasoner", "seed", "judged"),
    *("end_reason", "executions", "moves", "simulated_s", "wall_s"),
    *("decisions", "own", "clamped", "fallbacks", "tokens"),
)
T = TypeVar("T")


def see_results(folder: Path) -> None:
    """See that a folder holds something that pliant wrote: a run, finished or not, or a trial.

    Raises:
        InputError: it does not, or is not there.
    """
    name = "name the result folder of `pliant experiment` or `pliant run`"
    if not folder.exists():
        raise InputError(f"'{folder}' does not exist: {name}")
    ours = (store.RUN, FILE, TRIALS_FILE, store.TRIAL, store.TRIALS)
    if not any((folder / file).exists() for file in ours):
        raise InputError(f"'{folder}' holds no results of pliant: {name}")


def write(folder: Path, journal: Path, offsets: Iterable[int]) -> None:
    """Write both Parquet files from the journal lines at `offsets`, in that order; whole or not.

    Raises:
        InputError: a line is damaged, or the files cannot be written.
    """
    write_rows(folder, rows_at(journal, iter(offsets)))
    try:
        (folder / OUTDATED).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"'{folder / OUTDATED}' cannot be removed: {error.strerror}") from error


def refresh(folder: Path) -> None:
    """Write the Parquet files again, in the order they have, where lines of the journal were
    replaced since: whoever did it, as `pliant label` does, may have been killed before this. What
    is still being replaced is left to whoever does.

    Raises:
        InputError: a line is damaged or is missing, or the files cannot be written.
    """
    path = folder / FILE
    if not (folder / OUTDATED).exists() or not (folder / TRIALS_FILE).is_file():
        return
    try:
        with Journal(path):
            offsets = {entry.trial_id: entry.offset for entry in scan(path)}
            order = _trials(folder)["trial_id"].to_pylist()
            if missing := [trial_id for trial_id in order if trial_id not in offsets]:
                raise InputError(
                    f"journal '{path}' lacks the trial '{missing[0]}' of '{TRIALS_FILE}': {_AGAIN}"
                )
            write(folder, path, [offsets[trial_id] for trial_id in order])
    except Busy:
        return


def write_rows(folder: Path, rows: Iterable[Rows]) -> None:
    """Write both Parquet files from rows in memory, as one experiment's or one trial's.

    Raises:
        InputError: the files cannot be written.
    """
    trials, executions = schema(TRIALS), schema(EXECUTIONS)
    try:
        with (
            folders.whole(folder / TRIALS_FILE) as first,
            folders.whole(folder / EXECUTIONS_FILE) as second,
            pq.ParquetWriter(first, trials, write_page_checksum=True) as trial_file,
            pq.ParquetWriter(second, executions, write_page_checksum=True) as execution_file,
        ):
            for batch in _batches(rows):
                done, steps = [r.trial for r in batch], [e for r in batch for e in r.executions]
                trial_file.write_table(pa.Table.from_pylist(done, schema=trials))
                execution_file.write_table(pa.Table.from_pylist(steps, schema=executions))
    except (pa.ArrowException, LookupError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"the rows of '{folder}' are not what pliant writes ({type(error).__name__}: {error})"
        ) from error
    except OSError as error:
        raise InputError(
            f"the results cannot be written to '{folder}': {error.strerror or error}; free space"
            " or choose another folder, and run the same command again"
        ) from error


def read_trials(folder: Path) -> pa.Table:
    """Read trials.parquet of a finished run, after `refresh`.

    Raises:
        InputError: the file is missing, broken or larger than results are, or has another schema;
            or it is outdated and cannot be written again.
    """
    refresh(folder)
    return _trials(folder)


def _trials(folder: Path) -> pa.Table:
    path = folder / TRIALS_FILE
    table = pa.Table.from_batches(_read(path, TRIALS, _WHOSE), schema(TRIALS))
    ids = table["trial_id"]
    if pc.count_distinct(ids).as_py() < len(ids):
        raise InputError(f"'{path}' is broken: a trial is in it twice; {_AGAIN}")
    return table


def each_trials_executions(folder: Path) -> Iterator[list[Row]]:
    """The rows of executions.parquet, trial by trial, a batch in memory at a time.

    Raises:
        InputError: as `read_trials`.
    """
    refresh(folder)
    batches = _read(folder / EXECUTIONS_FILE, EXECUTIONS, ("trial_id",))
    rows = (row for batch in batches for row in batch.to_pylist())
    for _, group in groupby(rows, key=lambda row: row["trial_id"]):
        yield list(group)


def _read(
    path: Path, columns: tuple[Column, ...], known: Sequence[str]
) -> Iterator[pa.RecordBatch]:
    """A file's rows in batches, with each page held to its checksum. `known` columns are never
    null. What is packed into few bytes is unpacked only as far as results are large."""
    if not path.is_file():
        see_results(path.parent)
        raise InputError(
            f"'{path.parent}' holds an experiment that is not finished: finish it with the command"
            " that began it"
        )
    folders.refuse_link(path)
    total = 0
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            _check(path, file.schema_arrow, columns)
            for batch in file.iter_batches(_rows_at_once(file.metadata)):
                total += batch.nbytes
                if total > _MOST_BYTES:
                    raise InputError(f"'{path}' is larger than results are: {total / 1e6:.0f} MB")
                for name in known:
                    if batch[name].null_count:
                        raise InputError(
                            f"'{path}' is broken: '{name}' is missing in a row; {_AGAIN}"
                        )
                yield batch
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        said = " ".join(str(error).split())[:_MOST_SAID]
        raise InputError(f"'{path}' is broken ({said}); {_AGAIN}") from error


def _rows_at_once(found: pq.FileMetaData) -> int:
    """The number of rows that cannot take much memory, were each text as long as its column is
    packed."""
    groups = [found.row_group(n) for n in range(found.num_row_groups)]
    longest = max(
        (g.column(n).total_uncompressed_size for g in groups for n in range(g.num_columns)),
        default=1,
    )
    return max(1, min(_BATCH, _MOST_AT_ONCE // max(1, longest)))


def _check(path: Path, written: pa.Schema, columns: tuple[Column, ...]) -> None:
    found = (written.metadata or {}).get(b"pliant_schema", b"none").decode(errors="replace")
    if found != str(SCHEMA) or not written.equals(schema(columns)):
        raise InputError(
            f"'{path}' has schema {found}, or other columns; this pliant reads {SCHEMA}: use the"
            " one that wrote it"
        )


def _batches(items: Iterable[T]) -> Iterator[list[T]]:
    iterator = iter(items)
    while batch := list(islice(iterator, _BATCH)):
        yield batch
