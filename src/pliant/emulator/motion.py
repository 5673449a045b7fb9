"""Motions of the commanded joints: along a path with trapezoidal speed, at a speed, or behind a
target.

The controller asks its motion for the next joints (6,) once per tick. Commanded joints know nothing
of the measured ones.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pliant.emulator.frames import Array, inverse
from pliant.emulator.plant import Plant
from pliant.sim.arm import rotation, rotation_vector
from pliant.ur5e.configuration import placed

ROTATION_RADIUS = 0.2  # [m]: a turn by an angle counts as this long an arc
_DONE = 1e-9  # [m, rad]
_AT_REST = 1e-6  # [m/s, rad/s]


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """One move of an uploaded path."""

    joints: bool  # a joint move, else a straight line
    target: tuple[float, ...]  # (6,) joints, or a pose where `pose`
    pose: bool
    speed: float
    acceleration: float


class EmulatedMotion:
    """A motion of the commanded joints. This one stays where it is."""

    def __init__(self, q: Array) -> None:
        self.done = True
        self._q = q

    def step(self, dt: float, scale: float) -> Array:  # (6,)
        """The joints `dt` [s] later, at a fraction `scale` of the speed asked for.

        Raises:
            RobotFault: the arm cannot follow.
        """
        return self._q

    def brake(self, deceleration: float, *, joints: bool) -> None:
        """Come to rest at `deceleration` [m/s2], or [rad/s2] of the fastest joint."""


class JointLine:
    """A path on which all joints move in proportion; the length is the fastest joint's [rad]."""

    def __init__(self, start: Array, end: Array) -> None:
        self._start, self._turn = start, end - start
        self.length = float(np.abs(self._turn).max())

    def joints(self, s: float, near: Array) -> Array:
        return self._start + self._turn * (s / self.length if self.length else 1.0)


class ToolLine:
    """A path with the tool's centre point on a straight line, turning evenly about one axis [m]."""

    def __init__(self, plant: Plant, tool: Array, start: Array, end: Array) -> None:
        """Make the line: `tool` is the tool centre point on the flange, `start` joints (6,), `end`
        a transform."""
        self._plant, self._flange_on_tool = plant, inverse(tool)
        begin = plant.flange_of(start) @ tool
        self._position, self._rotation = begin[:3, 3], begin[:3, :3]
        self._shift = end[:3, 3] - self._position
        self._turn = rotation_vector(self._rotation.T @ end[:3, :3])
        angle = float(np.linalg.norm(self._turn))
        self.length = max(float(np.linalg.norm(self._shift)), ROTATION_RADIUS * angle)

    def joints(self, s: float, near: Array) -> Array:
        part = s / self.length if self.length else 1.0
        facing = self._rotation @ rotation(part * self._turn)
        at = placed(self._position + part * self._shift, facing)
        return self._plant.solve(at @ self._flange_on_tool, near)


Path = JointLine | ToolLine
"""A curve of a known length, in joint angles."""


class Travel(EmulatedMotion):
    """A motion along a path from rest to rest: trapezoidal speed, which `scale` may change on the
    way."""

    def __init__(self, path: Path, start: Array, speed: float, acceleration: float) -> None:
        super().__init__(start)
        self.done = path.length < _DONE
        self._path = path
        self._speed, self._acceleration = speed, acceleration
        self._s = self._v = 0.0
        self._braking: float | None = None
        self._joint_rate = 0.0  # [rad] of the fastest joint per unit of path

    def step(self, dt: float, scale: float) -> Array:
        if self.done:
            return self._q
        left = self._path.length - self._s
        if self._braking is not None:
            self._v = max(0.0, self._v - self._braking * dt)
        else:
            change = self._acceleration * dt
            wanted = min(self._speed * scale, _speed_to_stop(left, self._acceleration, dt))
            self._v = max(self._v - change, min(wanted, self._v + change), 0.0)
        ds = min(self._v * dt, left)
        self._s += ds
        stopped = self._braking is not None and self._v < _AT_REST
        arrived = self._path.length - self._s < _DONE
        if arrived:
            self._s = self._path.length
        self.done = stopped or arrived
        if ds > 0.0:
            q = self._path.joints(self._s, self._q)
            self._joint_rate = float(np.abs(q - self._q).max()) / ds
            self._q = q
        return self._q

    def brake(self, deceleration: float, *, joints: bool) -> None:
        if joints and not isinstance(self._path, JointLine):
            deceleration /= max(self._joint_rate, 1e-3)
        self._braking = max(deceleration, 1e-3)
        self.done = self.done or self._v < _AT_REST


def _speed_to_stop(left: float, deceleration: float, dt: float) -> float:
    """The highest speed of this tick from which ticks of `dt` can still stop within `left`."""
    step = deceleration * dt
    return step * (math.sqrt(0.25 + 2.0 * left / (step * dt)) - 0.5) + _DONE


class Drive(EmulatedMotion):
    """A motion at a velocity that changes with limited acceleration: of the tool [m/s, rad/s], or
    of the joints [rad/s]."""

    def __init__(
        self, start: Array, advance: Callable[[Array, Array], Array], *, joints: bool
    ) -> None:
        """Begin at rest at `start`; `advance(q, change)` gives the joints after a small change (6,)
        of tool or joints."""
        super().__init__(start)
        self.done = False
        self.joints, self._advance = joints, advance
        self._v, self._target, self._acceleration = np.zeros(6), np.zeros(6), 0.5
        self._braking = False

    def toward(self, velocity: Array, acceleration: float) -> None:
        """Change to another velocity (6,)."""
        self._target, self._acceleration = velocity, max(acceleration, 1e-3)
        self.done = self._braking = False

    def step(self, dt: float, scale: float) -> Array:
        gap = self._target * scale - self._v
        size = float(np.linalg.norm(gap))
        most = self._acceleration * dt
        self._v = self._v + (gap if size <= most else gap * (most / size))
        if np.any(self._v):
            self._q = self._advance(self._q, self._v * dt)
        self.done = self._braking and float(np.abs(self._v).max()) < _AT_REST
        return self._q

    def brake(self, deceleration: float, *, joints: bool) -> None:
        self.toward(np.zeros(6), deceleration)
        self._braking = True
        self.done = not np.any(self._v)


def tool_advance(plant: Plant, tool: Array) -> Callable[[Array, Array], Array]:
    """A function that moves joints by a small motion of the tool's centre point (6,) in base
    axes."""
    flange_on_tool = inverse(tool)

    def advance(q: Array, change: Array) -> Array:
        at = plant.flange_of(q) @ tool
        at[:3, 3] += change[:3]
        at[:3, :3] = rotation(change[3:]) @ at[:3, :3]
        return plant.solve(at @ flange_on_tool, q)

    return advance


class Follow(EmulatedMotion):
    """A motion behind a target that the client keeps moving, as servoj does: smoothed,
    speed-limited."""

    def __init__(self, start: Array, limit: float) -> None:
        super().__init__(start)
        self.done = False
        self._limit = limit
        self._target, self._lag_s = start, 0.1

    def toward(self, target: Array, lag_s: float) -> None:
        """Follow to other joints (6,)."""
        self._target, self._lag_s, self.done = target, lag_s, False

    def step(self, dt: float, scale: float) -> Array:
        change = (self._target - self._q) * min(1.0, dt / max(self._lag_s, dt))
        self._q = self._q + np.clip(change, -self._limit * dt, self._limit * dt)
        return self._q

    def brake(self, deceleration: float, *, joints: bool) -> None:
        self._target, self.done = self._q, True
