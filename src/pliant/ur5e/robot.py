"""The method's side of the real cell (protocol `pliant.cell.Robot`): a driver and a camera."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Self, TypeVar

from pliant import signals
from pliant.cell import Motion, Observation, Stop, View, outside
from pliant.errors import RobotFault
from pliant.pose import Axis, Pose
from pliant.task import Task
from pliant.ur5e.camera import CameraDevice
from pliant.ur5e.configuration import Configuration
from pliant.ur5e.driver import Driver, Request
from pliant.ur5e.driver_process import ArmDriver
from pliant.ur5e.messages import ArmReading

T = TypeVar("T")


class UrRobot:
    """One trial's robot. Any fault halts the arm and is final: every later call raises it again,
    and nothing moves."""

    def __init__(
        self, configuration: Configuration, driver: Driver, camera: CameraDevice, task: Task
    ) -> None:
        self.configuration, self.task = configuration, task
        self._driver, self._camera = driver, camera
        self._fault: RobotFault | None = None
        self._origin_s = self._measure().time_s

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        """Halt. Ctrl-C while nothing was asked of the robot is the trial's end as well."""
        self.halt()
        if kind is KeyboardInterrupt:
            raise signals.interrupted() from error

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        """Move straight, at most as fast as the configuration allows where the peg may touch.

        Raises:
            RobotFault: "safety_limits" for a pose outside the workspace or the controller's limits,
                "not_reached" when it ended elsewhere, or what stopped it.
        """
        started = self._measure()
        self._check_workspace(pose)
        most_m = self.configuration.limits.compression_mm * 1e-3
        moved = self._ask(
            partial(
                ArmDriver.move,
                pose=pose,
                speed_m_s=min(speed_m_s, self._fastest(started.pose, pose)),
                stop_at_compression_m=min(stop_at_compression_m, most_m),
            )
        )
        return Motion(
            requested=pose,
            commanded=pose,
            ended=moved.ended.pose,
            stop=Stop.REACHED if moved.is_reached else Stop.COMPRESSION,
            peak_compression_m=moved.peak_compression_m,
            started_s=moved.started_s - self._origin_s,
            ended_s=moved.ended.time_s - self._origin_s,
            trace=replace(moved.trace, time_s=moved.trace.time_s - self._origin_s),
            answer=moved.answer,
        )

    def settle(self, seconds: float) -> None:
        self._ask(partial(ArmDriver.wait, seconds=seconds))

    def tare(self) -> None:
        self._ask(ArmDriver.tare)

    def clock(self) -> float:
        return self._measure().time_s - self._origin_s

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        """Pose and compression now, and pictures taken later than them."""
        at = self._measure()
        views = {name: self._guarded(partial(self._view, name, at)) for name in cameras}
        return Observation(
            time_s=at.time_s - self._origin_s,
            pose=at.pose,
            compression_m=at.compression_m,
            views=views,
            compression_sd_m=at.compression_sd_m,
        )

    def halt(self) -> None:
        self._driver.halt()

    def freedrive(self, on: bool) -> None:
        """Give way to a hand that leads the arm, or hold it where it is. The next motion, taring
        and a halt end it too."""
        self._ask(partial(ArmDriver.freedrive, on=on))

    def weigh(self, lighter_kg: float) -> float:
        """Measure by how much compression changes [m] while the controller believes that the tool
        is so much lighter. Nothing moves; the wrist must hang freely."""
        return self._ask(partial(ArmDriver.weigh, lighter_kg=lighter_kg))

    def permits(self, pose: Pose) -> bool:
        """Whether the controller's own safety limits let the hinge point be there."""
        return self._ask(partial(ArmDriver.permits, pose=pose))

    # --- inside ----------------------------------------------------------------------------------

    def _check_workspace(self, pose: Pose) -> None:
        workspace = self.configuration.workspace
        goal = {axis: pose[axis] for axis in Axis}
        problem = outside(workspace.low, workspace.high, goal, "the cell's workspace")
        if problem is not None:
            self.halt()
            raise self._kept(RobotFault("safety_limits", problem))

    def _fastest(self, start: Pose, end: Pose) -> float:
        """The highest speed [m/s], by whether the peg may touch the board on the way."""
        limits = self.configuration.limits
        free_z = self.task.tip_below_hinge + limits.free_above_mm * 1e-3
        is_free = min(start.z, end.z) >= free_z
        return (limits.speed_mm_s if is_free else limits.contact_speed_mm_s) * 1e-3

    def _view(self, name: str, at: ArmReading) -> View:
        if name != "side":
            raise RobotFault("camera", f"the cell has no camera '{name}': it has 'side'")
        return self._camera.view(at.time_s, self._origin_s)

    def _measure(self) -> ArmReading:
        return self._ask(ArmDriver.measure)

    def _ask(self, request: Request[T]) -> T:
        return self._guarded(lambda: self._driver.ask(request))

    def _guarded(self, call: Callable[[], T]) -> T:
        """Make a call, in which a fault is final, and Ctrl-C is one."""
        if self._fault is not None:
            raise self._fault
        try:
            return call()
        except RobotFault as fault:
            self.halt()
            raise self._kept(fault) from fault.__cause__
        except KeyboardInterrupt as error:
            self.halt()
            raise self._kept(signals.interrupted()) from error

    def _kept(self, fault: RobotFault) -> RobotFault:
        self._fault = fault
        return fault
