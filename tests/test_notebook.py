"""In a notebook results are tables, frames and pictures, and the example notebook runs."""

import subprocess
import sys
from pathlib import Path

import pytest
from documents import ROOT

import pliant
from pliant.errors import InputError
from pliant.experiment.progress import Silent

NOTEBOOK = "examples/notebook.ipynb"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> "pliant.Results":
    folder = tmp_path_factory.mktemp("compared") / "run"
    return pliant.compare(
        reasoners=["none", "rules"], trials=1, out=folder, workers=1, watcher=Silent()
    )


def test_results_are_counted_and_shown_as_table_two(results: "pliant.Results") -> None:
    assert len(results) == 2
    assert repr(results).endswith("2 trials>")
    page = results._repr_html_()
    assert page.count("<tr>") == 3
    assert "<th>reasoner</th>" in page
    assert "<td>rules</td>" in page
    assert set(results.executions["trial_id"].to_pylist()) == set(
        results.trials["trial_id"].to_pylist()
    )
    assert {cell["reasoner"] for cell in results.tables["cells"]} == {"none", "rules"}


def test_a_folder_is_read_again_and_grows_by_the_same_call(results: "pliant.Results") -> None:
    again = pliant.Results(results.folder)
    assert again.trials == results.trials
    more = pliant.compare(
        reasoners="rules", trials=2, out=results.folder, workers=1, watcher=Silent()
    )
    assert len(more) == 3


def test_a_folder_without_results_is_said_at_the_first_look(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no results of pliant: name the result folder"):
        len(pliant.Results(tmp_path))


def test_a_trial_is_shown_with_its_pictures() -> None:
    page = pliant.run(seed=1, reasoner="rules")._repr_html_()
    assert page.count('<img src="data:image/png;base64,') == page.count("<tr>") >= 5
    assert len(page) < 300_000


@pytest.mark.system
def test_trials_are_a_frame_of_pandas(results: "pliant.Results") -> None:
    frame = results.to_pandas()
    assert list(frame["trial_id"]) == results.trials["trial_id"].to_pylist()
    assert len(results.executions_to_pandas()) == len(results.executions)


@pytest.mark.system
def test_the_example_notebook_still_says_what_it_shows() -> None:
    check = [sys.executable, "tools/run_notebook.py", "--check", NOTEBOOK]
    done = subprocess.run(check, cwd=ROOT, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, f"run tools/run_notebook.py {NOTEBOOK}: {done.stdout}{done.stderr}"
