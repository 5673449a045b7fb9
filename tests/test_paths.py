"""Files are found where they were named, whatever the current folder of whoever looks; results do
not say where that was."""

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from pliant import teaching
from pliant.commissioning.draft import Draft
from pliant.errors import InputError
from pliant.experiment import runner
from pliant.experiment.cells import Experiment
from pliant.experiment.plan import from_fields, load
from pliant.experiment.rows import Rows, lost
from pliant.experiment.where import Where
from pliant.experiment.work import Job
from pliant.own import located_own, own_file, short_name
from pliant.paths import expanded, located, seen_from, shortened, shown
from pliant.reasoners import reasoner

MINE = "from pliant.reasoners.rules import Rules as Mine\n"
PEG = "shape: circle\ndiameter_mm: {}\nlength_mm: 80\n"
EXPERIMENT = """
trials: 2
pegs: own/thick.yaml
conditions: none
reasoners: [rules, own/mine.py:Mine]
cells:
- {peg: [circle, own/thick.yaml], condition: all, reasoner: own/mine.py:Mine}
goals: own/goals/goals.yaml
"""


def agreed(path: Path, overrides: Mapping[str, Any] | None = None) -> Experiment:
    """An experiment file whose own code somebody has agreed to."""
    return load(path, overrides, agree=lambda named: None)


def project(folder: Path, diameter: float = 30.0) -> Path:
    """An experiment file with all the files that it names beside it."""
    own = folder / "own"
    shutil.copytree(str(files("pliant") / "goals"), own / "goals")
    (own / "mine.py").write_text(MINE, encoding="utf-8")
    (own / "thick.yaml").write_text(PEG.format(diameter), encoding="utf-8")
    path = folder / "experiment.yaml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    return path


# --- where a path counts from --------------------------------------------------------------------


def test_a_path_counts_from_its_folder_and_home_is_a_tilde(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/me")
    assert located("a/b.yaml") == tmp_path / "a" / "b.yaml"
    assert located("b.yaml", Path("/x")) == Path("/x/b.yaml")
    assert located("b.yaml", Path("x")) == tmp_path / "x" / "b.yaml"
    assert located("/b.yaml", Path("/x")) == Path("/b.yaml")
    assert located("~/b.yaml", Path("/x")) == Path("/home/me/b.yaml")
    assert located("~nobody-of-this-name.yaml") == tmp_path / "~nobody-of-this-name.yaml"
    assert [expanded(w) for w in ("--out=~/a", "~/a", "a~", "--seed")] == [
        *("--out=/home/me/a", "/home/me/a", "a~", "--seed")
    ]


def test_a_path_that_nothing_can_have_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="holds a zero byte"):
        from_fields({"pegs": "a\0.yaml", "conditions": "none", "reasoners": "rules"})
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(InputError, match="the current folder does not exist any more"):
        located("a.yaml")
    assert located(tmp_path / "a.yaml") == tmp_path / "a.yaml"
    assert shown(tmp_path) == tmp_path
    assert shortened(f"'{tmp_path}/a'") == f"'{tmp_path}/a'"


@pytest.mark.parametrize("address", ["s3://bucket/runs", "gs:/bucket", "hdfs://node:9000/runs"])
def test_an_address_is_no_folder(address: str) -> None:
    with pytest.raises(InputError, match=r"is an address .* files and folders only"):
        located(Path(address))


def test_a_person_sees_what_lies_below_the_current_folder_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert shown(tmp_path / "runs" / "a") == Path("runs/a")
    assert shown(tmp_path.parent) == tmp_path.parent
    said = f"peg file '{tmp_path}/a.yaml', '{tmp_path}er/b.yaml'"
    assert shortened(said) == f"peg file 'a.yaml', '{tmp_path}er/b.yaml'"


def test_one_file_names_another_through_links(tmp_path: Path) -> None:
    (tmp_path / "deep" / "goals").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "deep" / "goals")
    (tmp_path / "peg.yaml").write_text("", encoding="utf-8")
    way = seen_from(tmp_path / "peg.yaml", tmp_path / "link")
    assert way == "../../peg.yaml"
    assert located(way, tmp_path / "link").is_file()


# --- a reasoner's file ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["plain", "two words", "a#1", "a:b", "C:x", "größer", "夹爪"])
def test_a_reasoners_file_may_stand_in_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folder = tmp_path / name
    folder.mkdir()
    (folder / "mine.py").write_text(MINE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    given = f"{name}/mine.py:Mine"
    assert own_file(given) == (folder / "mine.py", "Mine")
    assert short_name(given) == "mine.py:Mine"
    assert located_own(given) == f"{folder}/mine.py:Mine"
    assert type(reasoner(given)).__name__ == "Mine" or reasoner(given).name == "rules"


def test_other_reasoners_have_no_file() -> None:
    for name in ("rules", "vlm", "a:b", "mine.py", r"C:\me\mine.py"):
        assert own_file(name) is None
        assert short_name(name) == located_own(name) == name
    assert own_file(r"C:\me\mine.py:Mine") is not None


# --- experiments ---------------------------------------------------------------------------------


def test_an_experiment_files_names_count_from_its_folder_and_from_nowhere_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = project(tmp_path / "there")
    project(tmp_path / "here", diameter=20.0)
    monkeypatch.chdir(tmp_path / "here")  # where files of the same names stand
    planned = agreed(Path("../there/experiment.yaml"))
    assert planned.cells[0].task.peg.radius == pytest.approx(0.015)
    assert planned.goals == f"{tmp_path / 'here'}/../there/own/goals/goals.yaml"
    assert [c.names[-1] for c in planned.cells] == ["rules", *["mine.py:Mine"] * 3]
    for name in ("thick.yaml", "mine.py", "goals/goals.yaml"):
        (tmp_path / "there" / "own" / name).unlink()
        with pytest.raises(InputError, match=f"there/own/{name}' (cannot be read|does not exist)"):
            agreed(path).teaching()
        (tmp_path / "there" / "own" / name).write_bytes(
            (tmp_path / "here" / "own" / name).read_bytes()
        )


def test_what_is_given_at_the_command_line_counts_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = project(tmp_path / "there")
    project(tmp_path / "here", diameter=20.0)
    monkeypatch.chdir(tmp_path / "here" / "own")
    given = {"pegs": ["thick.yaml"], "reasoners": ["mine.py:Mine"], "goals": "goals/goals.yaml"}
    planned = agreed(path, given)
    assert {c.task.peg.radius for c in planned.cells} == {0.01}
    assert planned.goals == str(tmp_path / "here" / "own" / "goals" / "goals.yaml")


def test_a_project_that_was_moved_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = agreed(project(tmp_path / "before"))
    assert str(tmp_path) not in json.dumps(before.document)
    (tmp_path / "before").rename(tmp_path / "after")
    monkeypatch.chdir(tmp_path / "after")
    after = agreed(Path("experiment.yaml"))
    assert after.fingerprint == before.fingerprint
    assert [s.trial_id for s in after.specs()] == [s.trial_id for s in before.specs()]


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text(MINE, encoding="utf-8")
    twins = [f"{tmp_path}/{folder}/mine.py:Mine" for folder in ("a", "b")]
    with pytest.raises(InputError, match="two different cells are both named"):
        from_fields({"pegs": "circle", "conditions": "none", "reasoners": twins})


def elsewhere(job: Job) -> Rows:
    """What a worker finds whose current folder is another."""
    os.chdir("/")
    made = reasoner(job.spec.reasoner).name
    assert job.goals is not None
    assert Path(job.goals).is_file()
    (job.folder / f"{job.spec.seed}.txt").write_text(f"{job.record} {job.replay}", encoding="utf-8")
    return lost(job.spec, "made_up", made, 0.0)


def test_workers_find_everything_from_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project(tmp_path)
    monkeypatch.chdir(tmp_path)
    fields = {"pegs": "circle", "conditions": "none", "trials": 1}
    fields |= {"reasoners": "own/mine.py:Mine", "goals": "own/goals/goals.yaml"}
    done = runner.run(
        from_fields(fields), Path("out"), workers=1, work=elsewhere, record=Path("talk")
    )
    assert done.complete
    assert (tmp_path / "out" / "1.txt").read_text(encoding="utf-8") == f"{tmp_path}/talk None"


# --- goals, drafts and cells ---------------------------------------------------------------------


def test_goals_taught_with_a_peg_of_ones_own_can_be_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    (before / "pegs").mkdir(parents=True)
    peg = before / "pegs" / "thick.yaml"
    peg.write_text(PEG.format(30), encoding="utf-8")
    shipped = teaching.shipped()
    shown = {f: replace(d, peg=str(peg)) for f, d in shipped.demonstrations.items()}
    teaching.save(before / "goals" / "goals.yaml", teaching.taught(shipped.goals, shown))
    draft = Draft(folder=before / "goals" / "more.draft", cell=before / "cell.yaml", peg=str(peg))
    draft.save(())
    assert "peg: ../pegs/thick.yaml\n" in (before / "goals" / "goals.yaml").read_text(
        encoding="utf-8"
    )
    before.rename(after)
    monkeypatch.chdir(after)
    loaded = teaching.load(Path("goals/goals.yaml"))
    assert {d.peg for d in loaded.demonstrations.values()} == {f"{after}/goals/../pegs/thick.yaml"}
    for cell in (after / "cell.yaml", Path("cell.yaml")):
        Draft(folder=Path("goals/more.draft"), cell=cell, peg="pegs/thick.yaml").load()
    with pytest.raises(InputError, match=r"has cell '\.\./cell\.yaml', not 'sim'"):
        Draft(folder=Path("goals/more.draft"), cell=None, peg="pegs/thick.yaml").load()


def test_the_peg_of_the_goals_is_in_the_fingerprint(tmp_path: Path) -> None:
    project(tmp_path)
    goals = tmp_path / "own" / "goals" / "goals.yaml"
    goals.write_text(
        goals.read_text(encoding="utf-8").replace("peg: circle", "peg: ../thick.yaml"),
        encoding="utf-8",
    )

    def planned() -> Experiment:
        return agreed(tmp_path / "experiment.yaml")

    before = planned().fingerprint
    (tmp_path / "own" / "thick.yaml").write_text(
        PEG.format(30).replace("80", "85"), encoding="utf-8"
    )
    assert planned().document["goals"] != agreed(project(tmp_path / "other")).document["goals"]
    assert planned().fingerprint != before


def test_where_a_cells_folder_stands_does_not_change_the_cell(tmp_path: Path) -> None:
    text = (files("pliant") / "ur5e" / "example.yaml").read_text(encoding="utf-8")
    found = []
    for name in ("before", "after"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "cell.yaml").write_text(
            text.replace("source: realsense", "source: file").replace(
                'where: ""', "where: seen.db3"
            ),
            encoding="utf-8",
        )
        where = Where(file=folder / "cell.yaml")
        assert where.configuration is not None
        assert where.configuration.camera.where == str(folder / "seen.db3")
        found.append(where.document)
    assert found[0] == found[1]
