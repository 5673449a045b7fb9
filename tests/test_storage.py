"""What storage will be asked for is tried before anything moves, and what may not be written is
shown all the same."""

import errno
import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

import pytest
from test_tables import made
from view_folders import experiment as shown_experiment

from pliant import cli, ending, files, store
from pliant.cli.tables import tables
from pliant.cli.view import view
from pliant.console import Lasting
from pliant.errors import InputError
from pliant.experiment import journal, results

Break = Callable[[pytest.MonkeyPatch], None]


def failing(number: int) -> Callable[..., NoReturn]:
    def fail(*_: object, **__: object) -> NoReturn:
        raise OSError(number, os.strerror(number))

    return fail


def without_locks(patch: pytest.MonkeyPatch) -> None:
    import fcntl

    patch.setattr(fcntl, "flock", failing(errno.ENOLCK))


def without_fsync(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(os, "fsync", failing(errno.EINVAL))


def full(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1_000_000))


BROKEN = [
    (without_locks, "cannot lock a file .* choose a folder on a disk of this machine"),
    (without_fsync, "cannot say when a file is on the disk .* choose a folder"),
    (full, "only 1.0 MB are free"),
]


@pytest.mark.skipif(sys.platform == "win32", reason="locks are POSIX's")
@pytest.mark.parametrize(("broken", "said"), BROKEN)
def test_a_run_whose_end_could_not_be_written_down_does_not_begin(
    broken: Break, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[object] = []
    run_module = importlib.import_module("pliant.cli.run")
    monkeypatch.setattr(run_module, "attempt", lambda *_: None)
    monkeypatch.setattr(run_module, "perform", lambda *a, **_: begun.append(a))
    broken(monkeypatch)
    with pytest.raises(InputError, match=said):
        run_module.run(out=tmp_path / "out", video=False)
    assert not begun


def test_a_file_where_records_go_is_found_before(tmp_path: Path) -> None:
    (tmp_path / store.RUN).touch()
    (tmp_path / store.TRIALS).touch()
    with pytest.raises(InputError, match="cannot be used: Not a directory"):
        store.prepare_folder(tmp_path)


def test_a_record_is_set_apart_under_a_free_name(tmp_path: Path) -> None:
    assert store.set_apart(tmp_path, "a") is None
    for n in (1, 2):
        store.trial_folder(tmp_path, "a").mkdir(parents=True)
        assert store.set_apart(tmp_path, "a") == tmp_path / "aborted" / f"a-{n}"


def test_trials_that_cannot_be_looked_through_are_not_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / store.TRIALS).mkdir()
    monkeypatch.setattr(Path, "iterdir", failing(errno.EACCES))
    with pytest.raises(InputError, match="cannot be looked through: Permission denied"):
        store.kept_trials(tmp_path)


def test_a_journal_line_that_is_replaced_is_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", synced.append)
    with journal.Journal(tmp_path / journal.FILE) as book:
        book.append(made(1, True))
        synced.clear()
        book.replace(made(1, False))
        assert synced


# --- shown all the same --------------------------------------------------------------------------


def test_tables_of_a_folder_that_cannot_be_written_are_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    results.write_rows(tmp_path, [made(1, True)])

    def refused(path: Path, content: bytes) -> None:
        raise InputError(f"'{path}' cannot be written: Read-only file system")

    monkeypatch.setattr(files, "write_bytes", refused)
    assert tables(tmp_path) == 0
    shown = capsys.readouterr()
    assert "| circle | all | rules | 1 | 100.0" in shown.out
    assert shown.err.startswith("pliant: shown only: ")
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize("chosen", [True, False])
def test_pages_of_a_folder_that_cannot_be_written_are_made_elsewhere(
    chosen: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = shown_experiment(tmp_path / "mine")
    before = sorted(folder.rglob("*"))
    out = tmp_path / "pages" if chosen else None
    if not chosen:
        monkeypatch.setattr(os, "access", lambda *_: False)
        monkeypatch.setenv("TMPDIR", str(tmp_path))
        monkeypatch.setattr("tempfile.tempdir", None)
    assert view(folder, out=out) == 0
    shown = capsys.readouterr()
    page = Path(shown.out.strip())
    assert page.is_file()
    assert page.is_relative_to(tmp_path)
    assert not page.is_relative_to(folder)
    assert chosen or "the pages are made in" in shown.err
    assert sorted(folder.rglob("*")) == before
    if chosen:
        with pytest.raises(InputError, match="is not empty"):
            view(folder, out=out)


# --- the terminal --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "said", "status"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "the output cannot be used: No sp", 2),
        (PermissionError(errno.EACCES, "Permission denied", "runs/x"), "'runs/x' cannot be us", 2),
        (MemoryError(), "out of memory", 2),
        (BrokenPipeError(), "", 1),
    ],
)
def test_what_the_machine_refuses_is_one_line(
    error: Exception,
    said: str,
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def called() -> NoReturn:
        raise error

    monkeypatch.setattr(cli, "_called", called)
    monkeypatch.setattr(ending, "_silence", lambda: None)
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == status
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == bool(said)


@pytest.mark.parametrize("program", ["pliant", "pliant.emulator"])
def test_whoever_reads_may_leave_and_nothing_is_said(program: str) -> None:
    read, write = os.pipe()
    os.close(read)
    told = subprocess.run(
        [sys.executable, "-m", program, "--help"],
        stdout=write,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        check=False,
    )
    os.close(write)
    assert (told.returncode, told.stderr) == (1, "")


class Gone(StringIO):
    """A file that can no longer be written."""

    def __init__(self, error: OSError) -> None:
        super().__init__()
        self.error = error

    def write(self, text: str) -> int:
        raise self.error


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), BrokenPipeError()])
def test_a_terminal_that_goes_away_ends_nothing_and_is_said_when_asked(error: OSError) -> None:
    console = Lasting(file=Gone(error))
    console.check()
    console.print("one")
    console.print("two")
    with pytest.raises(type(error)):
        console.check()
