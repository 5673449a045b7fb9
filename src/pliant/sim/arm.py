"""Inverse kinematics of the arm along a straight line, and the speed profile along it."""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.errors import RobotFault
from pliant.pose import Pose
from pliant.sim.model import ARM_JOINTS, HINGE_SITE

_WAYPOINT_LENGTH = 0.005  # [m]; between waypoints joints move linearly, off the line by < 0.01 mm
_WAYPOINT_ANGLE = math.radians(1.0)
_TOLERANCE = 1e-7  # [m, rad]
_ITERATIONS = 50
_DAMPING = 1e-6 * np.eye(6)
HOME_GUESS = (3.14, -1.6, 1.6, -1.57, -1.57, -1.57)  # elbow up, fingers closing along y


class Arm:
    """The arm's kinematics of the hinge point, with the wrist unsprung."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._site = model.site(HINGE_SITE).id
        joints = [model.joint(name) for name in ARM_JOINTS]
        self.qpos = np.array([int(j.qposadr[0]) for j in joints])
        self.dofs = np.array([int(j.dofadr[0]) for j in joints])

    def pose_of(self, q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position (3,) and rotation (3, 3) of the hinge point at joint angles (6,) [rad]."""
        self._data.qpos[self.qpos] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        position = self._data.site_xpos[self._site].copy()
        return position, self._data.site_xmat[self._site].reshape(3, 3).copy()

    def solve(
        self,
        position: NDArray[np.float64],
        rotation: NDArray[np.float64],
        q: NDArray[np.float64],
        tolerance: float = _TOLERANCE,
    ) -> NDArray[np.float64]:  # (6,) [rad]
        """Joint angles near `q` that put the hinge point there to within `tolerance` [m, rad], by
        damped least squares.

        Raises:
            RobotFault: the pose cannot be reached.
        """
        q = q.copy()
        jacobian = np.zeros((6, self._model.nv))
        error, turn = np.zeros(6), np.zeros(4)
        for _ in range(_ITERATIONS):
            at, facing = self.pose_of(q)
            error[:3] = position - at
            mujoco.mju_mat2Quat(turn, (rotation @ facing.T).ravel())
            mujoco.mju_quat2Vel(error[3:], turn, 1.0)
            if np.abs(error).max() < tolerance:
                return q
            mujoco.mj_jacSite(self._model, self._data, jacobian[:3], jacobian[3:], self._site)
            j = jacobian[:, self.dofs]
            step = j.T @ np.linalg.solve(j @ j.T + _DAMPING, error)
            q += np.minimum(np.maximum(step, -0.3), 0.3)  # as np.clip, in a third of its time
        raise RobotFault("unreachable", f"the arm cannot reach {np.round(position, 3)} m")

    def line(self, start: Pose, end: Pose, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Joint waypoints (n, 6) [rad], equally spaced on the straight line between two poses."""
        length = float(np.linalg.norm(end.position() - start.position()))
        turn = rotation_vector(start.rotation().T @ end.rotation())
        angle = float(np.linalg.norm(turn))
        n = max(1, math.ceil(length / _WAYPOINT_LENGTH), math.ceil(angle / _WAYPOINT_ANGLE))
        waypoints = [q]
        for s in np.arange(1, n + 1) / n:
            position = start.position() + s * (end.position() - start.position())
            facing = start.rotation() @ rotation(s * turn)
            waypoints.append(self.solve(position, facing, waypoints[-1]))
        return np.array(waypoints)


class Profile:
    """Distance along a line against time: from rest to rest, with cosine ramps of fixed length."""

    def __init__(self, length: float, speed: float, ramp_s: float) -> None:
        self.length = length
        self.speed = min(speed, length / ramp_s) if length > 0 else speed
        self.ramp_s = ramp_s
        self.duration = length / self.speed + ramp_s if length > 0 else 0.0

    def fractions(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fraction of the line covered at each time [s]."""
        if self.length <= 0:
            return np.ones_like(times)
        t = np.clip(times, 0.0, self.duration)
        covered = self._ramp(t) - self._ramp(t - (self.duration - self.ramp_s))
        return np.clip(covered * self.speed / self.length, 0.0, 1.0)

    def _ramp(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Integral of a cosine ramp from 0 to 1 over `ramp_s` that then stays at 1."""
        r = self.ramp_s
        inside = np.clip(t, 0.0, r)
        rising = inside / 2 - r / math.tau * np.sin(math.pi * inside / r)
        return np.where(t <= 0, 0.0, rising + np.clip(t - r, 0.0, None))


def rotation_vector(matrix: NDArray[np.float64]) -> NDArray[np.float64]:  # (3,) [rad]
    """The rotation vector (3,) [rad], at most half a turn long, of a matrix (3, 3)."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(matrix).ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:  # (3, 3)
    """The matrix (3, 3) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    quaternion, matrix = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
