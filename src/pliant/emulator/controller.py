"""The controller: registers, motion, safety, and one `tick` of 2 ms that ties them to the plant."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

import numpy as np

from pliant.console import complain
from pliant.emulator.frames import Array, inverse
from pliant.emulator.gripper import EmulatedGripper
from pliant.emulator.motion import EmulatedMotion
from pliant.emulator.plant import TICK, Plant
from pliant.emulator.sensor import ForceSensor, SensorPayload
from pliant.errors import RobotFault
from pliant.ur5e.protocol import FREQUENCY, Mode, SafetyBits

REGISTERS = 48
UNLOCK_AFTER_S = 5.0  # a protective stop holds at least this long
_HARD_STOP = 10.0  # [rad/s2] of the fastest joint, when safety stops the arm
_PROGRAM_STOP = 4.0  # [rad/s2], when the program ends while the arm moves
_JOINT_SPEED_LIMIT = np.pi * 1.05  # [rad/s]
_JOINT_LIMIT = 2 * np.pi
_MOSTLY = 0.8  # of the watchdog: a client in good health has fed it by then
_HISTORY = 500  # ticks of joint positions


class Safety(IntEnum):
    """Safety modes as RTDE numbers them."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    ROBOT_EMERGENCY_STOP = 7

    @property
    def bits(self) -> SafetyBits:
        """The safety status bits."""
        if self is Safety.NORMAL:
            return SafetyBits.NORMAL
        if self is Safety.PROTECTIVE_STOP:
            return SafetyBits.PROTECTIVE_STOP | SafetyBits.STOPPED
        return SafetyBits.ROBOT_EMERGENCY_STOP | SafetyBits.EMERGENCY_STOP | SafetyBits.STOPPED


class Runtime(IntEnum):
    STOPPED = 1
    PLAYING = 2


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """The limits that the controller enforces by itself."""

    force: float = 150.0  # [N] external, beyond which it stops
    box: tuple[float, ...] | None = None  # (6,) [m] low x, y, z, high x, y, z; base frame


@dataclass(kw_only=True)
class Registers:
    """General-purpose registers, as clients and programs exchange them."""

    in_int: list[int] = field(default_factory=lambda: [0] * REGISTERS)
    in_double: list[float] = field(default_factory=lambda: [0.0] * REGISTERS)
    out_int: list[int] = field(default_factory=lambda: [0] * REGISTERS)
    out_double: list[float] = field(default_factory=lambda: [0.0] * REGISTERS)


class Running(Protocol):
    """A program that runs on the controller."""

    def cycle(self) -> bool:
        """Go on for one cycle; False: it has ended."""
        ...


class Controller:
    """An emulated controller: everything but the sockets. Call `tick` for every 2 ms, `idle` to
    answer without moving."""

    def __init__(self, plant: Plant, limits: SafetyLimits, noise: float = 0.0) -> None:
        self.plant, self.limits = plant, limits
        self.registers = Registers()
        self.sensor = ForceSensor(noise=noise)
        self.gripper = EmulatedGripper()
        self.tool = np.eye(4)  # the tool centre point on the flange
        self.speed_slider = 1.0
        self.digital_outputs = 0
        self.analog_outputs = [0.0, 0.0]
        self.safety, self.mode = Safety.NORMAL, Mode.RUNNING
        self.program: Running | None = None
        self.freedrive = False
        self.ticks = 0
        self.on_tick: list[Callable[[], None]] = []
        self.history: deque[Array] = deque(maxlen=_HISTORY)
        self._began_tick = 0  # of the present trial
        self._stopped_tick = 0  # of the last protective stop
        self._watchdog_ticks = 0.0  # 0: off
        self._fed_tick = 0
        self.q = plant.home  # commanded
        self.qd = np.zeros(6)
        self.motion = EmulatedMotion(self.q)
        self._read()

    # --- time ------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """The time stamp of everything it reports."""
        return self.ticks * TICK

    @property
    def trial_s(self) -> float:
        """Time since the trial was set up."""
        return (self.ticks - self._began_tick) * TICK

    def tick(self) -> None:
        """Advance by two milliseconds."""
        self.ticks += 1
        self._cycle()
        if self._watchdog_ticks and self.ticks - self._fed_tick > self._watchdog_ticks:
            self.end_program("the client's watchdog ran out")
        q = self._next()
        self.qd, self.q = (q - self.q) / TICK, q
        if np.abs(self.qd).max() > _JOINT_SPEED_LIMIT:
            self.protective_stop("a joint is faster than its limit, as near a singularity")
        self.plant.step(q)
        self.gripper.step(TICK)
        self._read()
        external = float(np.linalg.norm(self.sensor.external[:3]))
        if external > self.limits.force and self.safety is Safety.NORMAL:
            self.protective_stop(f"the force is {external:.0f} N, above {self.limits.force:.0f} N")
        for call in self.on_tick:
            call()

    def idle(self) -> None:
        """Answer commands while time stands still."""
        self._cycle()

    def _cycle(self) -> None:
        if self.program is not None and not self.program.cycle():
            self.end_program("")

    def _next(self) -> Array:
        try:
            q = self.motion.step(TICK, self.speed_slider)
            if not np.abs(q).max() > _JOINT_LIMIT:
                return q
            why = "a joint is at its limit"
        except RobotFault as fault:
            why = str(fault)
        self.motion = EmulatedMotion(self.q)
        self.protective_stop(why)
        return self.q

    def _read(self) -> None:
        self.sensor.read(self.plant.force, self.plant.torque, self.plant.flange[:3, :3])
        self.history.append(self.plant.q)

    # --- the trial -------------------------------------------------------------------------------

    def begin_trial(self) -> None:
        """Begin a trial for which the plant has been set up anew: hold its home, the peg in the
        gripper."""
        self.q = self.plant.home
        self.qd = np.zeros(6)
        self.motion = EmulatedMotion(self.q)
        self.gripper.grip()
        self._began_tick = self.ticks
        self._read()

    # --- programs --------------------------------------------------------------------------------

    @property
    def runtime(self) -> Runtime:
        return Runtime.STOPPED if self.program is None else Runtime.PLAYING

    def play(self, start: Callable[["Controller"], Running]) -> None:
        """Start a client's program, which `start` makes."""
        if self.safety is not Safety.NORMAL or self.mode is not Mode.RUNNING:
            note(self, f"a program was refused: the robot is {self.mode.name}, {self.safety.name}")
            return
        self.end_program("another program begins")
        self.program = start(self)

    def end_program(self, why: str) -> None:
        """End the program; the arm comes to rest."""
        if self.program is None:
            return
        if why:
            note(self, f"the program ends: {why}")
        self.program = None
        self.freedrive = False
        self._watchdog_ticks = 0.0
        self.motion.brake(_PROGRAM_STOP, joints=True)

    def watch(self, frequency: float) -> None:
        """End the program when a client's command register is written less often [Hz]."""
        self._watchdog_ticks = FREQUENCY / frequency if frequency > 0 else 0.0
        self._fed_tick = self.ticks

    @property
    def is_unfed(self) -> bool:
        """Whether most of a client's watchdog has run out."""
        unfed = self.ticks - self._fed_tick
        return unfed > _MOSTLY * self._watchdog_ticks > 0

    def fed(self) -> None:
        """Note that a client wrote its command register."""
        self._fed_tick = self.ticks

    # --- safety ----------------------------------------------------------------------------------

    def protective_stop(self, why: str) -> None:
        if self.safety is not Safety.NORMAL:
            return
        note(self, f"protective stop: {why}")
        self.safety, self._stopped_tick = Safety.PROTECTIVE_STOP, self.ticks
        self._stop_hard()

    def emergency_stop(self) -> None:
        note(self, "emergency stop")
        self.safety, self.mode = Safety.ROBOT_EMERGENCY_STOP, Mode.POWER_OFF
        self._stop_hard()

    def power_off(self) -> None:
        note(self, "power off")
        self.mode = Mode.POWER_OFF
        self._stop_hard()

    def power_on(self) -> None:
        if self.safety is not Safety.ROBOT_EMERGENCY_STOP and self.mode is Mode.POWER_OFF:
            self.mode = Mode.IDLE

    def release_brakes(self) -> None:
        if self.safety is not Safety.ROBOT_EMERGENCY_STOP:
            self.mode = Mode.RUNNING

    def unlock(self) -> str:
        """Release a protective stop, and return the dashboard's answer."""
        if self.safety is not Safety.PROTECTIVE_STOP:
            return "Protective stop releasing"  # as the dashboard says without one, too
        if (self.ticks - self._stopped_tick) * TICK < UNLOCK_AFTER_S:
            return (
                "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of"
                " protective stop before unlocking"
            )
        self.safety = Safety.NORMAL
        return "Protective stop releasing"

    def restore(self) -> None:
        """Do what a technician does after a fault: release, power on, brakes off. No program
        runs."""
        self.safety, self.mode = Safety.NORMAL, Mode.RUNNING

    def _stop_hard(self) -> None:
        self.end_program("safety")
        self.motion.brake(_HARD_STOP, joints=True)

    def within_limits(self, tool: Array, near: Array) -> bool:
        """Whether the tool's centre point may be at a transform: in the box and within reach."""
        if self.limits.box is not None:
            position, box = tool[:3, 3], np.array(self.limits.box)
            if np.any(position < box[:3]) or np.any(position > box[3:]):
                return False
        q = self.plant.solution(tool @ inverse(self.tool), near)
        return q is not None and self.joints_within_limits(q)

    def joints_within_limits(self, q: Array) -> bool:
        return bool(np.abs(q).max() <= _JOINT_LIMIT)

    # --- the tool --------------------------------------------------------------------------------

    def set_payload(
        self, mass: float, centre: tuple[float, float, float], inertia: tuple[float, ...]
    ) -> None:
        self.sensor.payload = SensorPayload(mass=mass, centre=centre, inertia=inertia)

    def tool_pose(self) -> Array:  # (4, 4)
        """The tool's centre point, measured."""
        return self.plant.flange @ self.tool

    def tool_target(self) -> Array:  # (4, 4)
        """The tool's centre point, commanded."""
        return self.plant.flange_of(self.q) @ self.tool


def note(controller: Controller, text: str) -> None:
    """Tell whoever watches the terminal."""
    complain(f"{controller.time_s:10.3f} s  {text}")
