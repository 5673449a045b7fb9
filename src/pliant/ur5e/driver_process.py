"""The process that owns the arm: it looks at it every 2 ms, and stops it when something is wrong.

It does one request at a time and says that it is alive while it does. After any fault it halts the
arm, says which fault it was, and ends without cleaning up: ur_rtde 1.6.5, once its connection was
cut, uploads its program again and again until it crashes.
"""

import contextlib
import math
import os
import time
from multiprocessing.connection import Connection

import numpy as np

from pliant import signals
from pliant.cell import Samples, missed
from pliant.errors import InputError, RobotFault
from pliant.pose import Pose, pose_from
from pliant.ur5e import dashboard
from pliant.ur5e import messages as m
from pliant.ur5e.arm import ArmClient
from pliant.ur5e.compression import Compression
from pliant.ur5e.configuration import Configuration, Transform, placed
from pliant.ur5e.gripper import GripperClient
from pliant.ur5e.protocol import CYCLE_S
from pliant.wrist import Watch, Way, is_straight, toward_tip

_ALIVE_S = 0.05
_IDLE_S = 0.005
_TARE_S = 0.4
_WEIGH_S = 1.0
_LATENCY_S = 0.015  # from the force to the first braking, measured; five times the protocol's share
_SAMPLE_S = 0.05
_REST_S = 0.5  # from the end of a motion, or from a stop, until the arm is still
_NEAR_M, _NEAR_RAD = 0.002, math.radians(1.0)  # of a pose that counts as reached
_HEARS = (  # faults after which it does
    *("compression", "sensor", "loaded"),
    *("gripper", "interrupted", "not_reached", "safety_limits"),
)


def serve(pipe: Connection, configuration: Configuration) -> None:
    """Do requests until the other side says goodbye or is gone."""
    signals.ignore()  # they are for the trial, which has the arm halted here
    driver = ArmDriver(pipe, configuration)
    _say(pipe, m.Word.ALIVE)  # Python and the libraries have taken their time
    try:
        driver.serve()
    except RobotFault as fault:
        driver.give_up(fault)
        _say(pipe, m.Failed(kind=fault.kind, message=str(fault)))
    except InputError as error:
        _say(pipe, m.Failed(kind="", message=str(error)))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        driver.give_up(RobotFault("interrupted", "the trial's process is gone"))
    os._exit(0)  # without ur_rtde's destructors


def _say(pipe: Connection, message: object) -> None:
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        pipe.send(message)


class ArmDriver:
    """The arm's driver. Its requests may raise RobotFault, which ends it."""

    def __init__(self, pipe: Connection, configuration: Configuration) -> None:
        self._pipe, self._configuration = pipe, configuration
        self._base_of_task = configuration.task_frame.transform
        self._task_of_base = np.linalg.inv(self._base_of_task)
        self._compression = Compression(configuration)
        self._wrist = Watch(configuration.limits.compression_mm * 1e-3)
        self._is_tared = False
        self._hangs_m = 0.0  # when last tared, from where it hung at first
        self._arm: ArmClient | None = None
        self._gripper: GripperClient | None = None
        self._said_s = 0.0
        self._is_guided = False

    def serve(self) -> None:
        while True:
            while not self._pipe.poll(_IDLE_S):
                self._watch()
            request = self._pipe.recv()
            self._said_s = time.monotonic()
            if request is m.Word.CLOSE:
                if self._arm is not None:
                    self._come_to_rest()
                    self._arm.disconnect()
                return
            if isinstance(request, m.Interrupt):
                raise RobotFault("interrupted", request.why)
            self._pipe.send(m.Done(result=request(self)))

    def give_up(self, fault: RobotFault) -> None:
        """Halt the arm, whatever it takes, and let its program end: nothing moves it any more."""
        if self._arm is not None and fault.kind in _HEARS:
            self._arm.stop()  # gentler than what follows
        configuration = self._configuration
        dashboard.stop(configuration.arm.address, configuration.patience.dashboard_ms * 1e-3)

    # --- requests --------------------------------------------------------------------------------

    def connect(self) -> None:
        """Reach the controller and the gripper."""
        configuration = self._configuration
        self._arm = ArmClient(configuration)
        if configuration.gripper is not None:
            patience_s = configuration.patience.gripper_ms * 1e-3
            self._gripper = GripperClient(
                configuration.gripper, configuration.arm.address, patience_s, self.wait
            )

    def set_up(self, holds: bool) -> None:
        """Set up tool, payload, watchdog; `holds`: the peg must be in the gripper, and stay
        there."""
        self._is_tared = False
        self._here.set_up()
        if self._gripper is not None:
            self._gripper.watch(holds)

    def tare(self) -> None:
        """Count compression from here, at rest in free hang."""
        self.freedrive(False)
        self._come_to_rest()
        if self._is_tared:
            self._hangs_m += self._compression.mean
        else:
            self._wrist.forget()
            self._hangs_m = 0.0
        self._wrist.tare(self._hangs_m)
        self._is_tared = False  # what is read until it is done means nothing
        self._here.zero_force()
        readings = []
        until = self._here.time_s() + _TARE_S
        while self._here.time_s() < until:
            self._look()
            readings.append(self._compression.latest)
        self._compression.tare(np.array(readings), _TARE_S / len(readings))
        self._is_tared = True

    def permits(self, pose: Pose) -> bool:
        """Whether the controller's own safety limits let the arm be there."""
        return self._here.permits(self._base_of(pose))

    def weigh(self, lighter_kg: float) -> float:
        """Measure by how much compression changes [m] while the controller believes in a lighter
        payload [kg]: the weight that it no longer makes up for stretches the wrist."""
        self.freedrive(False)
        self._come_to_rest()
        before = self._mean()
        self._here.set_payload(lighter_kg)
        try:
            self.wait(_WEIGH_S)
            return self._mean() - before
        finally:
            self._here.set_payload()
            self.wait(_WEIGH_S)

    def _mean(self) -> float:
        readings = []
        until = self._here.time_s() + _WEIGH_S
        while self._here.time_s() < until:
            self._look()
            readings.append(self._compression.latest)
        return float(np.mean(readings))

    def wait(self, seconds: float) -> None:
        """Wait on the controller's clock."""
        until = self._here.time_s() + seconds
        while self._here.time_s() < until - CYCLE_S / 2:
            self._look()

    def fingers(self, close: bool) -> None:
        """Close on a peg, or open."""
        if self._gripper is None:
            return
        if close:
            self._gripper.close_on_peg()
        else:
            self._gripper.release()

    def freedrive(self, on: bool) -> None:
        """Give way to a hand, or hold the arm where it is."""
        if on is not self._is_guided:
            self._here.freedrive(on)
            self._is_guided = on
            if not on:
                self._come_to_rest()

    def halt(self) -> None:
        """Brake."""
        self.freedrive(False)
        self._come_to_rest()

    # --- motion ----------------------------------------------------------------------------------

    def move(self, pose: Pose, speed_m_s: float, stop_at_compression_m: float) -> m.Moved:
        """Move straight to a pose, at most until the wrist is pressed to the limit."""
        arm, settings, compression = self._here, self._configuration.arm, self._compression
        stop_m_s2 = settings.stop_mm_s2 * 1e-3
        self.freedrive(False)
        target = self._base_of(pose)
        earlier = compression.allowance(speed_m_s, stop_m_s2, _LATENCY_S)
        started = self.measure()
        samples = _PeakSamples()
        samples.read(started, compression.now)
        toward = toward_tip(started.pose, pose)
        way = None
        if is_straight(started.pose, pose):
            way = Way(arm.pose()[:3, 3], -target[:3, 2])
        is_reached = self._wrist.begin(compression.now, toward, stop_at_compression_m, way)
        if is_reached:
            arm.begin(target, speed_m_s, min(speed_m_s / settings.ramp_s, stop_m_s2))
        else:
            self._look()
        while arm.is_moving():
            self._look()
            samples.read_if_due(self._now(), compression.now)
            if is_reached and self._wrist.ends(compression.now, compression.margin, earlier):
                is_reached = False
                arm.stop()
        self._wrist.rest()
        self._come_to_rest(samples)
        ended = self.measure()
        samples.read(ended, compression.now)
        if is_reached:
            self._verify(target)
        return m.Moved(
            is_reached=is_reached,
            peak_compression_m=samples.peak_m,
            started_s=started.time_s,
            ended=ended,
            trace=samples.trace(),
            answer=self._wrist.answer(),
        )

    def _come_to_rest(self, samples: "_PeakSamples | None" = None) -> None:
        """Brake what moves and wait until the arm is still."""
        arm = self._here
        if arm.is_moving():
            arm.stop()
        give_up = arm.time_s() + _REST_S
        while arm.is_moving() or not arm.is_still():
            self._look()
            if samples is not None:
                samples.read_if_due(self._now(), self._compression.now)
            if arm.time_s() > give_up:
                raise RobotFault("not_reached", "the arm does not come to rest")

    def _verify(self, target: Transform) -> None:
        """Check that a motion reached its target: one that was ended by something else also reads
        as finished."""
        there = self._here.pose()
        off = float(np.linalg.norm(there[:3, 3] - target[:3, 3]))
        cosine = (float(np.trace(there[:3, :3].T @ target[:3, :3])) - 1.0) / 2.0
        turn = math.acos(max(-1.0, min(1.0, cosine)))
        if off > _NEAR_M or turn > _NEAR_RAD:
            raise RobotFault("not_reached", missed(off, turn))

    # --- looking ---------------------------------------------------------------------------------

    def _look(self) -> None:
        """Take the next look at everything; whoever waits hears that there is somebody."""
        self._here.look()
        self._read()
        now = time.monotonic()
        if now - self._said_s > _ALIVE_S:
            self._said_s = now
            self._pipe.send(m.Word.ALIVE)
        if self._pipe.poll():
            said = self._pipe.recv()
            why = said.why if isinstance(said, m.Interrupt) else ""
            raise RobotFault("interrupted", why or "halted")

    def _watch(self) -> None:
        """Look between requests: the same, at no particular time."""
        if self._arm is not None:
            self._arm.check()
            self._arm.feed()
            self._read()

    def _read(self) -> None:
        arm = self._here
        pose = arm.pose()
        self._compression.read(arm.time_s(), arm.force(), pose[:3, :3])
        if self._is_tared:
            self._wrist.read(self._compression.reading(self._wrist.along(pose[:3, 3])))
        if self._gripper is not None:
            self._gripper.poll()

    def _now(self) -> m.ArmReading:
        pose = self._task_of_base @ self._here.pose()
        return m.ArmReading(
            time_s=self._here.time_s(),
            pose=pose_from(pose[:3, 3], pose[:3, :3]),
            compression_m=self._compression.mean,
            compression_sd_m=self._compression.mean_sd,
        )

    def _base_of(self, pose: Pose) -> Transform:
        """A pose of the task frame, in base coordinates."""
        return self._base_of_task @ placed(pose.position(), pose.rotation())

    def measure(self) -> m.ArmReading:
        """Measure where the arm is now."""
        self._here.check()
        self._read()
        return self._now()

    @property
    def _here(self) -> ArmClient:
        if self._arm is None:
            raise RobotFault("connection", "the arm is not connected")
        return self._arm


class _PeakSamples(Samples):
    """Samples of a motion, and the highest compression of all looks."""

    peak_m = -math.inf

    def read(self, at: m.ArmReading, compression_m: float) -> None:
        self.peak_m = max(self.peak_m, compression_m)
        self.take(at.time_s, at.pose, compression_m)

    def read_if_due(self, at: m.ArmReading, compression_m: float) -> None:
        self.peak_m = max(self.peak_m, compression_m)
        if at.time_s >= self.times_s[-1] + _SAMPLE_S - CYCLE_S / 2:
            self.read(at, compression_m)
