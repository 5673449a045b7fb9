"""`pliant teach` in a real terminal: real keys teach goals that then insert."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from a_terminal import Terminal
from teach_keys import PRESSES, Hands, shows

from pliant.formations import Formation

PLIANT = Path(sys.executable).parent / "pliant"


def test_goals_taught_with_keys_over_two_sessions_insert_the_peg(tmp_path: Path) -> None:
    goals, latest = tmp_path / "taught" / "goals.yaml", tmp_path / "latest.png"
    command = list(map(str, [PLIANT, "teach", "--goals", goals, "--picture", latest]))
    with Terminal(command) as terminal:
        hands = Hands(terminal)
        for name, goal, keys in PRESSES[:3]:
            hands.teach(name, goal, keys)
        terminal.press("\x03")
        status, said = terminal.ended()
        assert status == 130, said
        assert "3 of 5 formations are taught, and the same command goes on" in said
        assert terminal.attributes == terminal.before
    assert not goals.exists()
    with Terminal(command) as terminal:
        hands = Hands(terminal)
        terminal.until("going on: 3 of 5 are taught")
        for _ in range(3):
            terminal.press("b")
        hands.retrace("approach", {"y": 26.0, "z": 213.8, "roll": 10.0})
        hands.retrace("contact", {"z": 187.8})
        hands.retrace("fit", {"y": -35.0})
        for name, goal, keys in PRESSES[3:]:
            hands.teach(name, goal, keys)
        terminal.until("Enter writes the goals")
        terminal.press("\r")
        status, said = terminal.ended()
        assert status == 0, said
        assert terminal.attributes == terminal.before
    assert latest.read_bytes().startswith(b"\x89PNG")
    files = {"goals.yaml", *(f"{formation}.png" for formation in Formation)}
    assert {p.name for p in goals.parent.iterdir()} == files  # the draft is gone
    words = [
        "run",
        "--condition",
        "none",
        "--no-video",
        "--goals",
        goals,
        "--out",
        tmp_path / "run",
    ]
    run = [str(PLIANT), *map(str, words)]
    done = subprocess.run(run, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    again = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert again.returncode == 2
    assert "goals are not overwritten" in again.stderr


def test_arrow_keys_move_and_a_burst_of_keys_moves_once(tmp_path: Path) -> None:
    with Terminal([PLIANT, "teach", "--goals", tmp_path / "goals.yaml"]) as terminal:
        hands = Hands(terminal)
        hands.press(["\x1b[B"])
        terminal.press("dddddddddd")
        terminal.until(shows("y", 2.0))
        hands.at["y"] = 2.0
        hands.press(["w"])
        assert "not moved" not in terminal.until(shows("y", 2.0))
        terminal.press("q")
        status, said = terminal.ended()
        assert status == 1, said
        assert "0 of 5 formations are taught" in said


def test_a_request_to_end_puts_the_terminal_back(tmp_path: Path) -> None:
    with Terminal([PLIANT, "teach", "--goals", tmp_path / "goals.yaml"]) as terminal:
        Hands(terminal)
        assert terminal.attributes != terminal.before
        os.kill(terminal.process.pid, signal.SIGTERM)
        status, said = terminal.ended()
        assert status == 130, said
        assert terminal.attributes == terminal.before


def test_teaching_ends_when_its_terminal_hangs_up_and_keeps_what_was_recorded(
    tmp_path: Path,
) -> None:
    with Terminal([PLIANT, "teach", "--goals", tmp_path / "goals.yaml"]) as terminal:
        Hands(terminal)
        terminal.press("\r")
        terminal.until("approach recorded")
        terminal.hang_up()
    assert (tmp_path / "goals.draft" / "draft.yaml").is_file()


def test_without_a_terminal_teaching_is_refused_in_one_line(tmp_path: Path) -> None:
    command = list(map(str, [PLIANT, "teach", "--goals", tmp_path / "goals.yaml"]))
    done = subprocess.run(
        command, capture_output=True, encoding="utf-8", check=False, stdin=subprocess.DEVNULL
    )
    assert done.returncode == 2
    assert "this is none: use ssh -t" in done.stderr
    assert len(done.stderr.splitlines()) == 1
