"""The tables count what the rows say, stand beside the paper's figures, and never change."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pliant.conditions import condition
from pliant.errors import InputError
from pliant.experiment import measures, paper, results, tables
from pliant.experiment.one import Spec
from pliant.experiment.rows import Row, Rows, lost
from pliant.experiment.statistics import wilson
from pliant.experiment.tables_text import markdown
from pliant.task import load_task

GOAL = {"y_m": 0.0}


def made(
    seed: int,
    inserted: bool,
    *,
    reasoner: str = "rules",
    peg: str = "circle",
    name: str = "all",
    executions: tuple[Row, ...] = (),
    **changes: Any,
) -> Rows:
    """A trial's rows, made up."""
    spec = Spec(task=load_task(peg), condition=condition(name), seed=seed, reasoner=reasoner)
    rows = lost(spec, "none", "", 0.5)
    trial = {
        **rows.trial,
        "judged": inserted,
        "inserted": inserted,
        "depth_m": 0.021 if inserted else 0.004,
        "end_reason": "inserted" if inserted else "exhausted",
        "fault": None,
        "failure_kind": None if inserted else "wedged",
        **changes,
    }
    done = [{**e, "trial_id": rows.trial_id, "index": i} for i, e in enumerate(executions)]
    return Rows(trial=trial, executions=done)


def step(formation: str, *, verdict: bool = False, to: str | None = None, **changes: Any) -> Row:
    """An execution's row; `to` is the first formation of the plan that follows."""
    plan = None if to is None else [{"formation": to, "retreat": False, "goal": GOAL}]
    return {
        "formation": formation,
        "verdict": verdict,
        "proposed": plan,
        "stop": "reached",
        "goal_y_m": 0.0,
        "truth_tilt_rad": 0.0,
        "truth_fit": True,
        **changes,
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two reasoners on eight seeds, and one cell that only one of them has."""
    rows = [made(s, s <= 7, executions=(step("fit", to="fit"),), extra_fit=s) for s in range(1, 9)]
    rows += [made(s, s <= 2, reasoner="none") for s in range(1, 9)]
    rows += [made(s, True, peg="square", name="none") for s in range(1, 4)]
    results.write_rows(tmp_path, rows)
    return tmp_path


def test_table_ii_gives_success_with_n_and_interval_beside_the_papers(folder: Path) -> None:
    document = tables.build(folder)
    baseline, ours, square = document["cells"]
    assert [baseline["reasoner"], ours["reasoner"], square["peg"]] == ["none", "rules", "square"]
    assert (ours["n"], ours["inserted"]["successes"]) == (8, 7)
    assert ours["inserted"]["low"] == 100 * wilson(7, 8).low
    assert ours["extra"] == {"fit": 4.5, "align": 0.0, "insertion": 0.0}
    assert (ours["paper"]["judged"], ours["paper"]["inserted"]) == (87, 83)
    assert (baseline["paper"]["inserted"], baseline["paper"]["extra"]) == (47, {})
    text = markdown(document)
    assert "| circle | all | rules | 8 | 87.5 [52.9, 97.8] of 8 | 87.5" in text
    assert "87, 83 (n 30) | 0.8, 1.0, 1.1 |" in text
    assert "GPT-4o" in text


def test_reasoners_are_compared_on_the_seeds_they_share(folder: Path) -> None:
    cell, pooled = tables.build(folder)["pairs"]
    assert (cell["first"], cell["second"], cell["condition"]) == ("none", "rules", "all")
    assert (cell["only_first"], cell["only_second"], cell["n"]) == (0, 5, 8)
    assert cell["difference"] == -62.5  # the rules are listed first
    assert cell["low"] < -62.5 < cell["high"] < 0
    assert cell["p"] == 2 / 2**5
    assert pooled["peg"] is None
    assert pooled["n"] == 8


def test_every_two_reasoners_are_compared_in_every_cell_and_the_later_is_named_first(
    tmp_path: Path,
) -> None:
    names = ("none", "rules", "mine")  # as listed
    rows = [
        made(seed, seed <= 2 or name != "none", reasoner=name, peg=peg)
        for peg in ("circle", "square")
        for name in names
        for seed in range(1, 5)
    ]
    results.write_rows(tmp_path, rows)
    text = markdown(tables.build(tmp_path))
    table = text.partition("## Reasoner against reasoner")[2].partition("\n## ")[0]
    named = [
        [c.strip() for c in line.split("|")[1:3]] for line in table.splitlines() if " − " in line
    ]
    two = ["rules − none", "mine − none", "mine − rules"]
    assert named[1:] == [[pair, peg] for peg in ("all", "circle", "square") for pair in two]
    assert "| rules − none | all | all | 8 | +50.0 [" in table
    assert "positive where the one named first inserts more" in table
    assert "The rows of all pool pegs and conditions, which share their seeds" in table


def test_table_iii_counts_the_first_step_of_each_plan(folder: Path) -> None:
    (row,) = tables.build(folder)["transitions"]
    assert row["counts"] == {"fit": {"fit": 8, "align": 0, "insertion": 0}}
    assert row["paper"]["align"]["align"] == 90.5
    assert "| circle | rules | fit | 100.0 | 0.0 | 0.0 | 8 |" in markdown(tables.build(folder))
    planned = [
        step("fit", verdict=True, to="fit"),  # a success plans nothing that counts
        step("align", to="fit"),
        step("align", to="align"),
        step("insertion"),
    ]
    found = measures.transitions(planned)
    assert found == {"align": {"fit": 1, "align": 1, "insertion": 0}}


def test_tables_are_written_beside_the_data_and_do_not_depend_on_wall_time(folder: Path) -> None:
    document = tables.write(folder)
    text = (folder / "tables.json").read_bytes()
    assert json.loads(text) == document
    rows = [
        Rows(trial={**t, "wall_s": 9.0}, executions=e)
        for t, e in zip(
            results.read_trials(folder).to_pylist(),
            [*results.each_trials_executions(folder), *([[]] * 11)],
            strict=True,
        )
    ]
    results.write_rows(folder, rows)
    assert tables.timing(folder)["wall_s"] == 9.0 * len(rows)
    tables.write(folder)
    assert (folder / "tables.json").read_bytes() == text


def faulted(seed: int, kind: str = "reasoner", *, said: str = "no", **changes: Any) -> Rows:
    """A trial that a fault ended before anything was known of it."""
    rows = made(seed, False, **changes)
    end = {"inserted": None, "depth_m": None, "end_reason": f"fault:{kind}", "fault": said}
    return replace(rows, trial={**rows.trial, **end, "failure_kind": "fault"})


def test_what_nobody_measured_or_labelled_is_in_no_rate_and_what_the_cell_ended_is() -> None:
    unlabelled = {**made(2, False).trial, "inserted": None}
    assert measures.inserted(faulted(1).trial) is None
    assert measures.inserted(faulted(1, "protective_stop").trial) is False
    assert measures.inserted(faulted(1, "of_a_cell_of_my_own").trial) is False
    assert measures.inserted(unlabelled) is None
    assert measures.rate([True, False, None])["n"] == 2
    assert measures.rate([None])["percent"] is None


def test_faults_stand_beside_the_rates_and_in_none_of_them(tmp_path: Path) -> None:
    good = [made(s, s <= 3, executions=(step("fit", to="fit"),)) for s in range(1, 5)]
    bad = [faulted(s, executions=(step("fit", to="align"),)) for s in range(5, 7)]
    results.write_rows(tmp_path, [*good, *bad, faulted(1, peg="square", said="1/0 (mine.py:3)")])
    document = tables.build(tmp_path)
    circle, square = document["cells"]
    assert (circle["n"], circle["faults"]) == (4, 2)
    assert (circle["inserted"]["successes"], circle["inserted"]["n"]) == (3, 4)
    assert circle["judged"]["n"] == 4
    assert circle["failure_kinds"] == {"wedged": 1, "fault": 2}
    assert document["transitions"][0]["counts"] == {"fit": {"fit": 4, "align": 0, "insertion": 0}}
    assert square["inserted"]["percent"] is None
    assert square["said"] == [{"text": "fault:reasoner: 1/0 (mine.py:3)", "n": 1}]
    text = markdown(document)
    assert "| circle | all | rules | 4 | 2 | 75.0 [30.1, 95.4] of 4 |" in text
    assert "| square | all | rules | 0 | 1 | faults | faults | – | – | – |" in text
    assert "| square | all | rules | 1 | fault:reasoner: 1/0 (mine.py:3) |" in text
    assert "0.0 [" not in text.partition("## Table III")[0]
    assert "--again faults" in text


def test_a_level_and_a_scenario_of_nothing_but_faults_have_no_percentage(tmp_path: Path) -> None:
    rows = [faulted(1, level="L4"), faulted(1, level="wrong_peg", peg="square")]
    results.write_rows(tmp_path, rows)
    document = tables.build(tmp_path)
    for row in (*document["ladder"], *document["scenarios"]):
        assert (row["n"], row["faults"], row["executions"]) == (0, 1, None)
    text = markdown(document)
    assert "| L4 | planar | rules | 1 | faults | – | – | – | – | – | 1 fault |" in text
    assert "| wrong_peg | rules | 1 | stop | faults |" in text


def test_depth_and_grasp_angle_are_counted_in_steps() -> None:
    angles = (0.5, -3.5, 3.99, 4.0, 4.9)
    trials = [
        made(i, abs(a) < 4, drawn_grasp_roll=math.radians(a)).trial for i, a in enumerate(angles)
    ]
    assert [d["successes"] for d in measures.depths(trials).values()] == [3, 3, 0]
    bins = measures.by_grasp_angle(trials)
    assert {name: (b["successes"], b["n"]) for name, b in bins.items()} == {
        "0–1": (1, 1),
        "3–4": (2, 2),
        "4–5": (0, 2),
    }
    assert measures.by_grasp_angle([made(1, True, drawn_grasp_roll=0.0).trial]) == {}


def test_overshoot_is_a_correction_that_undoes_the_last() -> None:
    def cycles(*goals_mm: float) -> int:
        return measures.overshoot_cycles([step("align", goal_y_m=g * 1e-3) for g in goals_mm])

    assert cycles(0, 3, 5) == 0
    assert cycles(0, 3, 1, 2) == 2
    assert cycles(0, 3, 3.05, 5) == 0  # as good as the same goal
    assert cycles(0) == 0


def test_a_false_acceptance_is_one_that_the_truth_denies() -> None:
    stopped = step("insertion", stop="compression")
    leaning = step("align", verdict=True, truth_tilt_rad=math.radians(7))
    out = step("align", verdict=True, truth_fit=False)
    upright = step("align", verdict=True)
    rejected = step("align", truth_tilt_rad=math.radians(7))
    found = measures.false_alignments([leaning, stopped, out, upright, stopped, rejected, stopped])
    assert found == {"accepted": 3, "false": 2, "stopped": 1}


def test_failure_kinds_are_counted_and_explained(folder: Path) -> None:
    baseline = tables.build(folder)["cells"][0]
    assert baseline["failure_kinds"] == {"wedged": 6}
    assert "- wedged: in the hole, not deep enough" in markdown(tables.build(folder))


def placed(y_mm: float, angle_deg: float, seeds: int = 5, **changes: Any) -> list[Rows]:
    """Trials with the hole and the peg in fixed places."""
    where: dict[str, Any] = {"drawn_friction": 1.0, "drawn_hole_y": y_mm * 1e-3}
    where["drawn_grasp_roll"] = math.radians(angle_deg)
    rows = [made(s, s > 1, name="none", **where, **changes) for s in range(1, seeds + 1)]
    name = f"hole_{y_mm:g}_angle_{angle_deg:g}"
    for row in rows:
        row.trial["condition"] = name
        row.trial["trial_id"] = f"{name}-{row.trial['seed']}"
    return rows


def test_table_iv_stands_beside_the_papers_and_says_which_cell_it_was(tmp_path: Path) -> None:
    rows = [*placed(0, 0, cell="ur5e"), *placed(-20, 5, cell="ur5e")]
    rows[1].trial["inserted"] = None  # nobody has labelled it
    results.write_rows(tmp_path, rows)
    document = tables.build(tmp_path)
    nominal, far = document["placed"]
    assert (far["hole_mm"], far["angle_deg"], far["n"]) == (-20, 5, 5)
    assert (far["inserted"]["successes"], far["inserted"]["n"]) == (4, 5)
    assert far["inserted"]["low"] == 100 * wilson(4, 5).low
    assert (far["paper"]["judged"], far["paper"]["inserted"], far["paper"]["n"]) == (80, 100, 5)
    assert far["paper"]["extra"] == {"fit": 3.0, "align": 1.8, "insertion": 1.4}
    assert nominal["inserted"]["n"] == 4
    text = markdown(document)
    assert "Made with a UR5e" in text
    assert "repeats of one trial" not in text
    assert "| ur5e | rules | -20 | 5 | 5 | 80.0 [37.6, 96.4] of 5 |" in text


def test_a_table_iv_without_a_robot_says_so(tmp_path: Path) -> None:
    results.write_rows(tmp_path, placed(10, 0, cell="emulator"))
    text = markdown(tables.build(tmp_path))
    assert "**Emulated: no robot.**" in text
    assert "repeats of one trial" in text
    assert "| emulator | rules | 10 | 0 |" in text


def test_what_is_drawn_or_nominal_only_is_no_table_iv(tmp_path: Path) -> None:
    drawn = [made(1, True), made(2, True)]
    results.write_rows(tmp_path, [*drawn, *placed(0, 0), *placed(10, 0, peg="square")])
    assert tables.build(tmp_path)["placed"] == []
    assert "Table IV" not in markdown(tables.build(tmp_path))


def test_the_papers_figures_are_whole() -> None:
    for peg in ("circle", "square", "rectangle"):
        for name in ("none", "friction", "pose", "all"):
            row = paper.table2(peg, name, "rules")
            assert row is not None
            assert row.inserted_percent <= row.judged_percent <= 100
            assert set(row.extra) == {"fit", "align", "insertion"}
            assert (paper.table2(peg, name, "none") is None) == (peg != "circle")
    combinations = [(0, 0), (10, 0), (15, 0), (20, 0), (10, 5), (15, 5), (20, 5)]
    rows = [paper.table4(*c) for c in combinations]
    assert [row.inserted_percent for row in rows if row] == [100, 100, 100, 80, 100, 100, 100]
    assert paper.table4(5, 0) is None
    assert paper.table2("hexagon", "all", "rules") is None
    assert "arXiv 2509.17666" in paper.source()


def test_a_run_of_nothing_but_successes_still_has_all_its_tables(tmp_path: Path) -> None:
    results.write_rows(tmp_path, [made(1, True, name="none")])
    text = markdown(tables.write(tmp_path))
    for words in ("No execution was followed", "Only one reasoner", "No cell draws", "None."):
        assert words in text


def test_what_is_no_finished_run_is_refused_with_what_to_do(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(InputError, match="absent' does not exist: name the result folder"):
        tables.build(tmp_path / "absent")
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / "run.json").touch()
    with pytest.raises(InputError, match="not finished: finish it with the command that began it"):
        tables.build(tmp_path / "begun")
    (folder / "executions.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(InputError, match="is broken"):
        tables.build(folder)
    (folder / "trials.parquet").write_bytes((folder / "executions.parquet").read_bytes())
    with pytest.raises(InputError, match="is broken"):
        tables.timing(folder)


def test_a_model_alone_has_failed_where_the_rules_stepped_in() -> None:
    asked: dict[str, Any] = {"decisions": 10, "tokens": 100, "cost_usd": 0.5}
    rows = [
        made(1, True, **asked, own=10),
        made(2, True, **asked, own=9, clamped=1),
        made(3, True, **asked, own=8, fallbacks=2),
        made(4, False, **asked, own=10),
    ]
    share = measures.model_share([r.trial for r in rows])
    assert share is not None
    assert (share["alone"]["successes"], share["alone"]["n"]) == (1, 4)
    assert (share["decisions"], share["clamped"], share["fallbacks"]) == (40, 1, 2)
    assert share["own_percent"] == 100 * 37 / 40
    assert (share["tokens"], share["cost_usd"]) == (100, 0.5)
    assert measures.model_share([made(1, True).trial]) is None


def test_a_table_shows_the_model_s_own_share(tmp_path: Path) -> None:
    results.write_rows(tmp_path, [made(1, True, decisions=7, fallbacks=7), made(2, True)])
    text = markdown(tables.build(tmp_path))
    assert "## The model's own share" in text
    assert "| 7 | 0.0 | 0 | 7 |" in text
