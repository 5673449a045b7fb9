"""`pliant teach` and `pliant check-cell` at an emulated UR5e, in a real terminal."""

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from a_terminal import Terminal
from teach_keys import PRESSES, Hands

from pliant.emulator.client import Admin, started
from pliant.errors import InputError
from pliant.pose import Pose
from pliant.ur5e.configuration import load, save
from pliant.ur5e.emulated import configuration_of

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST = "127.0.0.91"
PLIANT = str(Path(sys.executable).parent / "pliant")


@pytest.fixture(scope="module")
def emulator() -> Iterator[Admin]:
    with started("--mode", "lockstep", "--host", HOST) as admin:
        yield admin


@pytest.fixture
def cell(emulator: Admin, tmp_path: Path) -> str:
    """The cell's file."""
    path = tmp_path / "cell.yaml"
    save(path, configuration_of(HOST))
    return str(path)


def checks(cell: str) -> tuple[int, dict[str, str]]:
    command = [PLIANT, "check-cell", "--cell", cell, "--json"]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    return done.returncode, {c["check"]: c["state"] for c in json.loads(done.stdout)["checks"]}


def test_goals_taught_with_keys_at_the_arm_insert_the_peg(cell: str, tmp_path: Path) -> None:
    goals = str(tmp_path / "taught" / "goals.yaml")
    with Terminal([PLIANT, "teach", "--cell", cell, "--goals", goals]) as terminal:
        hands = Hands(terminal)
        for name, goal, keys in PRESSES:
            hands.teach(name, goal, keys)
        terminal.until("Enter writes the goals")
        terminal.press("\r")
        status, said = terminal.ended()
        assert status == 0, said
        assert terminal.attributes == terminal.before
    words = [
        "--cell",
        cell,
        "--goals",
        goals,
        "--condition",
        "none",
        "--out",
        str(tmp_path / "run"),
    ]
    done = subprocess.run(
        [PLIANT, "run", *words], capture_output=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_goal_is_taught_by_leading_the_arm_by_hand(
    cell: str, emulator: Admin, tmp_path: Path
) -> None:
    base = load(Path(cell)).task_frame.transform[:3, 3]
    there = Pose(y=0.026, z=0.2136, roll=math.radians(10))
    hand = [*(there.position() + base), there.roll, 0.0, 0.0]
    outside = [*(Pose(y=0.12, z=0.2136).position() + base), 0.0, 0.0, 0.0]
    with Terminal([PLIANT, "teach", "--cell", cell, "--goals", str(tmp_path / "g.yaml")]) as shown:
        Hands(shown)
        with pytest.raises(InputError, match="not in freedrive"):
            emulator.ask("guide", pose=hand)
        shown.press("f")
        shown.until("lead the arm by hand")
        emulator.ask("guide", pose=hand)
        shown.until(r"(?m)^y +0\.0 +(25\.9|26\.0)\d ")
        shown.press("f")
        shown.until("the arm is held")
        with pytest.raises(InputError, match="not in freedrive"):
            emulator.ask("guide", pose=hand)
        shown.press("\r")
        shown.until(r"approach recorded: y 2[56]\.\d mm, z 213\.\d mm, roll (9\.9|10\.0) deg")
        shown.press("f")
        shown.until("lead the arm by hand")
        emulator.ask("guide", pose=outside)
        shown.until("the arm is held")  # at the workspace's edge
        shown.press("q")
        _, said = shown.ended()
    assert "halted; 1 of 5 formations are taught" in said


def test_ctrl_c_during_a_motion_halts_the_arm(cell: str, emulator: Admin, tmp_path: Path) -> None:
    with Terminal([PLIANT, "teach", "--cell", cell, "--goals", str(tmp_path / "g.yaml")]) as shown:
        hands = Hands(shown)
        hands.press(["3"])
        shown.press("w")
        shown.press("\x03")
        _, said = shown.ended()
        assert "halted; 0 of 5 formations are taught" in said
        assert shown.attributes == shown.before
    emulator.grant(250)
    assert not emulator.ask("state")["moving"]


def test_a_ready_cell_passes_every_check(cell: str) -> None:
    status, states = checks(cell)
    assert status == 0, states
    assert set(states.values()) == {"pass"}


@pytest.mark.parametrize(
    ("fault", "fails"),
    [
        ({"kind": "protective_stop"}, "safety status"),
        ({"kind": "power_off"}, "mode"),
        ({"kind": "camera", "state": "dead"}, "camera"),
    ],
)
def test_what_is_wrong_with_the_arm_is_a_finding(
    cell: str, emulator: Admin, fault: dict[str, str], fails: str
) -> None:
    emulator.ask("fault", fault=fault)
    try:
        status, states = checks(cell)
    finally:
        emulator.ask("restore")
    assert status == 1
    assert states[fails] == "fail"


@pytest.mark.parametrize(("sign", "state"), [(1, "pass"), (-1, "fail")])
def test_a_force_with_the_wrong_sign_is_found_before_anything_is_pressed(
    emulator: Admin, tmp_path: Path, sign: int, state: str
) -> None:
    settings = configuration_of(HOST)
    wrist = settings.wrist.model_copy(update={"sign": sign})
    path = tmp_path / "cell.yaml"
    save(path, settings.model_copy(update={"wrist": wrist}))
    status, states = checks(str(path))
    assert states["wrist sign"] == state
    assert (status == 0) is (sign == 1)
