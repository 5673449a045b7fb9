"""Table IV's protocol as a person at a real cell meets it: `pliant experiment` in a terminal of its
own, with the emulated UR5e in the arm's place, which the experiment knows nothing of."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from a_terminal import Terminal
from ur5e_emulated import cell_at

from pliant.emulator.client import started
from pliant.experiment import journal
from pliant.task import Setup
from pliant.ur5e.configuration import save

PLIANT = Path(sys.executable).parent / "pliant"
HOST = "127.0.0.89"
PLAN = """
trials: 2
cells:
- {peg: circle, reasoner: rules, condition: {name: hole_10, hole_y_mm: [-10, -10]}}
"""


@pytest.mark.system
@pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'")
def test_a_person_places_agrees_labels_and_stops(tmp_path: Path) -> None:
    plan, file, out = (tmp_path / name for name in ("plan.yaml", "cell.yaml", "out"))
    plan.write_text(PLAN)
    with started("--host", HOST) as emulator:
        real = cell_at(HOST, stamp_ms=2000.0, driver_ms=5000.0, picture_ms=5000.0)
        save(file, real.model_copy(update={"emulator": None}))
        with Terminal([PLIANT, "experiment", plan, "--cell", file, "--out", out]) as terminal:
            terminal.until(r"10\.0 mm from its nominal place, to the left")
            terminal.until("Is it placed")
            emulator.set_up(Setup(seed=1, hole_y=-0.01), "circle")
            terminal.press("y\n")
            terminal.until("Is the way free")
            terminal.press("y\n")
            shown = terminal.until("Is the peg inserted")
            assert "judged" not in shown
            picture = re.search(r"last picture: (\S+?\.png)", shown)
            assert picture
            assert Path(picture[1]).is_file()
            inserted = emulator.truth().inserted
            terminal.press("y\n" if inserted else "n\n")
            terminal.until(r"seed 2[^?]*Is it placed")
            terminal.press("q\n")
            status, last = terminal.ended()
    assert (status, "1 of 2 trials are done" in last) == (1, True)
    path = out / journal.FILE
    (row,) = (r.trial for r in journal.rows_at(path, (e.offset for e in journal.scan(path))))
    assert (row["cell"], row["seed"], row["inserted"]) == ("ur5e", 1, inserted)
    assert row["fault"] is None
