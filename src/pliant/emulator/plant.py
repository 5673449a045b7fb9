"""The plant: the simulated cell, stepped once per controller tick, seen from the arm's base frame.

The base frame has the task frame's axes and its origin at `sim.constants.BASE_POSITION`; with the
flange as in UR's own kinematics (the link lengths are Menagerie's, rounded to a millimetre).
"""

from pathlib import Path

import mujoco
import numpy as np

from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.emulator.frames import Array, cross, inverse
from pliant.emulator.sensor import SensorPayload
from pliant.errors import RobotFault
from pliant.sim import constants as c
from pliant.sim import model as m
from pliant.sim import replay
from pliant.sim.cell import SimCell
from pliant.task import Task
from pliant.ur5e.configuration import placed
from pliant.wrist import GRAVITY

TICK = c.TIMESTEP  # [s] of the controller: one physics step
_FLANGE_SITE = "attachment_site"
_TICKS_PER_FRAME = 20  # of the stored trajectory: 25 Hz


def nominal_payload(task: Task) -> SensorPayload:
    """The payload that a client sets: gripper and peg, straight, the wrist stretched by their
    weight."""
    mass = c.GRIPPER_MASS + c.PEG_MASS
    peg = task.tip_below_hinge - task.peg.length / 2
    below = (c.GRIPPER_MASS * c.GRIPPER_COM_BELOW_HINGE + c.PEG_MASS * peg) / mass
    stretch = mass * GRAVITY / task.wrist.stiffness_z
    return SensorPayload(mass=mass, centre=(0.0, 0.0, c.WRIST_BELOW_FLANGE + below + stretch))


class Plant:
    """The cell behind the controller. Joints are in radians, transforms in the base frame."""

    def __init__(self, task: Task, setup: Setup) -> None:
        self._cells: dict[Task, SimCell] = {}
        self.prepare(task, setup)

    def load(self, task: Task) -> None:
        """Have a task's model ready, which takes a second; any thread may do so."""
        if task not in self._cells:
            cell = SimCell()
            cell.prepare(task, Setup(seed=0))
            self._cells[task] = cell

    def prepare(self, task: Task, setup: Setup) -> None:
        """Set hole, friction and grasp, and hang the arm at home, at rest, all at once."""
        self.load(task)
        cell = self._cells[task]
        robot = cell.prepare(task, setup)
        self.task, self.setup, self._cell, self._robot = task, setup, cell, robot
        self._model, self._data, self._arm = robot.model, robot.data, robot.arm
        self._wrist = int(self._model.body(m.WRIST).id)
        self._root = int(self._model.body_rootid[self._wrist])
        self._flange = int(self._model.site(_FLANGE_SITE).id)
        data = self._data
        mujoco.mj_forward(self._model, data)
        self._base_position = np.array(c.BASE_POSITION)
        at_home = self._site(self._flange)
        hinge = self._site(int(self._model.site(m.HINGE_SITE).id))
        self.hinge_on_flange = inverse(at_home) @ hinge  # what setTcp gets for the hinge point
        self._flange_on_hinge = inverse(self.hinge_on_flange)
        self.home = data.ctrl[: len(self._arm.qpos)].copy()  # (6,)
        self._ticks = 0
        self._measure()

    # --- one tick --------------------------------------------------------------------------------

    def step(self, q: Array) -> None:
        """Take one physics step with the servos' set points at `q` (6,)."""
        self._data.ctrl[:] = q
        mujoco.mj_step(self._model, self._data)
        self._ticks += 1
        if self._ticks % _TICKS_PER_FRAME == 0:
            self._robot.frames.append((self._robot.clock(), self._data.qpos.copy()))
        self._measure()

    def _measure(self) -> None:
        data = self._data
        mujoco.mj_rnePostConstraint(self._model, data)
        self.q: Array = data.qpos[self._arm.qpos]  # (6,) measured
        mujoco.mj_kinematics(self._model, data)
        self.flange = self._site(self._flange)
        transmitted = data.cfrc_int[self._wrist]  # torque, force of the arm on the tool, at the com
        force = -transmitted[3:]
        lever = data.subtree_com[self._root] - self._base_position - self.flange[:3, 3]
        self.force: Array = force  # (3,) [N] of the tool on the flange, base axes
        self.torque: Array = cross(lever, force) - transmitted[:3]  # (3,) [N m] about the flange

    def _site(self, site: int) -> Array:
        position = self._data.site_xpos[site] - self._base_position
        return placed(position, self._data.site_xmat[site].reshape(3, 3))

    # --- measured on demand ----------------------------------------------------------------------

    @property
    def qd(self) -> Array:  # (6,) [rad/s]
        return self._data.qvel[self._arm.dofs]

    @property
    def joint_torques(self) -> Array:  # (6,) [N m]
        return self._data.qfrc_actuator[self._arm.dofs]

    @property
    def qpos(self) -> Array:  # (nq,) for the camera
        return self._data.qpos

    def flange_velocity(self) -> tuple[Array, Array]:
        """Linear (3,) [m/s] and angular (3,) [rad/s] velocity of the flange, base axes."""
        result = np.zeros(6)
        site = mujoco.mjtObj.mjOBJ_SITE
        mujoco.mj_objectVelocity(self._model, self._data, site, self._flange, result, 0)
        return result[3:], result[:3]

    # --- kinematics ------------------------------------------------------------------------------

    def flange_of(self, q: Array) -> Array:  # (4, 4)
        """The flange's transform at joint angles (6,)."""
        position, matrix = self._arm.pose_of(q)
        return placed(position - self._base_position, matrix) @ self._flange_on_hinge

    def solve(self, flange: Array, near: Array) -> Array:  # (6,)
        """Joint angles near `near` that put the flange there.

        Raises:
            RobotFault: it cannot be reached.
        """
        hinge = flange @ self.hinge_on_flange
        return self._arm.solve(hinge[:3, 3] + self._base_position, hinge[:3, :3], near)

    def solution(self, flange: Array, near: Array) -> Array | None:
        """Joint angles as `solve` finds them; None: the flange cannot be put there."""
        try:
            return self.solve(flange, near)
        except RobotFault:
            return None

    # --- the experiment's side -------------------------------------------------------------------

    def truth(self) -> Truth:
        return self._cell.truth()

    def save_trajectory(self, folder: Path) -> None:
        """Store the trial so far, for drawing it again.

        Raises:
            InputError: the folder cannot be written.
        """
        if not self._robot.frames:
            self._robot.frames.append((self._robot.clock(), self._data.qpos.copy()))
        replay.save(folder, self._cell.trajectory())
