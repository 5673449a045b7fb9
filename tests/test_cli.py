"""The command line: what it prints, what it writes, how it refuses, its exit status."""

import json
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pliant.experiment.columns import TRIALS

PLIANT = Path(sys.executable).parent / "pliant"
EXAMPLES = Path(__file__).parent.parent / "examples"
CELL = str(files("pliant") / "ur5e" / "example.yaml")


def pliant(*words: str | Path, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    command = [str(PLIANT), *map(str, words)]
    return subprocess.run(
        command, capture_output=True, encoding="utf-8", check=False, timeout=120, cwd=cwd
    )


def test_a_run_tells_its_story_and_leaves_a_whole_result_folder(tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = pliant("run", "--seed", "1", "--no-video", "--out", out)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    for word in ("approach", "contact", "fit", "align", "insertion", "what", "why", "how"):
        assert any(word in line.split() for line in lines), word
    assert any(line.startswith("inserted (ground truth") for line in lines)
    for name in ("run.json", "journal.jsonl", "trials.parquet", "executions.parquet"):
        assert (out / name).is_file()
    (trial,) = (out / "trials").iterdir()
    assert (trial / "index.html").is_file()
    assert (trial / "strip.png").is_file()
    assert not (trial / "video.mp4").exists()
    (trial / "video.mp4").write_bytes(b"a video")
    again = pliant("run", "--seed", "1", "--no-video", "--out", out)
    assert again.returncode == 0
    assert len((out / "journal.jsonl").read_text(encoding="utf-8").splitlines()) == 1
    assert "made again" not in done.stdout
    told = f"made again: replaces the page in '{trial}' and removes its video (--no-video)"
    assert told in again.stdout.splitlines()
    assert not (trial / "video.mp4").exists()


def test_json_is_one_line_with_the_columns_of_the_trials_table(tmp_path: Path) -> None:
    done = pliant("run", "--condition", "none", "--json", "--no-video", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    assert set(json.loads(line)) == {column.name for column in TRIALS}


def test_a_peg_that_is_not_inserted_exits_with_one(tmp_path: Path) -> None:
    done = pliant("run", "--seed", "1", "--reasoner", "none", "--no-video", "--out", tmp_path / "r")
    assert done.returncode == 1, done.stderr
    assert "not inserted" in done.stdout


def test_a_peg_that_went_in_though_something_is_not_as_told_says_so_at_the_end(
    tmp_path: Path,
) -> None:
    done = pliant("run", "--level", "blind", "--no-video", "--out", tmp_path / "r")
    assert done.returncode == 0
    assert "not as the task says: the cameras show nothing near the board (" in done.stdout
    assert "pictures show neither peg nor board" in done.stdout


def test_ranges_given_at_the_command_line_are_drawn_from(tmp_path: Path) -> None:
    words = ("--condition", "none", "--hole-y-mm", "5", "6", "--json", "--no-video")
    done = pliant("run", *words, "--out", tmp_path / "run")
    row = json.loads(done.stdout)
    assert 0.005 <= row["drawn_hole_y"] <= 0.006
    assert row["drawn_friction"] == 1.0


def test_a_peg_and_a_reasoner_of_ones_own_run(tmp_path: Path) -> None:
    peg = ("--peg", EXAMPLES / "04_your_own_peg.yaml")
    mind = ("--reasoner", f"{EXAMPLES / '03_your_own_reasoner.py'}:Bold")
    done = pliant("run", *peg, *mind, "--condition", "none", "--no-video", "--out", tmp_path / "r")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--peg", "pentagon"), "valid are circle, d_shape, hexagon"),
        (("--condition", "wind"), "valid are none, friction, pose, all"),
        (("--reasoner", "gpt"), "valid are rules, messages, sweep, retry, none"),
        (("--level", "L99"), "valid are L0"),
        (("--seed", "-1"), "-1"),
        (("--goals", "missing.yaml"), "cannot be read"),
        (("--hole-y-mm", "5", "-5"), "must lie in order"),
        (("--grasp-roll-deg", "-90", "5"), "within -15 deg to 15 deg"),
        (("--reasoner", "missing.py:Mine"), "does not exist"),
        (("--live",), "needs a screen"),
        (("--cell", "missing.yaml"), "cell file 'missing.yaml' cannot be read"),
        (("--cell", CELL), "condition 'all' on level L0 draws friction, which nobody can set"),
        (("--cell", CELL, "--condition", "pose"), "a person who places things"),
        (("--cell", CELL, "--condition", "pose", "--live"), "--live shows the simulated cell"),
    ],
)
def test_bad_input_is_one_line_and_exit_status_two(
    words: tuple[str, ...], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    out = tmp_path / "run"
    done = pliant("run", *words, "--out", out)
    assert done.returncode == 2, done.stdout
    assert says in done.stderr
    assert done.stderr.startswith("pliant: ")
    assert len(done.stderr.splitlines()) == 1
    assert not out.exists()


def test_an_experiment_in_a_real_cell_has_one_worker_and_a_person(tmp_path: Path) -> None:
    words = ("experiment", "--conditions", "pose", "--cell", CELL, "--out", tmp_path / "run")
    for more, says in ((("--workers", "2"), "are for the simulated cell"), ((), "a person who")):
        done = pliant(*words, *more)
        assert done.returncode == 2, done.stdout
        assert says in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_an_output_folder_that_holds_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("important", encoding="utf-8")
    done = pliant("run", "--no-video", "--out", tmp_path)
    assert done.returncode == 2
    assert "holds something else" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_back_end_that_cannot_draw_is_one_line_that_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")  # without a screen it cannot draw
    monkeypatch.delenv("DISPLAY", raising=False)
    done = pliant("run", "--no-video", "--out", tmp_path / "run")
    assert done.returncode == 2, done.stderr
    assert "unset it to let pliant choose" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_an_experiment_ends_with_its_tables_and_resumes(tmp_path: Path) -> None:
    cell = ("--pegs", "circle", "--conditions", "all", "--reasoners", "none")
    words = ("experiment", *cell, "--trials", "2", "--workers", "1", "--out", tmp_path / "run")
    first = pliant(*words)
    assert first.returncode == 0, first.stderr
    assert "Table II" in first.stdout
    assert pq.read_table(tmp_path / "run" / "trials.parquet").num_rows == 2
    again = pliant(*words)
    assert again.returncode == 0, again.stderr
    tables = pliant("tables", tmp_path / "run")
    assert "Table II" in tables.stdout
    assert set(json.loads(pliant("tables", tmp_path / "run", "--json").stdout)) > {"cells"}
    assert pliant("tables", tmp_path).returncode == 2
    held = {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir()}
    single = pliant("run", "--reasoner", "none", "--no-video", "--out", tmp_path / "run")
    assert single.returncode == 2
    (said,) = single.stderr.splitlines()
    assert "holds an experiment of 2 trials, whose tables a single trial would replace" in said
    assert {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir()} == held


def test_an_interrupted_experiment_says_so_on_stderr_and_exits_with_130(tmp_path: Path) -> None:
    cell = ("--conditions", "none", "--reasoners", "none", "--trials", "500", "--workers", "1")
    process = subprocess.Popen(
        [PLIANT, "experiment", *cell, "--out", tmp_path / "run"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    journal = tmp_path / "run" / "journal.jsonl"
    until = time.monotonic() + 90
    while not (journal.exists() and journal.stat().st_size) and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    printed, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert printed == ""
    assert "interrupted: what is finished is kept; the same command goes on" in said
    assert "of 500 trials are done; the same command goes on" in said


def test_a_broken_recording_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    talk, out = tmp_path / "talk.jsonl", tmp_path / "out"
    talk.write_text("not a recording\n", encoding="utf-8")
    refused = pliant("run", "--reasoner", "vlm", "--replay", str(talk), "--out", str(out))
    assert refused.returncode == 2
    assert "line 1, is broken" in refused.stderr
    assert not out.exists()


def test_running_again_after_a_change_keeps_what_was_run_before(tmp_path: Path) -> None:
    """Editing one's own reasoner and running it again is the most natural thing to do."""
    mine = tmp_path / "mine.py"
    for text, folder in (("first", ""), ("second", f"{tmp_path}/")):
        mine.write_text(
            "from pliant.reasoners.controls import OpenLoop\n"
            f'class Mine(OpenLoop):\n    """{text}"""\n',
            encoding="utf-8",
        )
        ran = pliant("run", "--reasoner", f"{folder}mine.py:Mine", "--no-video", cwd=tmp_path)
        assert ran.returncode in (0, 1), ran.stderr
    folders = sorted(p.name for p in (tmp_path / "runs").iterdir())
    assert folders == ["L0-circle-all-mine.py_Mine-1", "L0-circle-all-mine.py_Mine-1.2"]
    last = tmp_path / "runs" / folders[-1]
    for kept in ("trials.parquet", "executions.parquet"):
        assert str(tmp_path) not in str(pq.read_table(last / kept).to_pylist()), kept
    texts = [p for p in last.rglob("*") if p.suffix in (".json", ".jsonl", ".html")]
    assert len(texts) == 4
    for path in texts:
        assert str(tmp_path) not in path.read_text(encoding="utf-8"), path


def test_a_reader_that_has_seen_enough_gets_no_traceback(tmp_path: Path) -> None:
    command = f"{PLIANT} run --help | head -1"
    ran = subprocess.run(["bash", "-c", command], capture_output=True, encoding="utf-8")
    assert "Traceback" not in ran.stderr


def test_starting_the_command_line_loads_no_optional_library() -> None:
    script = (
        "import sys, pliant.cli\n"
        "optional = {'pydantic_ai', 'gymnasium', 'ray', 'rerun', 'rtde_control', 'mujoco'}\n"
        "print(*optional & set(sys.modules))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True
    )
    assert ran.stdout.split() == []


def test_the_version_is_said_and_the_package_can_be_run_as_a_module() -> None:
    said = subprocess.run(
        [sys.executable, "-m", "pliant", "--version"],
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    assert said.stdout == f"pliant {version('pliant')}\n"
    assert pliant("--version").stdout == said.stdout
