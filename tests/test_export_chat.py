"""Conversations to tune a model on: the very words of the prompts, pictures, right replies."""

import json
from pathlib import Path
from typing import Any

import pytest
from stored_run import store

from pliant import pictures
from pliant.cli.export import export
from pliant.envelope import Limits
from pliant.export import chat
from pliant.export.labels import case_of, labels
from pliant.export.source import TEST, TRAIN, open_run
from pliant.formations import RECOVERABLE
from pliant.reasoners.vlm import plans, prompt
from pliant.reasoners.vlm.reasoner import unasked
from pliant.reasoners.vlm.replies import Analysis, Judgement, bounded_plan
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Recovery, Trial
from pliant.recovery import admit


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Trial]]:
    folder = tmp_path_factory.mktemp("runs") / "run"
    return folder, store(folder)


@pytest.fixture(scope="module")
def out(run: tuple[Path, dict[str, Trial]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exports") / "chat"
    assert export(run[0], chat_out=out) == 0
    return out


def told(out: Path) -> list[dict[str, Any]]:
    files = [out / f"{split}.jsonl" for split in (TRAIN, TEST)]
    texts = [f.read_text(encoding="utf-8") for f in files if f.is_file()]
    return [json.loads(line) for text in texts for line in text.splitlines()]


def reply(line: dict[str, Any]) -> str:
    (part,) = line["messages"][2]["content"]
    return str(part["text"])


def test_every_decision_of_a_model_is_there_and_no_other(
    run: tuple[Path, dict[str, Trial]], out: Path
) -> None:
    found = {(d["trial_id"], d["execution"], d["stage"]) for d in told(out)}
    wanted = set()
    for trial in run[1].values():
        for label in labels(trial):
            if label.execution.formation not in RECOVERABLE:
                continue
            where = (trial.trial_id, label.execution.index)
            if unasked(case_of(trial, label)) is None:
                wanted.add((*where, "judge"))
            if not label.success:
                wanted |= {(*where, "analyse"), (*where, "plan")}
    assert found == wanted
    assert {stage for *_, stage in found} == {"judge", "analyse", "plan"}


def test_a_request_is_what_the_reasoner_would_send(
    run: tuple[Path, dict[str, Trial]], out: Path
) -> None:
    settings = Settings()
    for line in told(out):
        if line["stage"] != "judge":
            continue
        trial = run[1][line["trial_id"]]
        label = labels(trial)[line["execution"]]
        case = case_of(trial, label)
        system, user, _ = line["messages"]
        assert system["content"][0]["text"] == prompt.instructions(settings, case, Limits())
        sent = prompt.situation(
            case,
            settings,
            asked=prompt.ASKED["judge"],
            goal_picture=line["formation"] == "insertion",
        )
        texts = [part["text"] for part in user["content"] if part["type"] == "text"]
        assert texts == [item for item in sent if isinstance(item, str)]
        places = [part for part in user["content"] if part["type"] == "image"]
        assert len(places) == len(line["images"]) == (2 if line["formation"] == "insertion" else 1)
        last = pictures.decoded((out / line["images"][-1]).read_bytes())
        assert (last == case.outcome.looks[-1].observation.views["side"].image).all()


def test_replies_have_the_structure_that_is_asked_for_and_say_what_is_true(
    run: tuple[Path, dict[str, Trial]], out: Path
) -> None:
    for line in told(out):
        trial = run[1][line["trial_id"]]
        label = labels(trial)[line["execution"]]
        case = case_of(trial, label)
        assert line["kind"] == (label.kind or "success")
        if line["stage"] == "judge":
            said = Judgement.model_validate_json(reply(line))
            assert said.success is label.success
            assert said.picture == ("success" if label.success else "failure")
        elif line["stage"] == "analyse":
            analysis = plans.analysis_of(Analysis.model_validate_json(reply(line)))
            assert "corner" in analysis.what
        else:
            plan = bounded_plan(40, case.method).model_validate_json(reply(line))
            steps = plans.steps_of(plan, case)
            assert steps
            assert plans.in_metres(steps, case) is None
            recovery = Recovery(analysis=analysis, steps=steps, by="vlm")
            assert admit(recovery, case, Limits()).steps == steps
            assert plans.refusal(recovery, case, Limits(), 0.040) is None


def test_the_card_counts_every_conversation(out: Path) -> None:
    card = (out / "README.md").read_text(encoding="utf-8")
    assert "license: apache-2.0" in card
    rows = [r.split("|") for r in card.splitlines() if r.startswith(("| planar |", "| guided |"))]
    assert sum(int(n) for row in rows for n in row[4:-1]) == len(told(out))


def test_a_run_of_the_guided_skills_is_told_with_both_pictures(tmp_path: Path) -> None:
    from pliant.cli.run import run as run_command

    assert run_command(peg="square", level="L1", seed=9017, video=False, out=tmp_path / "r") == 0
    export(tmp_path / "r", chat_out=tmp_path / "chat")
    lines = told(tmp_path / "chat")
    assert {line["method"] for line in lines} == {"guided"}
    assert all(len(line["images"]) >= 2 for line in lines)
    assert open_run(tmp_path / "r").trials == 1
    assert chat.STAGES[0] in {line["stage"] for line in lines}


@pytest.mark.system
def test_the_datasets_library_reads_it_with_its_pictures(out: Path, tmp_path: Path) -> None:
    from datasets import Image, Sequence, load_dataset

    data = load_dataset(str(out), cache_dir=str(tmp_path))
    assert {split: len(rows) for split, rows in data.items()} == {
        split: len((out / f"{split}.jsonl").read_text(encoding="utf-8").splitlines())
        for split in data
    }
    train = data["train"].map(lambda row: {"images": [str(out / name) for name in row["images"]]})
    row = train.cast_column("images", Sequence(Image()))[0]
    roles = [message["role"] for message in row["messages"]]
    places = [p for m in row["messages"] for p in m["content"] if p["type"] == "image"]
    assert roles == ["system", "user", "assistant"]
    assert [picture.size for picture in row["images"]] == [(640, 480)] * len(places)
