"""What every export keeps to, and the questions about failures."""

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stored_run import FAILED, HELD_OUT, RECOVERED, store

from pliant.conditions import NOMINAL
from pliant.errors import InputError
from pliant.export import failure_qa, lerobot, recording
from pliant.export.source import TEST, TRAIN, Source, open_run, splits
from pliant.records import Trial

PLIANT = Path(sys.executable).parent / "pliant"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs") / "run"


@pytest.fixture(scope="module")
def trials(folder: Path) -> dict[str, Trial]:
    return store(folder)


@pytest.fixture(scope="module")
def source(folder: Path, trials: dict[str, Trial]) -> Source:
    assert trials
    return open_run(folder)


@pytest.fixture(scope="module")
def asked(source: Source, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exports") / "questions"
    failure_qa.write(source, out)
    return out


def lines(asked: Path, split: str) -> list[dict[str, Any]]:
    return [
        json.loads(line)
        for line in (asked / f"{split}.jsonl").read_text(encoding="utf-8").splitlines()
    ]


def everything(asked: Path) -> list[dict[str, Any]]:
    return lines(asked, TRAIN) + lines(asked, TEST)


# --- every export ------------------------------------------------------------------------------


def test_an_export_overwrites_nothing(source: Source, tmp_path: Path) -> None:
    kept = tmp_path / "out" / "mine.txt"
    kept.parent.mkdir()
    kept.write_text("mine", encoding="utf-8")
    for write in (failure_qa.write, lerobot.write):
        with pytest.raises(InputError, match="nothing is overwritten"):
            write(source, tmp_path / "out")
    assert [p.name for p in tmp_path.rglob("*")] == ["out", "mine.txt"]


def test_a_run_that_kept_no_trial_is_refused_with_the_command_that_keeps_them(
    folder: Path, source: Source, tmp_path: Path
) -> None:
    assert source.trials == 3
    shutil.copytree(folder, tmp_path / "run", ignore=shutil.ignore_patterns("trials"))
    with pytest.raises(InputError, match="--save all") as refused:
        open_run(tmp_path / "run")
    assert "\n" not in str(refused.value)


def test_an_unknown_trial_is_refused_and_a_known_one_is_taken_alone(
    folder: Path, source: Source
) -> None:
    assert len(source.saved) == 3
    with pytest.raises(InputError, match="no record of a trial 'x'"):
        open_run(folder, "x")
    with pytest.raises(InputError, match="'x'"):
        open_run(folder, FAILED, "x")
    assert open_run(folder, FAILED).one().trial_id == FAILED
    with pytest.raises(InputError, match=f"--trial {RECOVERED}"):
        source.one()


def test_an_export_that_fails_leaves_nothing(folder: Path, source: Source, tmp_path: Path) -> None:
    assert source.saved
    broken = tmp_path / "run"
    shutil.copytree(folder, broken)
    (broken / "trials" / HELD_OUT / "trial.json").write_text("{}", encoding="utf-8")
    (tmp_path / "exports").mkdir()
    with pytest.raises(InputError, match="schema None"):
        failure_qa.write(open_run(broken), tmp_path / "exports" / "questions")
    assert list((tmp_path / "exports").iterdir()) == []


@given(
    st.lists(
        st.tuples(st.integers(0, 40), st.sampled_from(["none", "friction", "all"])), min_size=1
    )
)
def test_no_drawn_setup_is_in_both_splits_and_every_fifth_seed_is_held_out(
    drawn: list[tuple[int, str]],
) -> None:
    rows = [
        {"seed": seed}
        | {
            f"drawn_{name}": nominal + (seed if condition in (name, "all") else 0)
            for name, nominal in NOMINAL.items()
        }
        for seed, condition in drawn
    ]
    setups: dict[str, set[tuple[float, ...]]] = {TRAIN: set(), TEST: set()}
    for row, split in zip(rows, splits(rows), strict=True):
        setups[split].add(tuple(row[f"drawn_{name}"] for name in NOMINAL))
        if row["drawn_friction"] != NOMINAL["friction"]:
            assert (split == TEST) == (row["seed"] % 5 == 0)
    assert not setups[TRAIN] & setups[TEST]


def test_a_card_says_where_the_data_come_from(asked: Path, source: Source) -> None:
    card = (asked / "README.md").read_text(encoding="utf-8")
    assert card.startswith("---\nlicense: apache-2.0\n")
    assert str(source.run["commit"]) in card
    assert str(source.run["configuration"]["fingerprint"]) in card
    for split in (TRAIN, TEST):
        (row,) = [line for line in card.splitlines() if line.startswith(f"| {split} |")]
        assert row.endswith(f"| {len(lines(asked, split))} |")


def test_without_the_extra_a_recording_is_refused_in_one_line(
    source: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"pip install (-e )?'.\[rerun\]'"):
        recording.write(source, tmp_path / "trial.rrd", fps=10)
    with pytest.raises(InputError, match=r"not named \.rrd"):
        recording.write(source, tmp_path / "trial", fps=10)
    assert list(tmp_path.iterdir()) == []


def test_the_command_exports_and_refuses_in_one_line(
    folder: Path, source: Source, tmp_path: Path
) -> None:
    assert source.saved

    def export(*words: str | Path) -> "subprocess.CompletedProcess[str]":
        command = [str(PLIANT), "export", str(folder), *map(str, words)]
        return subprocess.run(
            command, capture_output=True, encoding="utf-8", check=False, timeout=120
        )

    done = export("--failure-qa", tmp_path / "qa", "--trial", RECOVERED)
    assert done.returncode == 0, done.stderr
    asked = (tmp_path / "qa" / "train.jsonl").read_text(encoding="utf-8").count("\n")
    assert f"{asked} train, 0 test questions" in done.stdout
    refused = export()
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "--lerobot, --failure-qa, --chat or --rerun" in refused.stderr


# --- questions about failures ------------------------------------------------------------------


def test_answers_agree_with_the_truth_of_the_run(asked: Path, folder: Path) -> None:
    truths = {
        (row["trial_id"], row["index"]): row
        for row in pq.read_table(folder / "executions.parquet").to_pylist()
    }
    found = everything(asked)
    for line in found:
        row, truth = truths[line["trial_id"], line["execution"]], line["truth"]
        if line["type"] == "locate":
            offset = 1e3 * (row["truth_tip_y_m"] - row["truth_hole_y_m"])
            assert truth["offset_y_mm"] == pytest.approx(offset, abs=0.01)
            assert truth["depth_mm"] == pytest.approx(1e3 * row["truth_depth_m"], abs=0.01)
            assert truth["tilt_deg"] == pytest.approx(math.degrees(row["truth_tilt_rad"]), abs=0.01)
            assert truth["side"] == ("centre" if abs(offset) < 0.5 else "right")  # none overshot
        if line["type"] == "detect" and row["formation"] == "insertion":
            assert line["answer"] == ("yes" if row["truth_inserted"] else "no")
        if line["type"] == "identify" and not row["truth_fit"]:
            assert line["answer"] == "missed_edge"
    kinds = {line["type"] for line in found}
    assert kinds == {"detect", "identify", "locate", "explain", "correct"}


def test_failures_are_asked_about_in_full_and_successes_only_seen_and_placed(asked: Path) -> None:
    by_execution: dict[tuple[str, int], dict[str, dict[str, Any]]] = {}
    for line in everything(asked):
        by_execution.setdefault((line["trial_id"], line["execution"]), {})[line["type"]] = line
    answers = set()
    for questions in by_execution.values():
        failed = questions["detect"]["answer"] == "no"
        answers.add(failed)
        assert len(questions) == (5 if failed else 2)
    assert answers == {True, False}


def test_a_fit_that_ended_short_of_the_hole_is_corrected_toward_it(asked: Path) -> None:
    short = [line for line in everything(asked) if line["type"] == "correct"]
    fits = [line for line in short if line["context"]["formation"] == "fit"]
    assert fits
    for line in fits:
        assert line["truth"]["formation"] == "fit"
        assert line["truth"]["direction"] == "left"
        goal = line["context"]["goals"]["fit"]["y_mm"] - line["truth"]["size_mm"]
        assert line["truth"]["plan"][0]["goal"]["y_mm"] == pytest.approx(goal, abs=0.02)


def test_a_question_shows_what_the_reasoner_saw_and_nothing_else(
    asked: Path, folder: Path, trials: dict[str, Trial]
) -> None:
    for line in everything(asked):
        stored = folder / "trials" / line["trial_id"] / line["picture"]
        assert (asked / line["picture"]).read_bytes() == stored.read_bytes()
        execution = trials[line["trial_id"]].executions[line["execution"]]
        context = line["context"]
        assert context["pose"]["y_mm"] == pytest.approx(execution.outcome.pose.y * 1e3, abs=1e-3)
        assert len(context["earlier"]) == line["execution"]
        assert set(context["checks"]) <= {"table_i", "pose", "compression", "goal_picture"}
        shown = json.dumps(context)
        assert not any(word in shown for word in ("truth", "drawn", "inserted", "hole_y"))


def test_train_and_test_share_neither_seeds_nor_pictures(asked: Path) -> None:
    train, test = lines(asked, TRAIN), lines(asked, TEST)
    assert {line["seed"] for line in train} == {6}
    assert {line["seed"] for line in test} == {5}
    assert not {line["picture"] for line in train} & {line["picture"] for line in test}
    shown = {line["picture"] for line in train + test}
    assert {f"pictures/{p.name}" for p in (asked / "pictures").iterdir()} == shown


def test_the_documents_snippet_reads_the_corrections(asked: Path, tmp_path: Path) -> None:
    text = (Path(__file__).parent.parent / "docs/datasets.md").read_text(encoding="utf-8")
    blocks = [block.split("```")[0] for block in text.split("```python\n")[1:]]
    (code,) = (block for block in blocks if "exports/failure-qa" in block)
    (tmp_path / "exports").mkdir()
    (tmp_path / "exports/failure-qa").symlink_to(asked)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    corrected = [line for line in lines(asked, TRAIN) if line["type"] == "correct"]
    assert len(done.stdout.splitlines()) == len(corrected) > 0
