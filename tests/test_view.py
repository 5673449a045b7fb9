"""`pliant view`: the pages of an experiment say what its rows say, lead to its trials, hold what
anybody wrote as text, and are made only where they must be."""

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_tables import made
from view_folders import HOSTILE, Page, drawn, experiment, ran, store_trial, told

from pliant import html
from pliant.cli.view import view as command
from pliant.errors import InputError
from pliant.experiment import holdings, journal
from pliant.experiment.plan import from_fields
from pliant.experiment.rows import Rows
from pliant.report.overview_data import command as command_for
from pliant.report.view import Viewed, view
from pliant.store import PICTURES
from pliant.teaching import shipped
from pliant.text import visible

PEGS = ("square", "rectangle")


def look(folder: Path, **options: Any) -> tuple[Page, Viewed]:
    viewed = view(folder, [shipped()], **options)
    return Page(viewed.page.read_text(encoding="utf-8")), viewed


# --- the experiment's page -----------------------------------------------------------------------


def test_the_page_sets_success_beside_the_papers_with_intervals(tmp_path: Path) -> None:
    page, _ = look(experiment(tmp_path))
    row = next(r for r in page.words.split("circle") if r.startswith("allrules81"))
    assert "87.5 [52.9, 97.8]" in row
    assert "87, 83" in row  # the paper's F and G
    described = [svg["aria-label"] for svg in page.all("svg")]
    assert "F 87.5 [52.9, 97.8], G 87.5 [52.9, 97.8]" in described
    assert any(label and label.startswith("−62.5 [") for label in described)  # none − rules


def test_failures_lead_to_their_trials(tmp_path: Path) -> None:
    page, _ = look(experiment(tmp_path))
    asked = [parse_qs(str(a["href"])[1:]) for a in page.all("a") if "=" in str(a["href"])]
    none = {"level": ["L0"], "peg": ["circle"], "condition": ["all"], "reasoner": ["none"]}
    assert {**none, "outcome": ["failed"]} in asked
    assert {**none, "kind": ["wedged"]} in asked
    compared = [a for a in asked if "against" in a]
    assert {a["against"][0] for a in compared} == {"rules"}
    bins = [a for a in asked if a.get("drawn") == ["drawn_friction"] and a["reasoner"] == ["none"]]
    edges = [(float(b["least"][0]), float(b["most"][0])) for b in bins]
    assert edges[0][0] <= 1.5 < 5 <= edges[-1][1]
    assert all(a[1] == b[0] for a, b in pairwise(edges))


def test_every_link_and_file_of_every_page_is_there(tmp_path: Path) -> None:
    experiment(tmp_path, keep=told("hm"))
    page, viewed = look(tmp_path)
    trial_page = tmp_path / next(iter(page.data["pages"].values()))
    for path in (viewed.page, trial_page):
        shown = Page(path.read_text(encoding="utf-8"))
        ids = {attributes.get("id") for _, attributes in shown.elements}
        for _, attributes in shown.elements:
            for name in ("src", "href"):
                way = attributes.get(name)
                if way is None or way == "data:," or "=" in way:
                    continue
                assert not re.match(r"\w+:|/", way), way
                if way.startswith("#"):
                    assert way[1:] in ids
                else:
                    assert (path.parent / unquote(way)).is_file(), way
        assert all(picture["alt"] for picture in shown.all("img"))


def test_trials_without_a_record_say_which_command_makes_one(tmp_path: Path) -> None:
    fields = {
        "pegs": "square",
        "conditions": [{"name": "windy", "hole_y_mm": [-10, 10], "grasp_roll_deg": [-2, 2]}],
        "reasoners": "rules",
    }
    wanted = from_fields(fields)
    cell = json.loads(json.dumps(wanted.document))["cells"][0]
    names = ("L0", "square", "windy", "rules")
    ranges = "--condition none --hole-y-mm -10 10 --grasp-roll-deg -2 2"
    words = f"pliant run --peg square {ranges} --reasoner rules --seed SEED"
    assert command_for(names, cell) == words
    other = {**cell, "task": {**cell["task"], "peg": {**cell["task"]["peg"], "length": 0.1}}}
    assert "PEG.yaml" in command_for(names, other)
    asked = {**cell, "vlm": {"model": "openai:gpt-4o", "base_url": None}}
    assert "--reasoner vlm --model openai:gpt-4o" in command_for(names, asked)


def test_a_large_experiments_page_stays_small(tmp_path: Path) -> None:
    cells = [made(0, False, reasoner=r, peg=p) for r in ("rules", "none") for p in PEGS]
    rows = [
        Rows(trial={**cell.trial, **drawn(s), "seed": s, "trial_id": f"{cell.trial_id}{s}"})
        for cell in cells
        for s in range(1600)
    ]
    page, viewed = look(experiment(tmp_path, rows))
    assert len(page.data["columns"]["seed"]) == 6400 + 16
    assert viewed.page.stat().st_size <= 2_000_000


def test_an_unfinished_experiment_is_shown_as_far_as_it_is(tmp_path: Path) -> None:
    planned = from_fields({"pegs": "circle", "conditions": "all", "reasoners": ["none", "rules"]})
    holdings.prepare(planned, tmp_path)
    with pytest.raises(InputError, match="no finished trial yet"):
        look(tmp_path)
    with journal.Journal(tmp_path / journal.FILE) as book:
        for seed in (3, 1):
            book.append(made(seed, True))
            book.append(made(seed, False, reasoner="none"))
    page, _ = look(tmp_path)
    assert "Not finished: 4 of 60 trials" in page.words
    assert page.data["columns"]["seed"] == [1, 3, 1, 3]
    assert [cell["reasoner"] for cell in page.data["cells"]] == ["none", "rules"]


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name the result folder"):
        look(tmp_path)
    (tmp_path / "run.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="is broken"):
        look(tmp_path)


# --- trials' pages -------------------------------------------------------------------------------


def test_pages_that_are_up_to_date_stay(tmp_path: Path) -> None:
    experiment(tmp_path, keep=ran()[0])
    first, again = look(tmp_path)[1], look(tmp_path)[1]
    assert (first.made, first.kept) == (1, 0)
    assert (again.made, again.kept) == (0, 1)
    store_trial(tmp_path, replace(ran()[0], wall_s=1.0))
    assert look(tmp_path)[1].made == 1


def test_a_broken_record_is_named_and_the_others_are_shown(tmp_path: Path) -> None:
    experiment(tmp_path, keep=ran()[0])
    broken = store_trial(tmp_path, replace(ran()[0], trial_id="L0-circle-all-rules-1"))
    next((broken / PICTURES).iterdir()).write_bytes(b"no picture")
    page, viewed = look(tmp_path)
    assert viewed.made == 1
    assert len(viewed.problems) == 1
    assert "L0-circle-all-rules-1" in viewed.problems[0]
    assert list(page.data["pages"].values()) == [f"trials/{ran()[0].trial_id}/index.html"]


def test_one_trials_folder_can_be_viewed_alone(tmp_path: Path) -> None:
    place = store_trial(tmp_path, ran()[0])
    page, viewed = look(place)
    assert viewed.page == place / "index.html"
    assert "← the experiment" not in page.words


def test_goals_that_are_not_known_are_said_and_their_pictures_left_out(tmp_path: Path) -> None:
    place = store_trial(tmp_path, ran()[0])
    viewed = view(place, [])
    assert viewed.without_goals == 1
    assert "taught goal" not in Page(viewed.page.read_text(encoding="utf-8")).words
    assert view(place, [shipped()]).made == 1
    assert "taught goal" in Page(viewed.page.read_text(encoding="utf-8")).words


def test_the_command_prints_the_page_to_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(experiment(tmp_path)) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'index.html'}\n"


def test_a_trial_that_shares_files_with_its_run_is_not_served_alone(tmp_path: Path) -> None:
    experiment(tmp_path, keep=ran()[0])
    with pytest.raises(InputError, match=r"serve .* instead"):
        command(tmp_path / "trials" / ran()[0].trial_id, serve=True)


# --- text is data --------------------------------------------------------------------------------


def test_what_pegs_conditions_and_reasoners_are_called_stays_text(tmp_path: Path) -> None:
    rows = made(1, False, fault=HOSTILE, end_reason=HOSTILE)
    names = dict.fromkeys(("peg", "condition", "reasoner", "model"), HOSTILE)
    hostile = replace(rows, trial={**rows.trial, **names, "trial_id": "x"})
    page, _ = look(experiment(tmp_path, [hostile]))
    assert not page.all("b")
    assert not page.all("img")
    assert len(page.all("script")) == 2
    assert visible(HOSTILE) in page.data["cells"][-1]["peg"]
    assert "\x1b" not in page.words


def text() -> st.SearchStrategy[str]:
    pieces = st.sampled_from(["</script>", "<!--", "<script>", "]]>", "&lt;", '"', "'", "\ud800"])
    return st.lists(pieces | st.text(max_size=5)).map("".join)


@given(text())
def test_no_text_gets_out_of_its_place(words: str) -> None:
    page = Page(
        html.tag("main", html.tag("p", words, title=words), html.embedded([words], "data"))
        .encode()
        .decode()
    )
    assert [name for name, _ in page.elements] == ["main", "p", "script"]
    assert page.data == [words]
    assert all(c in "\t\n\r" or ord(c) >= 32 for c in page.words)
