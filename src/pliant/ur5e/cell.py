"""The real cell as experiments hold it (protocol `pliant.cell.Workcell`).

On a real one an operator sets the scene and says afterwards how it went. On an emulated one the
experiment does both through the admin port; the method's side is the same.
"""

import contextlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol, Self

from pliant.cell import HOME_ABOVE_BOARD, Truth
from pliant.conditions import Setup
from pliant.errors import InputError, RobotFault
from pliant.network import open_directly
from pliant.pose import Pose
from pliant.task import Task, load_task, shipped_pegs
from pliant.ur5e import configuration as c
from pliant.ur5e.admin_port import AdminPort
from pliant.ur5e.camera import CameraDevice, open_camera
from pliant.ur5e.driver import Driver
from pliant.ur5e.driver_process import ArmDriver
from pliant.ur5e.robot import UrRobot

_HOME_SPEED = 0.05  # [m/s]
_FIRST_S = 30.0  # for an emulated camera's first picture
_SETTLE_S = 1.5  # the tool swings after a motion


class Operator(Protocol):
    """The person at a real cell. Each call returns when the person has answered.

    Raises:
        RobotFault: "interrupted": the person wants to stop.
    """

    def place(self, task: Task, setup: Setup) -> None:
        """Have hole and peg put where the setup says, the peg between the gripper's fingers."""
        ...

    def may_move(self, what: str) -> bool:
        """Whether the arm may now do what is described."""
        ...

    def truth(self) -> Truth:
        """The truth as the person sees it; `inserted` None: not labelled yet."""
        ...


class UrCell:
    """A workcell with a UR5e. It keeps the connection from trial to trial; after a fault the next
    trial makes a new one, which fails as long as a person has not released the arm."""

    def __init__(self, configuration: c.Configuration, operator: Operator | None = None) -> None:
        """Make a workcell. An emulated cell needs no operator.

        Raises:
            InputError: the cell is real and has no operator, or the emulator does not answer.
        """
        self.configuration = configuration
        self._operator = operator
        emulator, address = configuration.emulator, configuration.arm.address
        self._admin = None if emulator is None else AdminPort(address, emulator.admin_port)
        if self._admin is None and operator is None:
            raise InputError(
                "a real cell needs an operator; give the cell's file a section 'emulator' when it"
                " is an emulated one"
            )
        self._driver: Driver | None = None
        self._camera: CameraDevice | None = None
        self._peg = ""  # that the emulated camera has drawn

    @property
    def kind(self) -> str:
        return self.configuration.kind

    def prepare(self, task: Task, setup: Setup) -> UrRobot:
        """Have the scene set, the arm at home and at rest, compression tared.

        Raises:
            RobotFault: the cell cannot be used as it is.
            InputError: the emulated cell cannot show this task, or an extra is missing.
        """
        if self._admin is not None:
            self._set_up_emulator(self._admin, task, setup)
        driver, camera = self._connected(), self._seeing()
        if self._admin is None:
            assert self._operator is not None
            self._set_up_by_hand(driver, camera, self._operator, task, setup)
        driver.ask(partial(ArmDriver.set_up, holds=self.configuration.gripper is not None))
        driver.ask(ArmDriver.tare)
        return UrRobot(self.configuration, driver, camera, task)

    def truth(self) -> Truth:
        """The emulator's ground truth, or the operator's label."""
        if self._admin is not None:
            try:
                return self._admin.truth()
            except OSError as error:
                raise InputError(f"the emulator does not answer: {error}") from error
        assert self._operator is not None
        return self._operator.truth()

    def close(self) -> None:
        """Halt and disconnect."""
        for part in (self._driver, self._camera, self._admin):
            if part is not None:
                part.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- inside ----------------------------------------------------------------------------------

    def _connected(self) -> Driver:
        if self._driver is None or not self._driver.is_usable:
            if self._driver is not None:
                self._driver.close()
            self._driver = Driver(self.configuration)
            self._driver.connect()
        return self._driver

    def _seeing(self) -> CameraDevice:
        if self._camera is None or not self._camera.is_usable:
            if self._camera is not None:
                self._camera.close()
            patience_s = self.configuration.patience.picture_ms * 1e-3
            self._camera = open_camera(self.configuration.camera, patience_s)
        return self._camera

    def _set_up_by_hand(
        self, driver: Driver, camera: CameraDevice, person: Operator, task: Task, setup: Setup
    ) -> None:
        """Set up a real cell: the arm goes home, the person sets the scene, the fingers close on
        the peg: nothing moves before the person has agreed."""
        driver.ask(partial(ArmDriver.set_up, holds=False))
        self._go_home(UrRobot(self.configuration, driver, camera, task), person)
        if self.configuration.gripper is None:
            person.place(task, setup)
            return
        if person.may_move("open the gripper: hold the peg"):
            driver.ask(partial(ArmDriver.fingers, close=False))
        person.place(task, setup)
        if person.may_move("close the gripper on the peg: hands off"):
            driver.ask(partial(ArmDriver.fingers, close=True))

    def _go_home(self, robot: UrRobot, person: Operator) -> None:
        """Go home: straight up, then across."""
        home = Pose(z=robot.task.tip_below_hinge + HOME_ABOVE_BOARD)
        here = robot.observe(cameras=()).pose
        if not person.may_move("lift the peg straight up and go to the start above the hole"):
            raise RobotFault("interrupted", "the operator did not let the arm go to its start")
        limit = self.configuration.limits.compression_mm * 1e-3
        for pose in (replace(here, z=home.z), home):
            motion = robot.move_to(pose, speed_m_s=_HOME_SPEED, stop_at_compression_m=limit)
            if motion.stop.is_early:
                robot.halt()
                raise RobotFault(
                    "not_reached",
                    "the wrist is pressed on the way to the start: free the peg by hand",
                )
        robot.settle(_SETTLE_S)

    def _set_up_emulator(self, admin: AdminPort, task: Task, setup: Setup) -> None:
        peg = task.peg.name
        if peg not in shipped_pegs() or task != load_task(peg):
            raise InputError(
                f"the emulated cell has the shipped pegs only ({', '.join(shipped_pegs())}) and"
                f" their own holes, not '{peg}' with {task.hole.clearance * 1e3:g} mm of play and"
                f" {task.depth * 1e3:g} mm to go"
            )
        try:
            admin.set_up(setup, peg)
        except OSError as error:
            raise RobotFault("connection", f"the emulator does not answer: {error}") from error
        if peg != self._peg and self.configuration.camera.source is c.CameraSource.HTTP:
            self._peg = peg
            with contextlib.suppress(OSError):  # a broken camera is for the trial to find
                # The emulator's first picture of a peg takes longer than a camera may.
                open_directly(self.configuration.camera.where, _FIRST_S).read()


def open_cell(path: Path, operator: Operator | None = None) -> UrCell:
    """The cell that a file describes.

    Raises:
        InputError: the file cannot be used, or as for `UrCell`.
    """
    return UrCell(c.load(path), operator)
