"""The control program that ur_rtde uploads, one iteration per controller cycle.

The client writes a command's number to input register 0 and its arguments to the others; the
program performs it, writes 2 ("done") to output register 0, and 1 ("ready") when the client has
cleared the command. A command that takes time is a generator that yields once per cycle.
"""

import operator
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from pliant.emulator import frames
from pliant.emulator.controller import Controller
from pliant.emulator.frames import Array
from pliant.emulator.motion import (
    Drive,
    Follow,
    JointLine,
    Path,
    ToolLine,
    Travel,
    Waypoint,
    tool_advance,
)
from pliant.emulator.plant import TICK

_READY, _DONE = 1, 2
_STOP_SCRIPT = 255
_REALTIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71})
_RUNNING_BIT, _COUNT_SHIFT, _OPERATION_SHIFT, _WRAP = 1 << 15, 16, 24, 128
_CONTACT_FORCE = 20.0  # [N] against the direction of a motion until contact
_CONTACT_STOP = 3.0  # [m/s2]
_JOINT_SPEED = np.pi  # [rad/s], a joint's highest
_STEADY = 1e-3  # [rad/s]


class _Refused(Exception):
    """The program cannot perform a command; it ends, as a script does on an error."""


class Program:
    """The running control program. Call `cycle` once per controller cycle, until it returns
    False."""

    def __init__(self, controller: Controller, path: tuple[Waypoint, ...] = ()) -> None:
        self._c, self._path = controller, path
        self._registers = controller.registers
        self._busy: Iterator[None] | None = None
        self._executing = False
        self._background: Iterator[None] | None = None  # an asynchronous operation
        self._writes = self._operation = 0
        self._report(-1)
        self._signal(_READY)

    def cycle(self) -> bool:
        try:
            return self._cycle()
        except _Refused as error:
            self._c.end_program(str(error))
            return True

    def _cycle(self) -> bool:
        if self._busy is None:
            command = self._registers.in_int[0]
            if command == _STOP_SCRIPT:
                return False
            if command == 0:
                self._executing = False
                self._signal(_READY)
            elif command in _REALTIME:
                self._perform(command)
                self._signal(_READY)
            elif not self._executing:
                self._executing = True
                self._busy = self._perform(command) or iter(())
        if self._busy is not None and _is_over(self._busy):
            self._busy = None
            self._signal(_DONE)
        if self._background is not None and _is_over(self._background):
            self._background = None
            self._report(-1)
        return True

    def _perform(self, command: int) -> Iterator[None] | None:
        if command in _COMMANDS:
            return _COMMANDS[command](self)
        if command not in _QUESTIONS:
            raise _Refused(f"command {command} of the control script is not emulated")
        answer = _QUESTIONS[command](self)
        if isinstance(answer, bool):
            self._registers.out_int[1] = int(answer)
        else:
            self._registers.out_double[: len(answer)] = [float(v) for v in answer]
        return None

    # --- registers -------------------------------------------------------------------------------

    def _signal(self, state: int) -> None:
        self._registers.out_int[0] = state

    def _report(self, progress: int) -> None:
        """Write the asynchronous operation's word; 0 begins one, a negative value ends it."""
        self._writes = (self._writes + 1) % _WRAP
        if progress == 0:
            self._operation = (self._operation + 1) % _WRAP
        word = self._writes << _COUNT_SHIFT | self._operation << _OPERATION_SHIFT
        self._registers.out_int[2] = word | (progress | _RUNNING_BIT if progress >= 0 else 0)

    def _six(self, first: int) -> Array:
        return np.array(self._registers.in_double[first : first + 6])

    def _double(self, index: int) -> float:
        return self._registers.in_double[index]

    # --- motion ----------------------------------------------------------------------------------

    def _go(self, path: Callable[[], Path], speed: float, acceleration: float) -> Iterator[None]:
        """Stop what moves, then travel."""
        self._c.motion.brake(acceleration, joints=False)
        yield from self._rest()
        start = self._c.q
        self._c.motion = Travel(path(), start, speed, acceleration)
        yield from self._rest()

    def _rest(self) -> Iterator[None]:
        while not self._c.motion.done:
            yield

    def _start(self, operation: Iterator[None]) -> Iterator[None] | None:
        """Start an operation: in the background where the client asks for it, else until done."""
        self._cancel()
        if self._registers.in_int[1] != 1:
            return operation
        self._report(0)
        next(operation, None)
        self._background = operation
        return None

    def _cancel(self) -> None:
        if self._background is not None:
            self._background = None
            self._report(-1)

    def _line(self, target: Array) -> Path:
        c = self._c
        return ToolLine(c.plant, c.tool, c.q, target)

    def _pose(self, first: int = 0) -> Array:  # (4, 4)
        """The transform of the pose in the registers from `first` on."""
        return frames.transform(self._six(first))

    def _tool_at(self, q: Array) -> Array:  # (4, 4)
        """The tool's centre point at joint angles (6,)."""
        return self._c.plant.flange_of(q) @ self._c.tool

    def _joints_for_pose(self) -> Array:  # (6,)
        return self._solved(self._pose(), self._c.q)

    def _solved(self, tool: Array, near: Array) -> Array:
        q = self._c.plant.solution(tool @ frames.inverse(self._c.tool), near)
        if q is None:
            raise _Refused(f"no inverse kinematics for {np.round(frames.pose(tool), 4).tolist()}")
        return q

    def _joint_move(self, q: Array) -> Iterator[None] | None:
        speed, acceleration = self._double(6), self._double(7)
        return self._start(self._go(lambda: JointLine(self._c.q, q), speed, acceleration))

    def _line_move(self, target: Array) -> Iterator[None] | None:
        self._solved(target, self._c.q)  # refused before it moves
        speed, acceleration = self._double(6), self._double(7)
        return self._start(self._go(lambda: self._line(target), speed, acceleration))

    def _move_path(self) -> Iterator[None] | None:
        if not self._path:
            raise _Refused("no path was uploaded")
        return self._start(self._along_path())

    def _along_path(self) -> Iterator[None]:
        for number, waypoint in enumerate(self._path):
            if number and self._background is not None:
                self._report(number)
            yield from self._leg(waypoint)

    def _leg(self, waypoint: Waypoint) -> Iterator[None]:
        values = np.array(waypoint.target)
        if waypoint.joints:
            q = self._solved(frames.transform(values), self._c.q) if waypoint.pose else values
            return self._go(lambda: JointLine(self._c.q, q), waypoint.speed, waypoint.acceleration)
        target = frames.transform(values) if waypoint.pose else self._tool_at(values)
        return self._go(lambda: self._line(target), waypoint.speed, waypoint.acceleration)

    def _stop(self, *, joints: bool) -> Iterator[None] | None:
        deceleration = self._double(0)
        self._cancel()
        self._c.motion.brake(deceleration, joints=joints)
        return self._start(self._rest())

    def _halted(self) -> Iterator[None]:
        """Brake and come to rest, for speedStop and servoStop."""
        self._c.motion.brake(self._double(0) or _CONTACT_STOP, joints=False)
        yield from self._rest()

    def _drive(self, *, joints: bool) -> None:
        c, motion = self._c, self._c.motion
        if not isinstance(motion, Drive) or motion.joints is not joints:
            advance = operator.add if joints else tool_advance(c.plant, c.tool)
            c.motion = motion = Drive(c.q, advance, joints=joints)
        motion.toward(self._six(0), self._double(6))

    def _follow(self, q: Array) -> None:
        motion = self._c.motion
        if not isinstance(motion, Follow):
            self._c.motion = motion = Follow(self._c.q, _JOINT_SPEED)
        motion.toward(q, self._double(9))

    def _until_contact(self) -> Iterator[None]:
        velocity, direction = self._six(0), self._six(6)[:3]
        if not np.any(direction):
            direction = velocity[:3]
        along = direction / max(float(np.linalg.norm(direction)), 1e-9)
        c = self._c
        motion = Drive(c.q, tool_advance(c.plant, c.tool), joints=False)
        motion.toward(velocity, self._double(12))
        c.motion = motion
        while float(c.sensor.reported[:3] @ along) > -_CONTACT_FORCE:
            yield
        touched = c.q
        motion.brake(_CONTACT_STOP, joints=False)
        yield from self._rest()
        yield from self._go(lambda: JointLine(c.q, touched), 0.5, 1.0)

    # --- freedrive: a hand guides the arm through the admin port ---------------------------------

    def _freedrive(self) -> None:
        self._c.freedrive = True

    def _end_freedrive(self) -> None:
        """End freedrive: the arm brakes where it was led; the script goes on."""
        self._c.freedrive = False
        self._c.motion.brake(_CONTACT_STOP, joints=False)

    # --- set-up and questions --------------------------------------------------------------------

    def _payload(self, *, with_inertia: bool) -> None:
        before = self._c.sensor.payload
        x, y, z = self._registers.in_double[1:4]
        centre = (x, y, z) if (x, y, z) != (0.0, 0.0, 0.0) else before.centre
        inertia = tuple(self._six(4)) if with_inertia else before.inertia
        self._c.set_payload(self._double(0), centre, inertia)

    def _set_tool(self) -> None:
        self._c.tool = self._pose()

    # --- questions: the numbers that answer them, or yes or no ------------------------------------

    def _has_inverse(self) -> bool:
        flange = self._pose() @ frames.inverse(self._c.tool)
        return self._c.plant.solution(flange, self._c.q) is not None

    def _is_steady(self) -> bool:
        moving = float(np.abs(self._c.plant.qd).max()) > _STEADY
        return bool(self._c.motion.done) and not moving

    def _history(self) -> Array:
        ago = min(max(self._registers.in_int[1], 0), len(self._c.history) - 1)
        return self._c.history[-1 - ago]


def _is_over(operation: Iterator[None]) -> bool:
    return next(operation, _OVER) is _OVER


_OVER = object()

_P = Program
_COMMANDS: Mapping[int, Callable[[Program], Iterator[None] | None]] = {
    1: lambda p: p._joint_move(p._six(0)),
    2: lambda p: p._joint_move(p._joints_for_pose()),
    3: lambda p: p._line_move(p._pose()),
    4: lambda p: p._line_move(p._tool_at(p._six(0))),
    8: lambda p: p._c.sensor.zero(p._c.plant.flange[:3, :3]),
    9: lambda p: p._drive(joints=True),
    10: lambda p: p._drive(joints=False),
    11: lambda p: p._follow(p._six(0)),
    15: _P._halted,
    16: _P._halted,
    17: lambda p: p._payload(with_inertia=False),
    18: _P._freedrive,  # teach mode, freedrive's former name
    19: _P._end_freedrive,
    24: lambda p: p._follow(p._joints_for_pose()),
    29: _P._set_tool,
    31: lambda p: p._c.protective_stop("asked for by the client"),
    33: lambda p: p._stop(joints=False),
    34: lambda p: p._stop(joints=True),
    35: lambda p: p._c.watch(p._double(0)),
    45: _P._move_path,
    51: _P._until_contact,
    52: _P._freedrive,
    53: _P._end_freedrive,
    65: lambda p: p._payload(with_inertia=True),
}
_QUESTIONS: Mapping[int, Callable[[Program], Array | tuple[float, ...] | bool]] = {
    26: lambda p: (TICK,),
    27: _P._history,
    28: lambda p: frames.pose(p._c.tool_target()),
    30: lambda p: p._solved(p._pose(), p._six(6)),
    36: lambda p: p._c.within_limits(p._pose(), p._c.q),
    37: lambda p: p._c.joints_within_limits(p._six(0)),
    38: lambda p: p._c.plant.joint_torques,
    39: lambda p: frames.pose(p._pose() @ p._pose(6)),
    40: lambda p: frames.pose(p._c.tool),
    43: lambda p: frames.pose(p._c.tool_pose()),
    44: lambda p: frames.pose(p._c.plant.flange_of(p._six(0)) @ p._pose(6)),
    46: _P._joints_for_pose,
    47: _P._is_steady,
    54: lambda p: p._c.freedrive,
    58: lambda p: frames.pose(p._c.plant.flange),
    60: _P._has_inverse,
}
