"""A folder from somebody else is data: nothing outside it is read, written or removed, what is
packed small is not unpacked, and what is broken costs its own page."""

import json
import os
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from view_folders import experiment, ran

from pliant import files, folders, pictures, store, teaching
from pliant.errors import InputError
from pliant.experiment import journal, labels, results, tables
from pliant.experiment.bench.cases import SHIPPED, Cases
from pliant.experiment.rows import rows_of
from pliant.export.source import open_run
from pliant.report.view import view
from pliant.sim import replay
from pliant.teaching import shipped

TRIAL = Path("trials") / "L0-circle-none-none-1"


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return experiment(tmp_path_factory.mktemp("original"), keep=ran()[0])


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    """The folder that a stranger sends."""
    return Path(shutil.copytree(original, tmp_path / "run"))


@pytest.fixture
def mine(tmp_path: Path) -> Iterator[Path]:
    """A folder of mine, that is the same afterwards."""
    home = tmp_path / "home"
    (home / "photos").mkdir(parents=True)
    (home / "photos" / "holiday.jpg").write_text("mine", encoding="utf-8")
    (home / ".bashrc").write_text("mine", encoding="utf-8")
    before = _content(home)
    yield home
    assert _content(home) == before


def _content(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b""
        for path in folder.rglob("*")
    }


def assert_in_a_line(refused: InputError) -> None:
    assert "\n" not in str(refused)


def look(folder: Path) -> tuple[str, ...]:
    """What `pliant view` says is wrong."""
    return view(folder, [shipped()]).problems


# --- links ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "target"),
    [
        (TRIAL / "overlays", "photos"),  # its pictures were removed
        (TRIAL / "index.html", ".bashrc"),
        (TRIAL / ".index.html.4711.part", ".bashrc"),  # was written over
        (TRIAL / "pictures" / "0123456789abcdef.png", ".bashrc"),
        (TRIAL / "deep" / "deeper", "photos"),
    ],
)
def test_a_link_in_a_trials_folder_costs_that_trials_page(
    folder: Path, mine: Path, place: Path, target: str
) -> None:
    (folder / place).parent.mkdir(parents=True, exist_ok=True)
    (folder / place).symlink_to(mine / target)
    (problem,) = look(folder)
    assert f"{place}' is a link" in problem
    assert "\n" not in problem
    assert (folder / "index.html").is_file()
    assert not (folder / TRIAL / "overlays" / "01-approach.jpg").exists()


def test_a_trial_that_is_a_link_is_not_followed(folder: Path, mine: Path) -> None:
    (folder / "trials" / "other").symlink_to(folder / TRIAL)
    (problem,) = look(folder)
    assert "other' is a link" in problem
    assert (folder / TRIAL / "index.html").is_file()


@pytest.mark.parametrize("name", ["assets", "index.html", "trials", ".index.html.4711.part"])
def test_a_link_beside_the_trials_is_refused(folder: Path, mine: Path, name: str) -> None:
    if name == "trials":
        shutil.move(folder / "trials", mine.parent / "elsewhere")
        (folder / name).symlink_to(mine.parent / "elsewhere")
    else:
        (folder / name).symlink_to(mine / "photos")
    with pytest.raises(InputError, match=f"{name}' is a link"):
        look(folder)


def test_a_trial_viewed_alone_shares_no_files_through_a_link(folder: Path, mine: Path) -> None:
    (folder / "assets").symlink_to(mine / "photos")
    with pytest.raises(InputError, match="assets' is a link"):
        look(folder / TRIAL)


def test_a_pipe_is_not_waited_for(folder: Path) -> None:
    (folder / TRIAL / "trial.json").unlink()
    os.mkfifo(folder / TRIAL / "trial.json")
    (problem,) = look(folder)
    assert "neither a file nor a folder" in problem


def _resumed(folder: Path) -> None:
    store.prepare_folder(folder)


def _labelled(folder: Path) -> None:
    labels.label(folder, lambda trial, picture: True)


@pytest.mark.parametrize("command", [tables.write, open_run, _resumed, _labelled])
def test_no_command_follows_a_link(
    folder: Path, mine: Path, command: Callable[[Path], Any]
) -> None:
    (folder / "journal.jsonl").touch()
    (folder / "tables.md").symlink_to(mine / ".bashrc")
    with pytest.raises(InputError, match=r"tables.md' is a link"):
        command(folder)


def test_a_journal_is_not_appended_to_through_a_link(tmp_path: Path, mine: Path) -> None:
    (tmp_path / "journal.jsonl").symlink_to(mine / ".bashrc")
    with pytest.raises(InputError, match="cannot be written"):
        journal.Journal(tmp_path / "journal.jsonl")


def test_a_file_is_written_under_a_name_that_nobody_knew(
    tmp_path: Path, mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("secrets.token_hex", lambda n: "guessed")
    (tmp_path / ".page.guessed.part").symlink_to(mine / ".bashrc")
    with pytest.raises(InputError, match=r"page' cannot be written"):
        files.write_bytes(tmp_path / "page", b"theirs")
    monkeypatch.undo()
    (tmp_path / "page").symlink_to(mine / ".bashrc")
    files.write_bytes(tmp_path / "page", b"theirs")
    assert not (tmp_path / "page").is_symlink()


def test_a_picture_to_look_at_is_not_written_through_a_link(tmp_path: Path, mine: Path) -> None:
    picture = np.zeros((2, 3, 3), np.uint8)
    for place in (tmp_path / "peg.png", tmp_path / ".peg.png.part"):
        place.symlink_to(mine / ".bashrc")
    files.write_bytes(tmp_path / "peg.png", pictures.encoded(picture))
    assert np.array_equal(pictures.read(tmp_path / "peg.png"), picture)


def test_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "page")
    with pytest.raises(InputError, match="it is not a file"):
        files.write_bytes(tmp_path / "page", b"theirs")
    assert (tmp_path / "page").is_fifo()


@pytest.mark.parametrize("trial_id", ["../../home", "/etc", "..", "a/b", "", ".hidden", "a\nb"])
def test_a_trials_name_leads_nowhere_else(folder: Path, trial_id: str) -> None:
    rows = rows_of(ran()[0])
    rows.trial["trial_id"] = trial_id
    results.write_rows(folder, [rows])
    with pytest.raises(InputError, match="is no trial's name"):
        open_run(folder)
    rows.trial["inserted"] = None
    (folder / journal.FILE).write_bytes(journal.encoded(rows))
    with pytest.raises(InputError, match="is no trial's name"):
        _labelled(folder)


# --- what is packed small ------------------------------------------------------------------------


def png(width: int, height: int) -> bytes:
    """A header that says so, and next to nothing after it."""
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0" * 99)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def jpeg(width: int, height: int) -> bytes:
    frame = struct.pack(">BHHB", 8, height, width, 3) + b"\1\x22\0\2\x11\1\3\x11\1"
    return b"\xff\xd8\xff\xe0\0\4ab\xff\xff\xc2" + struct.pack(">H", len(frame) + 2) + frame


def webp(width: int, height: int) -> bytes:
    bits = (width - 1) | (height - 1) << 14
    body = b"WEBPVP8L" + struct.pack("<IBI", 5, 0x2F, bits) + b"\0"
    return b"RIFF" + struct.pack("<I", len(body)) + body


@pytest.mark.parametrize("header", [png, jpeg, webp])
def test_a_picture_is_refused_by_its_header(
    header: Callable[[int, int], bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert pictures.size_of(header(640, 480)) == (640, 480)
    monkeypatch.setattr("cv2.imdecode", None)
    with pytest.raises(ValueError, match="11000 x 3600 pixels, more than 8388608"):
        pictures.decoded(header(11000, 3600))


@settings(max_examples=50)
@given(st.sampled_from([png, jpeg, webp]), st.integers(0, 60), st.binary(max_size=4))
def test_a_header_that_is_broken_is_no_picture(
    header: Callable[[int, int], bytes], at: int, cut: bytes
) -> None:
    whole = header(640, 480)
    for data in (whole[:at], whole[:at] + cut + whole[at + len(cut) :]):
        try:
            picture = pictures.decoded(data)
        except ValueError:
            continue
        assert picture.shape[0] * picture.shape[1] <= pictures.MOST_PIXELS


def test_a_large_picture_costs_its_trials_page_and_no_memory(folder: Path) -> None:
    next((folder / TRIAL / "pictures").iterdir()).write_bytes(png(11000, 3600))
    (problem,) = look(folder)
    assert "has 11000 x 3600 pixels" in problem


def test_a_picture_that_is_named_often_is_decoded_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[Path] = []
    read = pictures.read

    def noted(path: Path) -> object:
        reads.append(path)
        return read(path)

    monkeypatch.setattr(pictures, "read", noted)
    store.load_trial(folder / TRIAL)
    assert len(reads) == len(set(reads))


def test_a_records_pictures_are_bounded_together(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "_MOST_PIXELS", 2 * 640 * 480)
    with pytest.raises(InputError, match="more than 614400 pixels together"):
        store.load_trial(folder / TRIAL)


def test_a_goals_picture_is_refused_by_its_header_and_lies_beside_its_file(tmp_path: Path) -> None:
    goals = tmp_path / "goals.yaml"
    teaching.save(goals, shipped())
    (tmp_path / "fit.png").write_bytes(png(11000, 3600))
    with pytest.raises(InputError, match="11000 x 3600"):
        teaching.load(goals)
    goals.write_text(
        goals.read_text(encoding="utf-8").replace("fit.png", "../fit.png"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="is in another folder"):
        teaching.load(goals)


def test_a_case_set_is_unpacked_in_memory_and_no_further_than_it_may_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = tmp_path / "cases.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("../outside.txt", "theirs")
        archive.writestr("cases.jsonl", b"\n" * (1 << 20))
    monkeypatch.setattr("pliant.experiment.bench.cases._MOST_TEXT", 1 << 19)
    with pytest.raises(InputError, match=r"cases.jsonl is larger than"):
        len(Cases(packed))
    assert [path.name for path in tmp_path.rglob("*")] == ["cases.zip"]


def test_a_case_sets_picture_is_refused_by_its_header(tmp_path: Path) -> None:
    packed = tmp_path / "cases.zip"
    with zipfile.ZipFile(SHIPPED) as there, zipfile.ZipFile(packed, "w") as archive:
        for member in there.infolist():
            is_picture = member.filename.endswith(".webp")
            data = webp(11000, 3600) if is_picture else there.read(member)
            archive.writestr(member.filename, data)
    with pytest.raises(InputError, match="has 11000 x 3600 pixels"):
        next(iter(Cases(packed)))


def test_a_trajectory_is_refused_by_what_it_says_it_holds(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder / TRIAL / replay.FILE
    np.savez_compressed(path, time_s=np.zeros(1 << 18), qpos=np.zeros((1 << 18, 1)))
    monkeypatch.setattr(replay, "_MOST_BYTES", 1 << 20)
    with pytest.raises(InputError, match="it holds more than 1 MB"):
        replay.load(folder / TRIAL)


def test_a_file_that_is_larger_than_memory_is_refused(folder: Path) -> None:
    os.truncate(folder / TRIAL / "trial.json", 1 << 40)
    (problem,) = look(folder)
    assert "larger than" in problem


def test_rows_are_unpacked_no_further_than_results_are_large(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results, "_MOST_BYTES", 1000)
    with pytest.raises(InputError, match=r"trials.parquet' is larger than results are"):
        results.read_trials(folder)


# --- what is broken ------------------------------------------------------------------------------


def test_a_page_of_parquet_is_held_to_its_checksum(original: Path, folder: Path) -> None:
    path = folder / results.TRIALS_FILE
    found = pq.ParquetFile(path).metadata.row_group(0).column(0)
    content = bytearray(path.read_bytes())
    content[found.data_page_offset + found.total_compressed_size // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"trials.parquet' is broken"):
        results.read_trials(folder)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
@given(st.data())
def test_changed_results_are_refused_or_read_the_same(folder: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from([results.TRIALS_FILE, results.EXECUTIONS_FILE]))
    path = folder / name
    content = path.read_bytes()
    at = data.draw(st.integers(0, len(content) - 1))
    changed = content[:at] + data.draw(st.binary(max_size=3)) + content[at + 1 :]
    path.write_bytes(changed)
    try:
        results.read_trials(folder).to_pylist()
        list(results.each_trials_executions(folder))
    except InputError as refused:
        assert_in_a_line(refused)
    finally:
        path.write_bytes(content)


@pytest.mark.parametrize(
    "change",
    [
        lambda run: run.update(versions=[1], commit=7),
        lambda run: run.update(configuration=None),
        lambda run: run["configuration"].update(cells=[{"task": 3}]),
        lambda run: run["configuration"].update(trials="many"),
        lambda run: run["configuration"]["cells"][0].update(condition=[]),
    ],
)
def test_a_broken_run_json_costs_the_experiments_page_and_no_trials(
    folder: Path, change: Callable[[dict[str, Any]], None]
) -> None:
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    change(run)
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    viewed = view(folder, [shipped()])
    assert len(viewed.problems) == 1
    assert str(folder) in viewed.problems[0]
    assert viewed.page == folder / TRIAL / "index.html"
    assert viewed.made == 1


@pytest.mark.parametrize(
    ("column", "value"),
    [("seed", None), ("trial_id", None), ("failure_kind", "luck"), ("drawn_friction", None)],
)
def test_rows_that_are_not_ours_are_refused_by_name(
    folder: Path, column: str, value: object
) -> None:
    rows = [rows_of(ran()[0])]
    rows[0].trial[column] = value
    results.write_rows(folder, rows)
    viewed = view(folder, [shipped()])
    if viewed.problems:
        assert str(folder) in viewed.problems[0]
    assert viewed.made == 1


def test_a_trial_that_is_there_twice_is_refused(folder: Path) -> None:
    results.write_rows(folder, [rows_of(ran()[0])] * 2)
    with pytest.raises(InputError, match="is in it twice"):
        results.read_trials(folder)


@pytest.mark.parametrize(
    "body",
    [
        b'{"trial_id":["x"],"inserted":true,"rows":{"trial":{},"executions":[]}',
        b'{"trial_id":"x","inserted":7,"rows":{"trial":{},"executions":[]}',
        b'{"trial_id":"x","inserted":true',
        b'{"trial_id":"x","inserted":true,"rows":3',
        b'{"trial_id":"x","inserted":true,"rows":{"trial":{"seed":[]},"executions":[]}',
        b'{"trial_id":"x","inserted":true,"rows":{"trial":{},"executions":[3]}',
        b"[" * 100_000 + b',"rows":',
        b"\xff\xfe",
    ],
)
def test_a_journal_line_that_is_not_ours_costs_the_experiments_page(
    folder: Path, body: bytes
) -> None:
    (folder / results.TRIALS_FILE).unlink()
    (folder / journal.FILE).write_bytes(b'%b,"crc":%d}\n' % (body, zlib.crc32(body)))
    viewed = view(folder, [shipped()])
    assert len(viewed.problems) == 1
    assert "\n" not in viewed.problems[0]
    assert viewed.made == 1


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner, max_size=2)
    ),
    max_leaves=3,
)


def _places(value: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield way
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, one in inner:
        yield from _places(one, (*way, key))


def _changed(document: Any, way: tuple[Any, ...], value: Any) -> Any:
    if not way:
        return value
    copy = dict(document) if isinstance(document, dict) else list(document)
    copy[way[0]] = _changed(copy[way[0]], way[1:], value)
    return copy


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=12)
@given(st.data())
def test_any_change_to_a_record_gives_a_page_or_one_line(
    folder: Path, mine: Path, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from([TRIAL / "trial.json", Path("run.json")]))
    path = folder / name
    before = path.read_bytes()
    document = json.loads(before)
    way = data.draw(st.sampled_from(sorted(_places(document), key=str)))
    path.write_text(json.dumps(_changed(document, way, data.draw(_JSON))), encoding="utf-8")
    try:
        assert all("\n" not in problem for problem in look(folder))
    except InputError as refused:
        assert_in_a_line(refused)
    finally:
        path.write_bytes(before)


def test_an_unknown_error_is_the_datas_and_says_whose() -> None:
    with (
        pytest.raises(InputError, match=r"^'here' holds what pliant did not write \(KeyError: .*$"),
        folders.contained("'here'"),
    ):
        raise KeyError("a\nb")


def test_a_new_runs_folder_may_hold_no_link(folder: Path, mine: Path) -> None:
    (folder / "trials" / "mine").symlink_to(mine)
    with pytest.raises(InputError, match="is a link"):
        store.prepare_folder(folder)
