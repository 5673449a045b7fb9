"""The arm through ur_rtde, with what that library does unasked made visible.

Use it in a process that can be thrown away, from one thread: ur_rtde is not thread-safe, and can
hang or crash (see below).
"""

import socket
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pliant.errors import InputError, RobotFault, installing
from pliant.ur5e.configuration import Configuration, Transform, transform, ur_pose
from pliant.ur5e.pace import Pace, Stalled, pace_of
from pliant.ur5e.protocol import CYCLE_S, FREQUENCY, RTDE_PORT, Mode, SafetyBits

_VARIABLES = [  # only these: all of them take half as much again of a core
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "robot_mode",
    "robot_status_bits",
    "runtime_state",
    "safety_status_bits",
    "target_speed_fraction",
]
_NORMAL = SafetyBits.NORMAL | SafetyBits.REDUCED
_EMERGENCY = (
    SafetyBits.SYSTEM_EMERGENCY_STOP | SafetyBits.ROBOT_EMERGENCY_STOP | SafetyBits.EMERGENCY_STOP
)
_OTHER = SafetyBits.VIOLATION | SafetyBits.FAULT | SafetyBits.STOPPED
_SAFETY = (  # bits, kind of fault, in words; the most serious first
    (_EMERGENCY, "emergency_stop", "the emergency stop is pressed"),
    (SafetyBits.PROTECTIVE_STOP, "protective_stop", "the arm is in a protective stop"),
    (SafetyBits.SAFEGUARD_STOP, "safeguard_stop", "the safeguard has stopped the arm"),
    (_OTHER, "protective_stop", "the arm is stopped for safety"),
)
_START_S = 0.5  # for an asynchronous motion to be seen to have begun
_WHY_S = 0.03  # for the cause of an ended program to arrive
_UNCHANGED = 8  # looks at one time stamp before its age counts: a machine under load sleeps long
_STILL_M_S, _STILL_RAD_S = 0.0005, 0.005
_REACHABLE_S = 2.0


class ArmClient:
    """The connected arm. Every call may raise RobotFault."""

    def __init__(self, configuration: Configuration) -> None:
        """Connect to the arm.

        Raises:
            InputError: ur_rtde is not installed, or the emulated cell's admin port does not answer.
        """
        try:
            from rtde_control import RTDEControlInterface
            from rtde_receive import RTDEReceiveInterface
        except ImportError as error:
            raise InputError(
                f"a UR5e cell needs the extra 'ur5e' ({error}): {installing('ur5e')}"
            ) from error
        address = configuration.arm.address
        self._configuration = configuration
        self._patience_s = configuration.patience.stamp_ms * 1e-3
        try:
            # ur_rtde would wait minutes for an address that nobody has.
            socket.create_connection((address, RTDE_PORT), _REACHABLE_S).close()
            self._receive: Any = RTDEReceiveInterface(address, float(FREQUENCY), _VARIABLES)
            self._check_state()  # else the next line waits for a program that cannot start
            self._control: Any = RTDEControlInterface(address, float(FREQUENCY))
            self.pace: Pace = pace_of(configuration, self._stamp_now)
        except (OSError, RuntimeError) as error:
            raise RobotFault(
                "connection", f"the controller at {address} cannot be used: {error}"
            ) from error
        self._stamp, self._seen_s, self._looks = self.time_s(), time.monotonic(), 0
        self._kicked_s = self._stamp
        self._is_watched = False

    # --- health ----------------------------------------------------------------------------------

    def check(self) -> None:
        """Check that the arm can go on, in this order: what comes later is not to be trusted when
        something earlier is wrong.

        Raises:
            RobotFault: "connection", "stalled", a stop's kind, "power_off", "program_stopped".
        """
        self._check_connection()
        self._check_stamp()
        self._check_state()
        if not self._control.isProgramRunning():
            # Why may arrive a moment later: it comes over the other connection.
            give_up = time.monotonic() + _WHY_S
            while time.monotonic() < give_up:
                self._check_state()
                time.sleep(CYCLE_S)
            raise RobotFault("program_stopped", "the control program on the controller has ended")

    def _check_connection(self) -> None:
        """Check that both interfaces are connected. After a disconnect getters return their last
        values. Either interface can be cut alone, and the other one goes on saying that it is
        connected."""
        if not (self._receive.isConnected() and self._control.isConnected()):
            raise RobotFault("connection", "the connection to the controller is lost")

    def _check_stamp(self) -> None:
        """Check that the time stamp advances. A controller that stalls stays connected; only the
        age of its time stamp tells. In lockstep the pace itself says when ticks do not come."""
        stamp, now = self._receive.getTimestamp(), time.monotonic()
        self._looks += 1
        if stamp != self._stamp or self.pace.is_lockstep:
            self._stamp, self._seen_s, self._looks = stamp, now, 0
        elif now - self._seen_s > self._patience_s and self._looks >= _UNCHANGED:
            self._stalled(now - self._seen_s)

    def _check_state(self) -> None:
        bits = self._receive.getSafetyStatusBits()
        for mask, kind, words in _SAFETY:
            if bits & mask:
                raise RobotFault(kind, f"{words}: inspect the cell, then release it by hand")
        mode = self._receive.getRobotMode()
        if mode != Mode.RUNNING:
            raise RobotFault("power_off", f"the arm is not running (robot mode {mode})")
        if not bits & _NORMAL:
            raise RobotFault("protective_stop", f"the safety status is not normal ({bits:#x})")

    def _stalled(self, age_s: float) -> None:
        raise RobotFault("stalled", f"the controller has sent nothing new for {age_s:.1f} s")

    # --- time ------------------------------------------------------------------------------------

    def look(self) -> None:
        """Wait for the next look; the watchdog is fed, the arm checked."""
        try:
            self.pace.look()
        except Stalled:
            self._check_connection()
            self._stalled(self._patience_s)
        except OSError as error:
            raise RobotFault("connection", f"the emulated cell is gone: {error}") from error
        self.check()
        self.feed()

    def feed(self) -> None:
        """Tell the controller's watchdog in time that somebody is there."""
        period_s = 1.0 / self._configuration.arm.watchdog_hz
        if self._is_watched and self.time_s() - self._kicked_s > 0.4 * period_s:
            self._kicked_s = self.time_s()
            self._control.kickWatchdog()

    def time_s(self) -> float:
        """The controller's time stamp [s]."""
        return float(self._receive.getTimestamp())

    def _stamp_now(self) -> float:
        """The time stamp for whoever waits for it to advance."""
        self._check_connection()
        return self.time_s()

    # --- measurements ----------------------------------------------------------------------------

    def pose(self) -> Transform:
        """The tool's centre point in base coordinates, measured."""
        return transform(self._receive.getActualTCPPose())

    def force(self) -> NDArray[np.float64]:
        """The force (3,) [N] of the surroundings on the tool, base axes."""
        return np.array(self._receive.getActualTCPForce()[:3])

    def is_still(self) -> bool:
        speed = np.array(self._receive.getActualTCPSpeed())
        linear, angular = np.linalg.norm(speed[:3]), np.linalg.norm(speed[3:])
        return bool(linear < _STILL_M_S and angular < _STILL_RAD_S)

    # --- commands --------------------------------------------------------------------------------

    def set_up(self) -> None:
        """Set tool, payload, speed slider and watchdog as the configuration has them."""
        configuration = self._configuration
        self.check()
        self._accepted(self._control.setTcp(configuration.tcp.pose), "the tool's centre point")
        self.set_payload()
        self._set_speed(configuration.arm.speed_fraction)
        watchdog_hz = configuration.arm.watchdog_hz
        self._accepted(self._control.setWatchdog(watchdog_hz), "the watchdog")
        self._is_watched, self._kicked_s = True, self.time_s()

    def set_payload(self, lighter_kg: float = 0.0) -> None:
        """Set the payload as the configuration has it, or lighter by so much."""
        self.check()
        payload = self._configuration.payload
        done = self._control.setPayload(payload.mass_kg - lighter_kg, payload.center_m)
        self._accepted(done, "the payload")

    def zero_force(self) -> None:
        self.check()
        self._accepted(self._control.zeroFtSensor(), "zeroing the force sensor")

    def permits(self, target: Transform) -> bool:
        """Whether the controller's own safety limits let the tool's centre point be there."""
        self.check()
        is_within = bool(self._control.isPoseWithinSafetyLimits(ur_pose(target)))
        if not is_within:
            self.check()  # False also says that the question was never answered
        return is_within

    def begin(self, target: Transform, speed_m_s: float, acceleration_m_s2: float) -> None:
        """Start a straight motion; returns when it is seen to have begun."""
        pose = ur_pose(target)
        if not self.permits(target):
            at = ", ".join(f"{1e3 * v:.0f}" for v in pose[:3])
            raise RobotFault(
                "safety_limits", f"the controller's safety limits exclude ({at}) mm of its base"
            )
        before = self._operation()
        self._accepted(self._control.moveL(pose, speed_m_s, acceleration_m_s2, True), "a motion")
        # Right after it was accepted, a motion can still read as finished: that is the one before.
        give_up = time.monotonic() + max(_START_S, self._patience_s)
        while self._operation() == before:
            self.check()
            if time.monotonic() > give_up:
                raise RobotFault("program_stopped", "the controller did not begin a motion")
            time.sleep(0.0005)

    def is_moving(self) -> bool:
        """Whether a motion or a stop is under way."""
        return bool(self._control.getAsyncOperationProgressEx().isAsyncOperationRunning())

    def stop(self) -> None:
        """Brake; returns at once. Asynchronous, because a `stopL` that waits runs `stopj` on the
        controller until an asynchronous stop has run."""
        if self._receive.isConnected() and self._control.isConnected():  # else it hangs
            self._control.stopL(self._configuration.arm.stop_mm_s2 * 1e-3, True)

    def freedrive(self, on: bool) -> None:
        """Give way to a hand, or hold the arm where it is."""
        self.check()
        done = self._control.freedriveMode() if on else self._control.endFreedriveMode()
        self._accepted(done, "freedrive")

    def disconnect(self) -> None:
        """Say goodbye to a controller in good health. ur_rtde hangs or crashes here after a lost
        connection: then let the process end instead."""
        self._control.stopScript()
        self._control.disconnect()
        self._receive.disconnect()

    def _operation(self) -> int:
        return int(self._control.getAsyncOperationProgressEx().operationId())

    def _set_speed(self, fraction: float) -> None:
        if abs(self._receive.getTargetSpeedFraction() - fraction) < 1e-3:
            return
        from rtde_io import RTDEIOInterface

        slider = RTDEIOInterface(self._configuration.arm.address)
        self._accepted(slider.setSpeedSlider(fraction), "the speed")
        slider.disconnect()

    def _accepted(self, done: bool, what: str) -> None:
        """Raise a fault if ur_rtde says no, by returning False: after a stop, or when its program
        has ended."""
        if not done:
            self.check()
            raise RobotFault("program_stopped", f"the controller refused {what}")
