"""The journal loses nothing that was finished, and passes on nothing that is damaged."""

import json
import resource
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pliant.errors import InputError
from pliant.experiment.journal import Journal, encoded, rows_at, scan
from pliant.experiment.rows import Rows


def rows(seed: int, text: str = "") -> Rows:
    return Rows(
        trial={"trial_id": f"L0-circle-all-rules-{seed}", "inserted": True, "text": text},
        executions=[{"index": i, "reason": text} for i in range(2)],
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


def written(path: Path, count: int) -> list[int]:
    with Journal(path) as journal:
        return [journal.append(rows(seed)) for seed in range(count)]


def test_what_was_written_is_read_back_in_any_order(path: Path) -> None:
    offsets = written(path, 3)
    entries = list(scan(path))
    assert [e.offset for e in entries] == offsets
    assert [e.trial_id for e in entries] == [rows(s).trial_id for s in range(3)]
    assert [e.inserted for e in entries] == [True] * 3
    assert list(rows_at(path, iter(reversed(offsets)))) == [rows(2), rows(1), rows(0)]


def test_every_line_is_plain_json(path: Path) -> None:
    written(path, 2)
    for line in path.read_text(encoding="utf-8").splitlines():
        assert json.loads(line)["rows"]["trial"]["inserted"] is True


@given(text=st.text(), cut=st.floats(0, 1, exclude_max=True))
@settings(max_examples=60)
def test_a_last_line_cut_anywhere_is_dropped_and_then_overwritten(
    tmp_path_factory: pytest.TempPathFactory, text: str, cut: float
) -> None:
    path = tmp_path_factory.mktemp("cut") / "journal.jsonl"
    whole, last = encoded(rows(1, text)), encoded(rows(2, text))
    path.write_bytes(whole + last[: int(cut * len(last))])
    assert [e.trial_id for e in scan(path)] == [rows(1).trial_id]
    with Journal(path) as journal:
        assert journal.torn == int(cut * len(last))
        journal.append(rows(3, text))
    assert path.read_bytes() == whole + encoded(rows(3, text))


@given(at=st.integers(0), flip=st.integers(1, 255))
@settings(max_examples=200)
def test_a_changed_byte_in_the_middle_is_found_and_its_line_named(
    tmp_path_factory: pytest.TempPathFactory, at: int, flip: int
) -> None:
    path = tmp_path_factory.mktemp("flip") / "journal.jsonl"
    lines = [bytearray(encoded(rows(seed))) for seed in range(3)]
    lines[1][at % (len(lines[1]) - 1)] ^= flip
    path.write_bytes(b"".join(lines))
    with pytest.raises(InputError, match=r"line 2 of journal .* is damaged: delete that line"):
        list(scan(path))


def test_an_empty_or_absent_journal_holds_nothing(path: Path) -> None:
    with Journal(path) as journal:
        assert journal.torn == 0
    assert list(scan(path)) == []


def test_two_experiments_cannot_write_to_one_journal(path: Path) -> None:
    with Journal(path), pytest.raises(InputError, match="another experiment is writing"):
        Journal(path)
    with Journal(path):
        pass


def test_a_full_disk_ends_in_one_line_and_leaves_the_journal_whole(path: Path) -> None:
    written(path, 2)
    before = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Journal(path) as journal:
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 20, hard))
        try:
            with pytest.raises(InputError, match="cannot be written"):
                journal.append(rows(2))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before
