"""The emulated controller moves, feels and stops as a real one's client expects, tick by tick."""

import asyncio
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pliant.conditions import Setup
from pliant.emulator import faults, frames
from pliant.emulator.controller import Controller, Runtime, Safety, SafetyLimits
from pliant.emulator.frames import Array
from pliant.emulator.pace import EmulatorPace
from pliant.emulator.plant import Plant, nominal_payload
from pliant.emulator.program import Program
from pliant.errors import InputError
from pliant.sim.arm import rotation
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.ur5e.protocol import Mode, Pacing

MOVE_L, MOVE_J, ZERO_FT, PAYLOAD, SET_TCP = 3, 1, 8, 17, 29
STOP_L, WATCHDOG, SAFE_POSE, INVERSE, FREEDRIVE, FREEDRIVE_STATUS, FORCE_MODE = (
    33,
    35,
    36,
    46,
    52,
    54,
    6,
)
TASK = load_task("circle")
PLANT = Plant(TASK, Setup(seed=0))
PAYLOAD_OF_TASK = nominal_payload(TASK)


class Client:
    """Writes registers and ticks, as a client does over the wire."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.registers = controller.registers

    def begin(self, command: int, *values: float, flag: int = 0) -> None:
        self.registers.in_double[: len(values)] = list(values)
        self.registers.in_int[1] = flag
        self.registers.in_int[0] = command
        self.controller.fed()

    def call(self, command: int, *values: float, flag: int = 0) -> bool:
        """Perform a command; False: it was never done."""
        self.begin(command, *values, flag=flag)
        done = self.until(lambda: self.registers.out_int[0] == 2)
        self.registers.in_int[0] = 0
        ready = self.until(lambda: self.registers.out_int[0] == 1)
        return done and ready

    def until(self, condition: Callable[[], bool], ticks: int = 10_000) -> bool:
        for _ in range(ticks):
            self.controller.tick()
            if self.controller.runtime is Runtime.STOPPED:
                return False
            if condition():
                return True
        raise AssertionError("it never happened")

    def rest(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.002)):
            self.controller.tick()

    def pose(self) -> Array:
        return np.array(frames.pose(self.controller.tool_pose()))

    def target(self) -> Array:
        return np.array(frames.pose(self.controller.tool_target()))

    def force(self) -> Array:  # (3,)
        return self.controller.sensor.reported[:3]

    def operation(self) -> tuple[int, bool]:
        """Number of the asynchronous operation, and whether it runs."""
        word = self.registers.out_int[2]
        return word >> 24 & 127, bool(word >> 15 & 1)


@pytest.fixture
def client() -> Client:
    """A playing controller, tool and payload set, tared, at home."""
    PLANT.prepare(TASK, Setup(seed=0))
    client = Client(Controller(PLANT, SafetyLimits()))
    client.controller.play(Program)
    client.call(SET_TCP, *frames.pose(PLANT.hinge_on_flange))
    client.call(PAYLOAD, PAYLOAD_OF_TASK.mass, *PAYLOAD_OF_TASK.centre)
    client.call(ZERO_FT)
    return client


def test_a_straight_move_ends_within_a_millimetre_and_stays_on_its_line(client: Client) -> None:
    start, end = client.target(), client.target() + [0.0, 0.05, -0.02, 0.0, 0.0, 0.0]
    along = (end - start)[:3] / np.linalg.norm((end - start)[:3])
    client.begin(MOVE_L, *end, 0.1, 0.5)
    while client.registers.out_int[0] != 2:
        client.controller.tick()
        offset = (client.target() - start)[:3]
        assert np.linalg.norm(offset - along * (offset @ along)) < 1e-6
    np.testing.assert_allclose(client.target()[:3], end[:3], atol=1e-6)
    client.rest(0.3)
    assert np.linalg.norm((client.pose() - end)[:3]) < 1e-3


def test_a_move_takes_the_time_that_speed_and_acceleration_say(client: Client) -> None:
    end = client.target() + [0.0, 0.06, 0.0, 0.0, 0.0, 0.0]
    began = client.controller.time_s
    assert client.call(MOVE_L, *end, 0.1, 0.5)
    assert client.controller.time_s - began == pytest.approx(0.06 / 0.1 + 0.1 / 0.5, abs=0.02)


def test_the_speed_slider_slows_a_move(client: Client) -> None:
    client.controller.speed_slider = 0.5
    end = client.target() + [0.0, 0.06, 0.0, 0.0, 0.0, 0.0]
    began = client.controller.time_s
    assert client.call(MOVE_L, *end, 0.1, 0.5)
    assert client.controller.time_s - began == pytest.approx(0.06 / 0.05 + 0.05 / 0.5, abs=0.02)


def test_an_asynchronous_move_is_numbered_and_can_be_stopped(client: Client) -> None:
    before, _ = client.operation()
    end = client.target() + [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    assert client.call(MOVE_L, *end, 0.1, 0.5, flag=1)
    assert client.operation() == (before + 1, True)
    client.rest(0.5)
    at = client.target()[1]
    assert client.call(STOP_L, 2.0, flag=1)
    assert client.until(lambda: not client.operation()[1])
    assert client.operation() == (before + 2, False)  # the stop counts as one
    stopped = client.target()[1]
    assert stopped - at < 0.1 * 0.006 + 0.1**2 / (2 * 2.0)
    client.rest(0.2)
    assert client.target()[1] == stopped


def test_pressing_on_the_board_shows_as_a_force_up_of_the_wrists_stiffness(
    client: Client,
) -> None:
    beside = client.target() + [0.0, 0.03, 0.0, 0.0, 0.0, 0.0]  # of the hole
    client.call(MOVE_L, *beside, 0.1, 0.5)
    client.rest(3.0)  # until the tool has swung out
    assert np.linalg.norm(client.force()) < 0.1
    down = beside - [0.0, 0.0, 0.065, 0.0, 0.0, 0.0]
    client.call(MOVE_L, *down, 0.02, 0.2)
    client.rest(0.5)
    compression = PLANT.truth().compression_m
    assert compression > 0.003
    assert client.force()[2] == pytest.approx(TASK.wrist.stiffness_z * compression, rel=0.03)


def test_the_payload_is_compensated_at_any_tilt(client: Client) -> None:
    tilt = frames.transform([*client.target()])
    tilt[:3, :3] = rotation(np.array([math.radians(15), 0.0, 0.0])) @ tilt[:3, :3]
    assert client.call(MOVE_L, *frames.pose(tilt), 0.1, 0.5)
    client.rest(1.5)
    assert np.linalg.norm(client.force()) < 0.05
    client.call(PAYLOAD, 0.0, 0.0, 0.0, 0.1)
    client.rest(0.1)
    assert client.force()[2] == pytest.approx(-PAYLOAD_OF_TASK.mass * 9.81, abs=0.1)


def test_the_arm_rests_within_a_tenth_of_a_second_after_a_protective_stop(client: Client) -> None:
    end = client.target() + [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    client.call(MOVE_L, *end, 0.1, 0.5, flag=1)
    client.rest(0.5)
    client.controller.protective_stop("test")
    client.rest(0.1)
    at = client.pose()
    client.rest(0.5)
    assert np.linalg.norm((client.pose() - at)[:3]) < 1e-4
    assert client.controller.runtime is Runtime.STOPPED
    client.controller.play(Program)
    assert client.controller.runtime is Runtime.STOPPED  # nothing plays before it is unlocked


def test_a_protective_stop_holds_five_seconds(client: Client) -> None:
    client.controller.protective_stop("test")
    assert client.controller.unlock().startswith("Cannot unlock")
    client.rest(5.0)
    assert client.controller.unlock() == "Protective stop releasing"
    assert client.controller.safety is Safety.NORMAL


def test_an_emergency_stop_takes_power_and_brakes_to_undo(client: Client) -> None:
    client.controller.emergency_stop()
    client.controller.power_on()
    client.controller.release_brakes()
    assert client.controller.mode is Mode.POWER_OFF
    client.controller.restore()
    client.controller.play(Program)
    assert client.controller.runtime is Runtime.PLAYING


def test_too_strong_a_push_stops_the_arm(client: Client) -> None:
    controller = client.controller
    controller.limits = SafetyLimits(force=5.0)
    beside = client.target() + [0.0, 0.03, 0.0, 0.0, 0.0, 0.0]
    client.call(MOVE_L, *beside, 0.1, 0.5)
    assert not client.call(MOVE_L, *(beside - [0.0, 0.0, 0.08, 0.0, 0.0, 0.0]), 0.02, 0.2)
    assert controller.safety is Safety.PROTECTIVE_STOP


def test_a_client_that_falls_silent_loses_its_program(client: Client) -> None:
    assert client.call(WATCHDOG, 10.0)
    end = client.target() + [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    client.call(MOVE_L, *end, 0.05, 0.5, flag=1)
    client.rest(0.2)
    assert client.controller.runtime is Runtime.STOPPED
    client.rest(0.5)
    assert client.target()[1] < end[1] - 0.05


def test_a_pose_out_of_reach_ends_the_program_and_is_not_safe(client: Client) -> None:
    far = [2.0, 0.0, 0.3, math.pi, 0.0, 0.0]
    assert client.call(SAFE_POSE, *client.target())
    assert client.registers.out_int[1] == 1
    assert client.call(SAFE_POSE, *far)
    assert client.registers.out_int[1] == 0
    assert not client.call(MOVE_L, *far, 0.1, 0.5)
    assert client.controller.safety is Safety.NORMAL


def test_a_pose_outside_the_box_is_not_safe(client: Client) -> None:
    x, y, z = client.target()[:3]
    client.controller.limits = SafetyLimits(box=(x - 0.1, y - 0.1, z, x + 0.1, y + 0.1, 1.0))
    for dz, safe in ((0.01, 1), (-0.01, 0)):
        client.call(SAFE_POSE, *(client.target() + [0.0, 0.0, dz, 0.0, 0.0, 0.0]))
        assert client.registers.out_int[1] == safe


def test_what_is_not_emulated_ends_the_program_at_once(
    client: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    client.begin(FORCE_MODE)
    client.controller.tick()
    assert client.controller.runtime is Runtime.STOPPED
    assert "command 6 of the control script is not emulated" in capsys.readouterr().err


def test_inverse_and_forward_kinematics_agree(client: Client) -> None:
    aim = client.target() + [0.03, -0.02, -0.01, 0.0, 0.0, 0.0]
    assert client.call(INVERSE, *aim)
    q = np.array(client.registers.out_double[:6])
    assert client.call(MOVE_J, *q, 1.0, 2.0)
    np.testing.assert_allclose(client.target()[:3], aim[:3], atol=1e-6)


def test_a_new_trial_is_the_one_that_the_simulated_cell_prepares(client: Client) -> None:
    setup = Setup(seed=0, friction=3.0, hole_y=-0.012, grasp_roll=0.05)
    PLANT.prepare(TASK, setup)
    client.controller.begin_trial()
    cell = SimCell()
    cell.prepare(TASK, setup)
    mine, its = PLANT.truth(), cell.truth()
    assert mine.hole_y == its.hole_y
    np.testing.assert_allclose(mine.tip, its.tip, atol=1e-9)
    client.rest(0.2)
    np.testing.assert_allclose(PLANT.truth().tip, its.tip, atol=1e-4)  # it hangs still


def test_the_clock_stands_still_without_credit_and_commands_are_answered() -> None:
    PLANT.prepare(TASK, Setup(seed=0))
    controller = Controller(PLANT, SafetyLimits())
    controller.play(Program)
    published: list[float] = []
    pace = EmulatorPace(controller, lambda always: published.append(controller.time_s))
    pace.set(Pacing.LOCKSTEP, 1.0)

    async def scene() -> None:
        running = asyncio.create_task(pace.run())
        controller.registers.in_int[0] = ZERO_FT
        pace.wake()
        while controller.registers.out_int[0] != 2:
            await asyncio.sleep(0.001)
        assert controller.ticks == 0
        await pace.grant(7)
        assert controller.ticks == 7
        await pace.grant(60)
        assert controller.ticks == 67
        running.cancel()

    asyncio.run(scene())
    assert published[0] == 0.0
    assert published[-1] == pytest.approx(67 * 0.002)


def test_time_slips_and_is_never_made_up_for() -> None:
    PLANT.prepare(TASK, Setup(seed=0))
    controller = Controller(PLANT, SafetyLimits())
    pace = EmulatorPace(controller, lambda always: None)

    async def scene() -> int:
        running = asyncio.create_task(pace.run())
        await asyncio.sleep(0.02)
        pace.stall(0.5)
        await asyncio.sleep(0.02)
        before = controller.ticks
        await asyncio.sleep(0.5)
        running.cancel()
        return controller.ticks - before

    assert asyncio.run(scene()) < 100


def test_time_stands_still_for_a_while_when_a_client_is_late() -> None:
    PLANT.prepare(TASK, Setup(seed=0))
    controller = Controller(PLANT, SafetyLimits())
    pace = EmulatorPace(controller, lambda always: None, client_patience_s=0.5)
    controller.watch(50.0)  # 10 ticks

    async def scene() -> None:
        running = asyncio.create_task(pace.run())
        await asyncio.sleep(0.3)
        assert controller.ticks == 9
        controller.fed()
        await asyncio.sleep(0.3)
        assert controller.ticks == 18
        give_up = time.monotonic() + 20.0
        while controller.ticks == 18 and time.monotonic() < give_up:
            await asyncio.sleep(0.01)
        running.cancel()

    asyncio.run(scene())
    assert controller.ticks > 18  # its patience is over


def test_freedrive_is_off_until_asked_for(client: Client) -> None:
    assert client.call(FREEDRIVE_STATUS)
    assert client.registers.out_int[1] == 0
    assert client.call(FREEDRIVE)
    assert client.call(FREEDRIVE_STATUS)
    assert client.registers.out_int[1] == 1


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("- {at_s: 1, kind: earthquake}", "earthquake"),
        ("- {at_s: -1, kind: power_off}", "at_s is -1"),
        ("- {kind: power_off}", "at_s is None"),
        ("- {at_s: 1, kind: stall}", "seconds"),
        ("kind: stall", "must be a list"),
        ("- [", "is not YAML"),
    ],
)
def test_a_fault_file_that_cannot_be_used_says_why(
    tmp_path: Path, text: str, complaint: str
) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=complaint) as caught:
        faults.load(path)
    assert "\n" not in str(caught.value)


def test_faults_come_in_the_order_of_their_times(tmp_path: Path) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(
        "- {at_s: 2, kind: power_off}\n- {at_s: 1, kind: stall, seconds: 0.5}\n", encoding="utf-8"
    )
    assert [(at, fault.kind) for at, fault in faults.load(path)] == [
        (1.0, "stall"),
        (2.0, "power_off"),
    ]
