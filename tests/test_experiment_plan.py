"""Experiments are built from names and files, and know what decides their outcomes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pliant
from pliant.errors import InputError
from pliant.experiment import runner
from pliant.experiment.cells import Experiment, differences
from pliant.experiment.plan import from_fields, load

NAMES: dict[str, Any] = {
    "pegs": ["circle", "square"],
    "conditions": ["none", "all"],
    "reasoners": ["rules"],
    "trials": 2,
}
TABLE_II = """
trials: 30
cells:
- {peg: circle, condition: [none, friction, pose, all], reasoner: none}
- {peg: [circle, square, rectangle], condition: [none, friction, pose, all], reasoner: rules}
"""


def file_of(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "experiment.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def names(experiment: Experiment) -> list[str]:
    return ["-".join(cell.names) for cell in experiment.cells]


def test_names_make_their_cross_product_in_order() -> None:
    experiment = from_fields(NAMES)
    assert names(experiment) == [
        "L0-circle-none-rules",
        "L0-circle-all-rules",
        "L0-square-none-rules",
        "L0-square-all-rules",
    ]
    assert len(experiment) == 8
    assert [s.trial_id for s in experiment.specs()][:3] == [
        "L0-circle-none-rules-1",
        "L0-circle-none-rules-2",
        "L0-circle-all-rules-1",
    ]


def test_a_file_lists_cells_so_that_the_baseline_is_the_circles_alone(tmp_path: Path) -> None:
    experiment = load(file_of(tmp_path, TABLE_II))
    assert len(experiment.cells) == 16
    assert len(experiment) == 480
    assert sum(c.reasoner == "none" for c in experiment.cells) == 4


def test_what_is_given_at_the_command_line_replaces_the_files_fields(tmp_path: Path) -> None:
    path = file_of(tmp_path, TABLE_II)
    overrides = {"trials": 3, "first_seed": 7, "conditions": ["all"], "pegs": None}
    experiment = load(path, overrides)
    assert names(experiment) == [
        "L0-circle-all-none",
        "L0-circle-all-rules",
        "L0-square-all-rules",
        "L0-rectangle-all-rules",
    ]
    assert (experiment.trials, experiment.first_seed) == (3, 7)


def test_a_condition_may_set_its_own_ranges_in_millimetres_and_degrees() -> None:
    windy = {"name": "windy", "hole_y_mm": [-10, 10], "grasp_roll_deg": [0, 90 / 45]}
    (cell,) = from_fields({**NAMES, "pegs": "circle", "conditions": [windy]}).cells
    assert cell.condition.ranges["hole_y"] == (-0.01, 0.01)
    assert cell.condition.ranges["grasp_roll"] == pytest.approx((0, 0.0349066), abs=1e-7)


def test_a_cell_that_occurs_twice_counts_once() -> None:
    cells = [{"peg": "circle", "condition": "none", "reasoner": "rules"}]
    assert len(from_fields({**NAMES, "cells": cells}).cells) == 4


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"pegs": ["circle"], "trails": 3}, "unknown field 'trails'"),
        ({**NAMES, "pegs": ["pentagon"]}, "unknown peg 'pentagon'"),
        ({**NAMES, "conditions": ["wind"]}, "unknown condition 'wind'"),
        ({**NAMES, "reasoners": ["luck"]}, "unknown reasoner 'luck'"),
        ({**NAMES, "level": "L99"}, "unknown level 'L99'"),
        ({**NAMES, "trials": 0}, "trials is 0"),
        ({**NAMES, "trials": True}, "trials is True"),
        ({**NAMES, "first_seed": -1}, "first_seed is -1"),
        ({**NAMES, "pegs": [3]}, "peg is 3"),
        ({**NAMES, "pegs": []}, "lacks its peg"),
        ({"pegs": ["circle"]}, "lacks its condition"),
        ({}, "lacks its condition"),
        ({**NAMES, "goals": 3}, "goals is 3"),
        ({**NAMES, "cells": "circle"}, "cells must be a list"),
        ({**NAMES, "cells": [{"pegs": "circle"}]}, "unknown field of a cell 'pegs'"),
        ({**NAMES, "conditions": [{"hole_y_mm": [0, 1]}]}, "condition's name is None"),
        ({**NAMES, "conditions": [{"name": "all"}]}, "is the paper's"),
        ({**NAMES, "conditions": [{"name": "w", "wind": [0, 1]}]}, "unknown quantity 'wind'"),
        ({**NAMES, "conditions": [{"name": "w", "friction": 2}]}, "must be [low, high]"),
        ({**NAMES, "conditions": [{"name": "w", "friction": [3, 2]}]}, "cannot be"),
        (
            {**NAMES, "conditions": [{"name": "w"}, {"name": "w", "friction": [1, 2]}]},
            "two different cells are both named",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refused:
        from_fields(fields)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"seed": -1}, "seed is -1: it must be a whole number from 0 to"),
        ({"seed": "x"}, "seed is 'x': it must be a whole number"),
        ({"seed": True}, "seed is True"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"peg": 3}, "peg is 3: it must be a name"),
        ({"level": None}, "level is None: it must be a name"),
        ({"reasoner": ["rules"]}, "reasoner is ['rules']: it must be a name"),
        ({"method": 3}, "method is 3: it must be a name"),
    ],
)
def test_a_trial_from_python_refuses_what_it_cannot_use_in_one_line(
    given: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as refused:
        pliant.run(**given)
    assert str(refused.value).startswith(message)


def test_a_comparison_from_python_refuses_what_is_no_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="peg is 3: it must be a name"):
        pliant.compare(pegs=3, out=tmp_path / "out")  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["- a list", "a: [1", "", "!!python/object/apply:os.getcwd []"])
def test_a_file_that_is_no_experiment_is_refused_and_runs_nothing(
    tmp_path: Path, text: str
) -> None:
    with pytest.raises(InputError, match=r"experiment\.yaml"):
        load(file_of(tmp_path, text))
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path / "absent.yaml")


def test_the_fingerprint_changes_with_all_that_decides_outcomes(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text("from pliant.reasoners.rules import Rules as Mine\n", encoding="utf-8")
    fields = {**NAMES, "pegs": ["circle"], "reasoners": [f"{mine}:Mine"]}
    before = from_fields(fields)
    assert before.fingerprint == from_fields(fields).fingerprint
    for change in ({"trials": 3}, {"first_seed": 2}, {"conditions": ["all"]}):
        assert from_fields({**fields, **change}).fingerprint != before.fingerprint
    mine.write_text("from pliant.reasoners.controls import Retry as Mine\n", encoding="utf-8")
    after = from_fields(fields)
    assert after.fingerprint != before.fingerprint
    assert differences(before.document, after.document) == ["cells"]


# --- models --------------------------------------------------------------------------------------


def test_a_vlm_is_compared_with_itself_under_other_settings_on_the_same_seeds() -> None:
    planned = from_fields(
        {
            "pegs": "circle",
            "conditions": "all",
            "reasoners": ["rules", "vlm", {"name": "blind", "picture": False}],
            "vlm": {"model": "openai:gpt-4o", "plan": "absolute"},
        },
        {"vlm": {"history": 2}},
    )
    rules, whole, blind = planned.cells
    assert rules.vlm is None
    assert whole.vlm is not None
    assert blind.vlm == replace(whole.vlm, picture=False)
    assert (whole.reasoner, whole.vlm.plan, whole.vlm.history) == ("vlm", "absolute", 2)
    assert planned.models == ["openai:gpt-4o"] * 2
    assert replace(blind, seed=3).trial_id == "L0-circle-all-blind-3"


def test_a_setting_of_the_model_changes_the_fingerprint() -> None:
    def planned(**settings: Any) -> str:
        fields = {"pegs": "circle", "conditions": "all", "reasoners": "vlm"}
        return from_fields({**fields, "vlm": {"model": "m", **settings}}).fingerprint

    assert planned(picture=False) != planned() == planned(picture=True)


@pytest.mark.parametrize(
    ("reasoner", "settings", "said"),
    [
        ("vlm", {"modle": "m"}, "unknown field of the VLM 'modle'"),
        ("vlm", {"plan": "free"}, "VLM: plan is 'free'"),
        ("vlm", {"deadline_s": 0}, "deadline_s is 0: it must be above 0"),
        ("vlm", {"base_url": "ftp://here"}, "base_url is 'ftp://here'"),
        ("vlm", {"base_url": "http://me:secret@here/v1"}, "base_url holds a name, a password"),
        ({"name": "rules", "picture": False}, {}, "reasoner 'rules' is no VLM"),
        ({"picture": False}, {}, "reasoner's name is None"),
        ("vlm", ["m"], "vlm is"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_in_one_line(
    reasoner: Any, settings: Any, said: str
) -> None:
    with pytest.raises(InputError) as refused:
        from_fields({"pegs": "circle", "conditions": "all", "reasoners": reasoner, "vlm": settings})
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert "secret" not in str(refused.value)


def test_a_missing_key_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    fields = {"pegs": "circle", "conditions": "all", "reasoners": "vlm"}
    planned = from_fields({**fields, "vlm": {"model": "openai:gpt-4o"}})
    with pytest.raises(InputError, match="set the environment variable OPENAI_API_KEY"):
        runner.run(planned, tmp_path / "out")
    assert not (tmp_path / "out").exists()
