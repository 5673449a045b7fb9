"""Table IV's protocol as a person at a real cell meets it: `pliant experiment` in a terminal of its
own, with the emulated UR5e in the arm's place, which the experiment knows nothing of."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from a_terminal import Terminal
from ur5e_emulated import cell_at, when_moving

from pliant import store
from pliant.conditions import Setup
from pliant.emulator.client import started
from pliant.experiment import journal
from pliant.ur5e.configuration import save

PLIANT = Path(sys.executable).parent / "pliant"
HOST = "127.0.0.89"
QUESTIONS = (r"lift\s+the\s+peg", "Is it placed")
PLAN = """
trials: 2
cells:
- {peg: circle, reasoner: rules, condition: {name: hole_10, hole_y_mm: [-10, -10]}}
"""


def agree(terminal: Terminal, seed: int) -> None:
    """To each motion before a trial, and that things are in their place."""
    for question in QUESTIONS:
        terminal.until(rf"(?s)seed {seed}.*{question}")
        terminal.press("y\n")


@pytest.mark.system
@pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'")
def test_a_person_places_agrees_labels_and_stops_by_ctrl_c(tmp_path: Path) -> None:
    """However late a loaded machine lets the arm's driver run: the emulator waits for it."""
    plan, file, out = (tmp_path / name for name in ("plan.yaml", "cell.yaml", "out"))
    plan.write_text(PLAN, encoding="utf-8")
    pace = ("--mode", "fast", "--speed", "3", "--client-patience", "60")
    with started("--host", HOST, *pace) as emulator:
        emulator.set_up(Setup(seed=0, hole_y=-0.01), "circle")
        real = cell_at(HOST, stamp_ms=20e3, driver_ms=30e3, picture_ms=30e3, dashboard_ms=5e3)
        own = {"emulator": None, "gripper": None}  # the peg is fixed to the wrist
        save(file, real.model_copy(update=own))
        with Terminal([PLIANT, "experiment", plan, "--cell", file, "--out", out]) as terminal:
            agree(terminal, 1)
            assert re.search(r"10\.0 mm from its nominal place, to the\s+left", terminal.screen)
            shown = terminal.until("Is the peg inserted")
            assert "judged" not in shown
            picture = re.search(r"last picture: (\S+?\.png)", shown)
            assert picture
            assert Path(picture[1]).is_file()
            inserted = emulator.truth().inserted
            terminal.press("y\n" if inserted else "n\n")
            agree(terminal, 2)
            with when_moving(HOST, lambda admin: terminal.press("\x03")):
                status, last = terminal.ended()
            assert emulator.ask("state")["program"] == "STOPPED"
    assert (status, "1 of 2 trials are done" in last) == (130, True)
    (kept,) = (out / "aborted").iterdir()
    assert f"is kept in '{kept}'" in last.replace("\r\n", "")
    trial = store.load_trial(kept)
    assert (trial.seed, trial.end_reason) == (2, "fault:interrupted")
    assert trial.aborted is not None
    path = out / journal.FILE
    (row,) = (r.trial for r in journal.rows_at(path, (e.offset for e in journal.scan(path))))
    assert (row["cell"], row["seed"], row["inserted"]) == ("ur5e", 1, inserted)
    assert row["fault"] is None
