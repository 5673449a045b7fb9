"""The journal: one line per finished trial, appended and synced, from which a killed run resumes.

A line is JSON: `{"trial_id": ..., "inserted": ..., "rows": {"trial": {...}, "executions": [...]},
"crc": ...}`. The CRC-32 covers the bytes before it, so that a scan finds every damaged line without
parsing it whole. A last line without its end is what a kill leaves: it is dropped, and its trial
runs again.
"""

import errno
import json
import os
import shutil
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from mmap import ACCESS_READ, mmap
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pliant import store
from pliant.errors import InputError
from pliant.experiment import faults
from pliant.experiment.rows import Rows
from pliant.files import write_bytes

FILE = store.JOURNAL
OUTDATED = ".outdated"
"""The name of a file that stands beside the journal while the Parquet files may say what lines said
before."""
_APPEND = os.O_RDWR | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)  # never through a link
_ROWS, _CRC = b',"rows":', b',"crc":'
_MOST_LINE = 1 << 26  # [bytes]
_FAULT = b'"end_reason":"%s' % faults.PREFIX.encode()
_LEAST_FREE = 16_000_000  # [bytes] a trial's whole record, and a little
_BUFFER = 1 << 18  # [bytes]; Python's own is shorter than a line, which makes reading 6 x slower


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A whole line of the journal: whose it is, what came of it, and where in the file it starts
    [bytes]. `fault` says why nothing was measured; empty: it was."""

    trial_id: str
    inserted: bool | None
    offset: int
    fault: str = ""


def scan(path: Path) -> Iterator[Entry]:
    """Every whole line of a journal in file order, checked but not parsed: memory stays at one
    line.

    Raises:
        InputError: the file cannot be read, or a line that is not the last is damaged.
    """
    try:
        with path.open("rb", buffering=_BUFFER) as file:
            offset = 0
            lines = iter(partial(file.readline, _MOST_LINE + 1), b"")
            for number, line in enumerate(lines, start=1):
                if len(line) > _MOST_LINE:
                    raise _damaged(number, path)
                if not line.endswith(b"\n"):
                    return  # torn: a kill in the middle of the write
                _check(line, number, path)
                yield _entry(line, offset, number, path)
                offset += len(line)
    except OSError as error:
        raise InputError(f"journal '{path}' cannot be read: {error.strerror}") from error


def torn_bytes(path: Path) -> int:
    """Length of an unfinished last line [bytes]; 0 if the file ends with a whole one."""
    if not path.exists() or path.stat().st_size == 0:
        return 0
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        return len(content) - (content.rfind(b"\n") + 1)


def rows_at(path: Path, offsets: Iterator[int]) -> Iterator[Rows]:
    """The rows of the lines that start at `offsets`, in that order.

    Raises:
        InputError: a line is damaged.
    """
    with path.open("rb") as file:
        for offset in offsets:
            file.seek(offset)
            line = file.readline()
            _check(line, None, path)
            yield _rows(line, path)


class Busy(InputError):
    """The error that another process is writing to the journal."""


class Journal:
    """The journal, open for appending by one process at a time. Use it as a context. All that a
    finished trial will need of the file system is tried as it opens.

    Raises:
        InputError: it cannot be opened, another process is writing to it, or its file system is
            full, or can neither lock a file nor say when one is on the disk.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.torn = 0
        try:
            self._file = os.open(path, _APPEND | os.O_CREAT, 0o644)
            _lock(self._file, path)
            _see_that_it_keeps(self._file, path)
            self.torn = torn_bytes(path)
            if self.torn:
                os.ftruncate(self._file, os.path.getsize(path) - self.torn)  # noqa: PTH202
        except OSError as error:
            raise _unwritable(path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        os.close(self._file)  # and with it the lock

    def append(self, rows: Rows) -> int:
        """Write a finished trial; when it is on the disk, return where its line starts [bytes].

        Raises:
            InputError: it cannot be written; what was written before is kept.
        """
        line = encoded(rows)
        before = os.fstat(self._file).st_size
        try:
            if os.write(self._file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file)
        except OSError as error:
            os.ftruncate(self._file, before)
            raise _unwritable(self.path, error) from error
        return before

    def replace(self, rows: Rows) -> None:
        """Write another line in the place of a finished trial's; the whole file, or nothing. The
        Parquet files are outdated from then on, until they are written again.

        Raises:
            InputError: it cannot be written.
        """
        lines = self.path.read_bytes().splitlines(keepends=True)
        for n, entry in enumerate(scan(self.path)):
            if entry.trial_id == rows.trial_id:
                lines[n] = encoded(rows)
        write_bytes(self.path.with_name(OUTDATED), b"")
        old = self._file
        write_bytes(self.path, b"".join(lines))
        self._file = os.open(self.path, _APPEND)
        _lock(self._file, self.path)
        os.fsync(self._file)
        os.close(old)


def encoded(rows: Rows) -> bytes:
    """A journal line, its end included."""
    document = {
        "trial_id": rows.trial_id,
        "inserted": rows.trial["inserted"],
        "rows": {"trial": rows.trial, "executions": rows.executions},
    }
    body = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()[:-1]
    return b"%b%b%d}\n" % (body, _CRC, zlib.crc32(body))


def _fault(line: bytes, path: Path) -> str:
    """The fault that a line tells of. Only a line that has the mark of one is parsed; in a string
    its quotes would be escaped."""
    if _FAULT not in line:
        return ""
    trial = _rows(line, path).trial
    return faults.told(trial) if faults.is_fault(trial) else ""


def _check(line: bytes, number: int | None, path: Path) -> None:
    cut = line.rfind(_CRC)
    if cut >= 0 and line[cut + len(_CRC) :] == b"%d}\n" % zlib.crc32(memoryview(line)[:cut]):
        return
    raise _damaged(number, path)


def _damaged(number: int | None, path: Path) -> InputError:
    where = f"line {number} of " if number else ""
    return InputError(
        f"{where}journal '{path}' is damaged: delete that line and run the experiment again, and"
        " its trial is repeated"
    )


def _entry(line: bytes, offset: int, number: int, path: Path) -> Entry:
    """The entry at the head of a line. Its checksum only says that it is as somebody wrote it."""
    match _parsed(line.partition(_ROWS)[0] + b"}"):
        case {"trial_id": str(trial_id), "inserted": bool() | None as inserted}:
            fault = _fault(line, path)
            return Entry(trial_id=trial_id, inserted=inserted, offset=offset, fault=fault)
    raise _damaged(number, path)


def _parsed(text: bytes) -> Any:
    """The values of a JSON text; None where it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _rows(line: bytes, path: Path) -> Rows:
    match _parsed(line):
        case {"rows": {"trial": dict(trial), "executions": list(executions)}}:
            if all(isinstance(e, dict) for e in executions):
                return Rows(trial=trial, executions=executions)
    raise _damaged(None, path)


def _lock(file: int, path: Path) -> None:
    """Lock the journal for one writer: the lock is the process's, and goes with it, however it
    ends."""
    if sys.platform == "win32":
        return
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(file)
        raise Busy(
            f"another experiment is writing to '{path.parent}': wait for it, or choose another"
            " folder"
        ) from error
    except OSError as error:
        os.close(file)
        raise _elsewhere(path, f"cannot lock a file ({error.strerror})") from error


def _see_that_it_keeps(file: int, path: Path) -> None:
    """Try, before anything moves, what keeping a line needs: a trial whose end cannot be written
    down is lost."""
    free = shutil.disk_usage(path.parent).free
    if free < _LEAST_FREE:
        raise InputError(
            f"only {free / 1e6:.1f} MB are free in '{path.parent}', and {_LEAST_FREE / 1e6:.0f} MB"
            " are needed to begin: free space, or choose another folder"
        )
    try:
        os.fsync(file)
    except OSError as error:
        raise _elsewhere(
            path, f"cannot say when a file is on the disk (fsync: {error.strerror})"
        ) from error


def _elsewhere(path: Path, why: str) -> InputError:
    return InputError(
        f"'{path.parent}' is on a file system that {why}, so a finished trial could be lost: choose"
        " a folder on a disk of this machine"
    )


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(
        f"journal '{path}' cannot be written: {error.strerror}; what is finished is kept, and the"
        " same command goes on from there"
    )
