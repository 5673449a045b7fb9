"""A cell of the user's own, by `file.py:Class`."""

from pathlib import Path

import pytest

from pliant.cli.cells import where, where_trials_are
from pliant.cli.run import run
from pliant.conditions import condition
from pliant.errors import InputError

CELL = """
from pliant.sim.cell import SimCell

class Mine(SimCell):
    kind = "mine"

class Half:
    kind = "half"

class Breaks(Mine):
    def prepare(self, task, setup):
        raise ZeroDivisionError("by nought")
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(CELL, encoding="utf-8")
    return path


def test_its_trials_carry_its_name_and_belong_to_its_file(file: Path) -> None:
    chosen = where_trials_are(f"{file}:Mine")
    chosen.check("L8", condition("all"), "oracle", "guided")  # what it can do, it says itself
    assert (chosen.kind, chosen.is_simulated) == ("mine", False)
    before = chosen.document
    file.write_text(CELL + "\n# another\n", encoding="utf-8")
    again = where_trials_are(f"{file}:Mine").document
    assert before["configuration"] != again["configuration"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mine.py:Half", "lacks 'prepare'; see pliant.cell.Workcell"),
        ("mine.py:None_", "has no class 'None_': it has Mine, Half, Breaks"),
        ("none.py:Mine", "does not exist"),
    ],
)
def test_one_that_cannot_be_used_is_refused(file: Path, name: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        where_trials_are(str(file.parent / name))


def test_it_is_for_trials_only(file: Path) -> None:
    with pytest.raises(InputError, match="is for run and experiment"):
        where(f"{file}:Mine")


def test_one_that_breaks_is_named_and_nothing_is_called_a_result(
    file: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="Breaks' failed: ZeroDivisionError: by nought"):
        run(cell=f"{file}:Breaks", out=tmp_path / "out", video=False)
