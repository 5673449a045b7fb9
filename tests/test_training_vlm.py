"""What pliant's own model is trained on: decisions, told as in a trial, answered by the truth."""

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from pliant.experiment.success import KINDS
from pliant.levels import shipped_levels
from pliant.reasoners.vlm.replies import AbsolutePlan, BoundedPlan, Judgement

TRAINING = Path(__file__).parents[1] / "training" / "vlm"
SEED = 190_011  # a trial that wavers, of fourteen executions

if str(TRAINING) not in sys.path:
    sys.path.append(str(TRAINING))


@pytest.fixture(scope="module")
def trial() -> dict[str, Any]:
    record = importlib.import_module("record")
    found: dict[str, Any] = record.record(record.Job(seed=SEED, guided=False))
    return found


def test_every_failure_is_judged_analysed_and_planned(trial: dict[str, Any]) -> None:
    decisions = trial["decisions"]
    failed = [d for d in decisions if not d["success"]]
    assert {d["stage"] for d in failed} == {"judge", "analyse", "plan"}
    assert {d["kind"] for d in failed} <= set(KINDS)
    assert {d["stage"] for d in decisions if d["success"]} <= {"judge"}


def test_replies_have_the_forms_that_a_trial_asks_for(trial: dict[str, Any]) -> None:
    for decision in trial["decisions"]:
        for text in (decision["reply"], decision["plain"]):
            if decision["stage"] == "judge":
                said = Judgement.model_validate_json(text)
                assert said.success is decision["success"]
            elif decision["stage"] == "plan":
                form = AbsolutePlan if "steps" in json.loads(text) else BoundedPlan
                fields = json.loads(text)
                form.model_validate({k: fields[k] for k in fields if k in form.model_fields})


def test_a_request_names_neither_level_nor_scenario_nor_kind(trial: dict[str, Any]) -> None:
    names = {n for n, v in shipped_levels().items() if v.is_scenario} | {
        k for k in KINDS if "_" in k
    }
    for decision in trial["decisions"]:
        told = decision["system"] + "".join(decision["user"])
        assert not [name for name in names if name in told]


def test_each_place_of_a_picture_has_its_look(trial: dict[str, Any]) -> None:
    for decision in trial["decisions"]:
        assert decision["user"].count("<image>") == len(decision["pictures"])
        for sort, *of in decision["pictures"]:
            assert sort in {"look", "goal", "black"}
            if sort == "look":
                assert 0 <= of[0] <= decision["execution"]
                assert of[1] in trial["looks"][of[0]]["taken_s"]


def test_sources_are_sometimes_left_out_or_wrong(trial: dict[str, Any]) -> None:
    judged = [d for d in trial["decisions"] if d["stage"] == "judge"]
    said = [json.loads(d["plain"]) for d in judged]
    assert {"not available"} < {s["table_i"] for s in said}
    assert any(s["conflict"] for s in said)
    assert {d["shown"] for d in judged} > {"look"}


def test_the_held_out_question_is_marked(trial: dict[str, Any]) -> None:
    asked = importlib.import_module("wording").ASKED
    for decision in trial["decisions"]:
        last = f"Asked: {asked[decision['stage']][-1]}"
        assert ("phrase" in decision["held"]) == (decision["user"][-1] == last)


def test_the_same_seed_records_the_same_decisions(trial: dict[str, Any]) -> None:
    record = importlib.import_module("record")
    again = record.record(record.Job(seed=SEED, guided=False))
    assert again["decisions"] == trial["decisions"]


def test_how_the_peg_lies_is_said_only_where_it_is_shown_or_told(trial: dict[str, Any]) -> None:
    known = set()
    for decision in trial["decisions"]:
        if decision["stage"] != "judge":
            continue
        reason = json.loads(decision["plain"])["reason"]
        is_told = "Tip: " in "\n".join(decision["user"])
        assert reason.startswith("The centre of the peg's bottom face is ") == (
            decision["shown"] == "look" or is_told
        )
        known.add(decision["shown"])
    assert known > {"look"}
