"""One emulated cell: the plant, its controller, the pace, and what the experiment may do with
them."""

import asyncio
import ipaddress
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pliant.conditions import Setup
from pliant.emulator import faults, frames
from pliant.emulator.block import Block, CameraFault
from pliant.emulator.controller import Controller, SafetyLimits, note
from pliant.emulator.motion import ToolLine, Travel
from pliant.emulator.pace import MOST_SPEED, EmulatorPace
from pliant.emulator.plant import Plant, nominal_payload
from pliant.emulator.rtde import Rtde
from pliant.errors import InputError
from pliant.sim import constants as c
from pliant.task import Task, load_task
from pliant.ur5e.protocol import ADMIN_PORT, CAMERA_PORT, FREQUENCY, Pacing

_GUIDED_ACCELERATION = 0.5  # [m/s2]


@dataclass(frozen=True, kw_only=True)
class Options:
    """An emulated UR5e controller with a soft wrist, a gripper and a camera."""

    peg: str = "circle"
    """circle, square, rectangle, or the path of a peg file (.yaml); pliant's own commands put a
    shipped peg in its place, and a file's is for other clients"""
    condition: str = "none"
    """none, friction, pose or all: what the first trial draws at random"""
    seed: int = 0
    """decides what is drawn"""
    mode: Pacing = Pacing.REAL
    """real time, fast, or lockstep: a client grants the ticks through the admin port"""
    speed: float = 4.0
    """times real time, in fast mode"""
    host: str = "127.0.0.1"
    """the address to serve: others than loopback can be reached from elsewhere"""
    admin_port: int = ADMIN_PORT
    """of the experiment's side"""
    camera_port: int = CAMERA_PORT
    """of the pictures, over HTTP"""
    force_limit: float = 150.0
    """external force [N] beyond which the controller stops by itself"""
    box: tuple[float, float, float, float, float, float] | None = None
    """x, y, z from and x, y, z to [m], base frame: where the tool's centre point may be"""
    force_noise: float = 0.0
    """standard deviation [N] of the measured force"""
    client_patience: float = 0.0
    """seconds for which time stands still while a client is late to feed its watchdog; not in
    lockstep"""
    faults: Path | None = None
    """a file of faults to come (.yaml)"""
    with_parent: bool = False
    """end when the process that started this one does"""

    def check(self) -> None:
        """Check the options.

        Raises:
            InputError: a value cannot be used.
        """
        self.is_loopback()
        for name, value, most in (
            ("speed", self.speed, MOST_SPEED),
            ("force-limit", self.force_limit, 1000.0),
        ):
            if not 0.0 < value <= most:
                raise InputError(f"{name} {value:g}: it must be above 0 and at most {most:g}")
        for name, value, most, unit in (
            ("client-patience", self.client_patience, faults.MOST_WAIT_S, "s"),
            ("force-noise", self.force_noise, faults.MOST_NOISE, "N"),
        ):
            if not 0.0 <= value <= most:
                raise InputError(f"{name} {value:g} {unit}: it must be 0 to {most:g} {unit}")
        if self.box is not None and any(
            not low < high for low, high in zip(self.box[:3], self.box[3:], strict=True)
        ):
            raise InputError(f"box {self.box}: each of the first three must be below its partner")
        if self.seed < 0:
            raise InputError(f"seed {self.seed}: it must be 0 or more")

    def is_loopback(self) -> bool:
        """Whether only this machine can reach it.

        Raises:
            InputError: the host is not an address.
        """
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError as error:
            raise InputError(
                f"host '{self.host}': it must be an address of this machine, as 127.0.0.1"
            ) from error


class Emulator:
    """One emulated cell: everything but its ports."""

    def __init__(
        self,
        options: Options,
        plant: Plant,
        block: Block,
        schedule: list[tuple[float, faults.Fault]],
    ) -> None:
        """Put a cell together; `schedule` says when in each trial [s] which fault comes, in
        order."""
        self.options, self.plant, self._block = options, plant, block
        self._schedule, self._pending = schedule, list(schedule)
        limits = SafetyLimits(force=options.force_limit, box=options.box)
        self.controller = Controller(self.plant, limits, options.force_noise)
        self.pace = EmulatorPace(
            self.controller,
            lambda always: self.rtde.publish(always=always),
            options.client_patience,
        )
        self.pace.set(options.mode, options.speed)
        self.rtde = Rtde(controller=self.controller, wake=self.pace.wake)
        self.controller.on_tick.append(self._after_tick)
        self._stopping = asyncio.Event()
        self.token = ""  # nobody knows it before the ports are open
        self._peg = options.peg
        block.write(self.controller.time_s, plant.qpos)

    def is_token(self, token: str) -> bool:
        """Whether somebody knows the emulator's token."""
        return secrets.compare_digest(token.encode(), self.token.encode())

    # --- the experiment's side -------------------------------------------------------------------

    async def set_up(self, peg: str | None, setup: Setup) -> None:
        """Begin a trial: everything that it changes, at once.

        Raises:
            InputError: the peg is unknown.
        """
        task: Task = self.plant.task if peg is None else load_task(peg)
        await asyncio.to_thread(self.plant.load, task)  # clients hang up on a long silence
        self._peg = peg or self._peg
        self.plant.prepare(task, setup)
        self.controller.begin_trial()
        self._pending = list(self._schedule)
        self._block.set_up(self._peg, setup)
        self._block.write(self.controller.time_s, self.plant.qpos)
        self.rtde.publish(always=True)

    def suffer(self, fault: faults.Fault) -> None:
        """Let a fault happen now."""
        controller = self.controller
        match fault:
            case faults.ProtectiveStop():
                controller.protective_stop("ordered")
            case faults.EmergencyStop():
                controller.emergency_stop()
                controller.gripper.readable = False
            case faults.PowerOff():
                controller.power_off()
            case faults.Stall(seconds=seconds):
                note(controller, f"stall for {seconds:g} s")
                self.pace.stall(seconds)
            case faults.DropRtde(refuse_s=refuse_s):
                note(controller, "RTDE connections cut")
                self.rtde.drop(refuse_s)
            case faults.CameraState(state=state):
                note(controller, f"camera {state}")
                self._block.set_fault(state)
            case faults.GripperLost():
                note(controller, "gripper lost the peg")
                controller.gripper.lose()
            case faults.ForceNoise(newtons=newtons):
                controller.sensor.noise = newtons

    def restore(self) -> None:
        """Undo every fault."""
        self.controller.restore()
        self.controller.gripper.readable = True
        self.controller.gripper.grip()
        self.controller.sensor.noise = self.options.force_noise
        self._block.set_fault(CameraFault.OK)
        self.rtde.refuse_until = 0.0

    def guide(self, pose: list[float], speed: float) -> None:
        """Lead the arm by hand.

        Raises:
            InputError: it is not in freedrive, or cannot reach the pose.
        """
        controller = self.controller
        if not controller.freedrive:
            raise InputError("the arm is not in freedrive: call freedriveMode first")
        target = frames.transform(pose)
        if not controller.within_limits(target, controller.q):
            raise InputError(f"the arm cannot reach {np.round(pose, 4).tolist()}")
        line = ToolLine(self.plant, controller.tool, controller.q, target)
        controller.motion = Travel(line, controller.q, speed, _GUIDED_ACCELERATION)

    def describe(self) -> dict[str, Any]:
        """Frames, tool, payload and pace in the base frame, as a client's configuration needs
        them."""
        host, task = self.options.host, self.plant.task
        payload = nominal_payload(task)
        return {
            "host": host,
            "camera_url": f"http://{host}:{self.options.camera_port}",
            "peg": self._peg,
            "frequency_hz": FREQUENCY,
            "base_in_task_m": list(c.BASE_POSITION),  # the axes are parallel
            "hinge_on_flange": list(frames.pose(self.plant.hinge_on_flange)),
            "home_q": self.plant.home.tolist(),
            "wrist_stiffness_z": task.wrist.stiffness_z,
            "payload": {
                "mass_kg": payload.mass,
                "centre_on_flange_m": list(payload.centre),
            },
            "mode": self.pace.pacing,
            "speed": self.pace.speed,
        }

    def state(self) -> dict[str, Any]:
        """The controller's state now."""
        controller = self.controller
        return {
            "time_s": controller.time_s,
            "trial_s": controller.trial_s,
            "robot_mode": controller.mode.name,
            "safety_mode": controller.safety.name,
            "program": controller.runtime.name,
            "freedrive": controller.freedrive,
            "moving": not controller.motion.done,
            "tool_pose": list(frames.pose(controller.tool_pose())),
            "tool_target": list(frames.pose(controller.tool_target())),
            "mode": self.pace.pacing,
            "speed": self.pace.speed,
            "slipped_s": self.pace.slipped_s,
        }

    def stop(self) -> None:
        """Let whoever waits until it is stopped go on."""
        self._stopping.set()

    async def until_stopped(self) -> None:
        await self._stopping.wait()

    # --- inside ----------------------------------------------------------------------------------

    def _after_tick(self) -> None:
        self._block.write(self.controller.time_s, self.plant.qpos)
        while self._pending and self._pending[0][0] <= self.controller.trial_s:
            self.suffer(self._pending.pop(0)[1])
