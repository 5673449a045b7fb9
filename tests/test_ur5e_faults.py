"""Every fault ends what is under way, quickly, with the arm at rest, and nothing moves it again."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from a_terminal import Terminal
from test_signals import assert_all_end
from ur5e_emulated import cell_at, when_moving, with_patience_of_a_real_cell

from pliant.cell import Truth
from pliant.commissioning.preflight import CheckState, check
from pliant.conditions import Setup, condition
from pliant.emulator.client import Admin, started
from pliant.errors import RobotFault
from pliant.experiment.one import Spec, perform
from pliant.experiment.where import Where
from pliant.formations import Formation
from pliant.pose import Pose
from pliant.records import Execution
from pliant.store import load_trial
from pliant.task import load_task
from pliant.teaching import save as save_goals
from pliant.teaching import shipped
from pliant.ur5e.cell import UrCell
from pliant.ur5e.configuration import save
from pliant.ur5e.robot import UrRobot

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("rtde_control") is None, reason="needs the extra 'ur5e'"),
]

HOST, BOXED_HOST = "127.0.0.81", "127.0.0.83"
SEEN_WITHIN_S = 1.0  # of the controller's clock: a loaded machine
HANGING_S = 20.0  # of the wall's: ur_rtde's own calls would hang for 30 s and more
GOALS = shipped().goals
FAULTS: dict[str, dict[str, object]] = {
    "protective_stop": {},
    "emergency_stop": {},
    "power_off": {},
    "drop_rtde": {},
    "gripper_lost": {},
}
ENDS = {"drop_rtde": "connection", "gripper_lost": "gripper"}


@pytest.fixture(scope="module")
def emulator() -> Iterator[Admin]:
    with started("--host", HOST, "--mode", "lockstep") as admin:
        yield admin


@pytest.fixture
def cell(emulator: Admin) -> Iterator[UrCell]:
    """A person has seen to the last fault."""
    emulator.ask("restore")
    with UrCell(cell_at(HOST)) as cell:
        yield cell


@pytest.fixture
def impatient(emulator: Admin) -> Iterator[UrCell]:
    """As the cell, for faults that only time can tell."""
    emulator.ask("restore")
    with UrCell(with_patience_of_a_real_cell(HOST)) as cell:
        yield cell


@pytest.fixture(scope="module")
def boxed() -> Iterator[Admin]:
    """A controller with safety limits of its own, in its base frame."""
    box = ("0.4", "0.0", "0.2", "0.6", "0.25", "0.4")
    arguments = ("--host", BOXED_HOST, "--mode", "lockstep", "--box", *box)
    with started(*arguments) as admin:
        yield admin


def prepared(cell: UrCell) -> UrRobot:
    return cell.prepare(load_task("circle"), Setup(seed=0))


def go(robot: UrRobot, formation: Formation) -> None:
    speed = 0.05 if formation is Formation.APPROACH else 0.02
    robot.move_to(GOALS.target(formation), speed_m_s=speed, stop_at_compression_m=0.02)


def pose_of(emulator: Admin) -> np.ndarray:
    return np.array(emulator.ask("state")["tool_pose"])


def assert_at_rest(emulator: Admin) -> None:
    """Within a tenth of a second, and for good."""
    emulator.grant(50)
    at = pose_of(emulator)
    emulator.grant(500)
    assert np.linalg.norm((pose_of(emulator) - at)[:3]) < 2e-4
    assert emulator.ask("state")["program"] == "STOPPED"


def assert_final(robot: UrRobot, kind: str) -> None:
    """Whatever is asked of the robot now, it is the same fault."""
    calls: list[Callable[[], object]] = [
        lambda: go(robot, Formation.APPROACH),
        robot.observe,
        lambda: robot.settle(1.0),
    ]
    for call in calls:
        with pytest.raises(RobotFault) as again:
            call()
        assert again.value.kind == kind
    robot.halt()


@pytest.mark.parametrize("formation", list(Formation))
@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_fault_during_a_motion_halts_the_arm_and_is_named(
    cell: UrCell, emulator: Admin, fault: str, formation: Formation
) -> None:
    robot = prepared(cell)
    for earlier in list(Formation)[: formation.order]:
        go(robot, earlier)
    with when_moving(HOST, lambda admin: admin.fault(fault, **FAULTS[fault])) as happened:
        began = time.monotonic()
        with pytest.raises(RobotFault) as caught:
            go(robot, formation)
    assert caught.value.kind == ENDS.get(fault, fault)
    assert emulator.ask("state")["time_s"] - happened[0] < SEEN_WITHIN_S
    assert_at_rest(emulator)
    assert_final(robot, caught.value.kind)
    assert time.monotonic() - began < HANGING_S
    assert_at_rest(emulator)


def test_a_controller_that_stalls_is_halted_before_it_goes_on(
    impatient: UrCell, emulator: Admin
) -> None:
    robot = prepared(impatient)
    at: list[np.ndarray] = []

    def stall(admin: Admin) -> None:
        admin.fault("stall", seconds=4.0)
        at.append(pose_of(admin))

    with (
        when_moving(HOST, stall),
        pytest.raises(RobotFault, match=r"has sent nothing new for 0\.9 s") as caught,
    ):
        go(robot, Formation.APPROACH)
    assert caught.value.kind == "stalled"
    emulator.grant(500)  # after the stall
    assert np.linalg.norm((pose_of(emulator) - at[0])[:3]) < 0.003
    assert_at_rest(emulator)
    assert_final(robot, "stalled")


@pytest.mark.parametrize("state", ["frozen", "error", "dead"])
def test_no_new_picture_is_a_fault_with_the_arm_at_rest(
    impatient: UrCell, emulator: Admin, state: str
) -> None:
    robot = prepared(impatient)
    robot.observe()
    emulator.fault("camera", state=state)
    go(robot, Formation.APPROACH)
    with pytest.raises(RobotFault) as caught:
        robot.observe()
    assert caught.value.kind == "camera"
    assert_final(robot, "camera")
    at = pose_of(emulator)
    emulator.grant(100)
    assert np.linalg.norm((pose_of(emulator) - at)[:3]) < 2e-4


@pytest.mark.parametrize(("number", "words"), [(signal.SIGKILL, "ended"), (signal.SIGSTOP, "sign")])
def test_a_driver_that_crashes_or_hangs_takes_nothing_along_but_the_trial(
    impatient: UrCell, emulator: Admin, number: int, words: str
) -> None:
    robot = prepared(impatient)
    (process,) = (p for p in multiprocessing.active_children() if p.pid is not None)
    assert process.pid is not None
    pid = process.pid
    with (
        when_moving(HOST, lambda admin: os.kill(pid, number)),
        pytest.raises(RobotFault, match=words) as caught,
    ):
        go(robot, Formation.APPROACH)
    assert caught.value.kind == "driver"
    assert "the arm is halted" in str(caught.value)
    assert_at_rest(emulator)
    prepared(impatient)  # the next trial has a driver of its own


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Also in a background job, which Ctrl-C does not reach."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_during_a_motion_is_a_fault_like_any_other(cell: UrCell, emulator: Admin) -> None:
    robot = prepared(cell)
    with (
        when_moving(HOST, lambda admin: os.kill(os.getpid(), signal.SIGINT)) as happened,
        pytest.raises(RobotFault) as caught,
    ):
        go(robot, Formation.APPROACH)
    assert caught.value.kind == "interrupted"
    assert emulator.ask("state")["time_s"] - happened[0] < SEEN_WITHIN_S
    assert_at_rest(emulator)


def test_ctrl_c_while_somebody_thinks_ends_the_trial_too(cell: UrCell, emulator: Admin) -> None:
    with pytest.raises(RobotFault) as caught, prepared(cell):
        raise KeyboardInterrupt
    assert caught.value.kind == "interrupted"


def twice(do: Callable[[], None]) -> Callable[[Admin], None]:
    """As an impatient person does."""

    def done(admin: Admin) -> None:
        do()
        time.sleep(0.02)
        do()

    return done


def test_ctrl_c_at_the_terminal_leaves_what_was_done_and_an_arm_at_rest(
    emulator: Admin, tmp_path: Path
) -> None:
    emulator.ask("restore")
    file, out = tmp_path / "cell.yaml", tmp_path / "out"
    save(file, cell_at(HOST))
    pliant = Path(sys.executable).parent / "pliant"
    endless = ["--condition", "none", "--hole-y-mm", "20", "20", "--reasoner", "retry"]
    with Terminal([pliant, "run", "--cell", file, "--out", out, *endless]) as terminal:
        terminal.until("contact .*reached")
        with when_moving(HOST, twice(lambda: terminal.press("\x03"))):
            status, said = terminal.ended()
    assert status == 130, said
    (kept,) = (out / "aborted").iterdir()
    assert f"what was done of the trial is kept in '{kept}'" in said.replace("\r\n", "")
    trial = load_trial(kept)
    assert trial.end_reason == "fault:interrupted"
    assert len(trial.executions) >= 2
    assert trial.aborted is not None
    assert_at_rest(emulator)


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
@pytest.mark.parametrize("ask", [os.killpg, os.kill])
def test_who_asks_a_trial_to_end_gets_a_halt_by_the_driver_and_the_record(
    emulator: Admin, tmp_path: Path, name: str, ask: Callable[[int, int], None]
) -> None:
    emulator.ask("restore")
    file, out = tmp_path / "cell.yaml", tmp_path / "out"
    save(file, cell_at(HOST))
    pliant = Path(sys.executable).parent / "pliant"
    endless = ["--condition", "none", "--hole-y-mm", "20", "20", "--reasoner", "retry"]
    command: list[str | Path] = [pliant, "run", "--cell", file, "--out", out, *endless]
    trial = subprocess.Popen(
        command,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
    )
    number = getattr(signal, name)
    with when_moving(HOST, lambda admin: ask(trial.pid, number)) as happened:
        said, _ = trial.communicate(timeout=6 * HANGING_S)  # with its start
    assert trial.returncode == 128 + number, said
    assert emulator.ask("state")["time_s"] - happened[0] < SEEN_WITHIN_S
    assert_at_rest(emulator)
    (kept,) = (out / "aborted").iterdir()
    assert str(kept) in said
    assert load_trial(kept).end_reason == "fault:interrupted"
    assert_all_end(trial.pid)


def test_a_trials_process_that_is_killed_leaves_the_arm_at_rest(
    emulator: Admin, tmp_path: Path
) -> None:
    emulator.ask("restore")
    code = (
        "from test_ur5e_faults import *\n"
        "if __name__ == '__main__':\n"
        "    robot = prepared(UrCell(cell_at(HOST)))\n"
        "    go(robot, Formation.APPROACH)\n"
        "    go(robot, Formation.CONTACT)\n"
    )
    script = tmp_path / "killed.py"
    script.write_text(code, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    parent = subprocess.Popen([sys.executable, script], env=environment)
    with when_moving(HOST, lambda admin: parent.kill()):
        parent.wait()
    give_up = time.monotonic() + HANGING_S
    while emulator.ask("state")["program"] != "STOPPED" and time.monotonic() < give_up:
        time.sleep(0.05)
    assert_at_rest(emulator)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (Pose(y=0.09, z=0.41), "z 410.0 mm is outside the cell's workspace"),
        (Pose(y=0.05, z=0.3), "the controller's safety limits exclude"),
    ],
)
def test_a_pose_outside_the_limits_is_refused_before_anything_moves(
    boxed: Admin, pose: Pose, words: str
) -> None:
    with UrCell(cell_at(BOXED_HOST)) as cell:
        robot = prepared(cell)
        at = pose_of(boxed)
        with pytest.raises(RobotFault, match=words) as caught:
            robot.move_to(pose, speed_m_s=0.05, stop_at_compression_m=0.02)
        assert caught.value.kind == "safety_limits"
        boxed.grant(100)
        assert np.linalg.norm((pose_of(boxed) - at)[:3]) < 2e-4


def test_what_the_controllers_limits_exclude_is_found_before_a_trial(
    boxed: Admin, tmp_path: Path
) -> None:
    boxed.ask("restore")
    goals, file = tmp_path / "goals.yaml", tmp_path / "cell.yaml"
    save_goals(goals, shipped())
    goals.write_text(
        goals.read_text(encoding="utf-8").replace("z_mm: 213.6", "z_mm: 350.0"), encoding="utf-8"
    )
    save(file, cell_at(BOXED_HOST).model_copy(update={"goals": goals}))
    findings = {f.check: f for f in check(Where(file=file), load_task("circle"))}
    assert findings["goals"].state is CheckState.PASS  # in the cell's workspace
    limits = findings["safety limits"]
    assert limits.state is CheckState.FAIL
    assert "approach: the controller's safety limits exclude" in limits.found.splitlines()[0]
    assert all("z 350.0 mm" in line for line in limits.found.splitlines())
    state = boxed.ask("state")
    assert (state["safety_mode"], state["moving"]) == ("NORMAL", False)


def test_a_trial_that_a_fault_ends_is_recorded_up_to_it(cell: UrCell, emulator: Admin) -> None:
    task = load_task("circle")
    spec = Spec(task=task, condition=condition("none"), seed=1, reasoner="rules")

    def sabotage(execution: Execution, truth: Truth) -> None:
        if execution.formation is Formation.CONTACT:
            emulator.fault("protective_stop")

    trial = perform(spec, cell, shipped(), on_execution=sabotage)
    assert trial.end_reason == "fault:protective_stop"
    assert [e.formation for e in trial.executions] == [Formation.APPROACH, Formation.CONTACT]
    assert trial.aborted is not None
    assert trial.aborted.step.formation is Formation.FIT
    assert "by hand" in trial.fault
    again = perform(spec, cell, shipped())  # nobody has released the arm
    assert again.end_reason == "fault:protective_stop"
    assert again.executions == ()
