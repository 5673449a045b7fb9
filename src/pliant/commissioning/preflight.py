"""The check whether a cell is ready: each part with what was found and, where it fails, what to do.

Nothing moves the arm. A check that a fault made impossible says so and counts as failed; one that
does not apply to a cell says that too, and does not count.
"""

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from itertools import chain
from typing import Protocol, runtime_checkable

import numpy as np

from pliant import teaching
from pliant.cell import Observation, Robot
from pliant.commissioning.rehearsal import Commanded, plan_of
from pliant.conditions import Setup
from pliant.errors import InputError, RobotFault
from pliant.experiment.where import Where
from pliant.pose import Axis, Pose, describe
from pliant.task import Task
from pliant.vision.measure import measure
from pliant.vision.scene import PegSeen, Scene
from pliant.wrist import GRAVITY

DRIFT_M = 0.0005  # of the tared compression
PAYLOAD_N = 15.0  # felt along the wrist before taring: more is not the sensor's drift
SURFACE_M, ACROSS_M, HEIGHT_M, WIDTH_M = 0.003, 0.003, 0.006, 0.002  # of a calibration
HOLE_M = 0.03  # from its nominal place: further than any condition of the paper puts it
_UPRIGHT = math.radians(2.0)  # of the flange, for the peg's place to be known
_DRIFT_S = 3.0
_READINGS = 10
_LIGHTER_KG = 0.3  # than the tool is, for the wrist's sign
WEIGHT_FELT = (0.5, 1.5)  # of what that is: rough, since only the sign is asked for


class CheckState(StrEnum):
    PASS = "pass"
    FAIL = "fail"
    UNKNOWN = "not checked"
    NONE = "does not apply"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check: what was found, and what to do about it."""

    check: str
    state: CheckState
    found: str
    advice: str = ""

    @property
    def is_good(self) -> bool:
        return self.state in (CheckState.PASS, CheckState.NONE)


_OF_ARM = ("connection", "safety status", "mode", "gripper", "payload", "camera")  # in this order
_WITH_ROBOT = ("tare drift", "wrist sign", "picture", "calibration", "safety limits")

_CHECK_OF_FAULT = {
    "power_off": "mode",
    "program_stopped": "mode",
    "protective_stop": "safety status",
    "emergency_stop": "safety status",
    "safeguard_stop": "safety status",
    "gripper": "gripper",
    "camera": "camera",
}
"""The check that a fault of each kind fails; any other kind fails the connection."""

_ADVICE = {
    "connection": "is the controller on, the cable in, arm.address right, the arm in remote"
    " control, and no other program connected?",
    "mode": "power on and release the brakes at the pendant, in remote control",
    "safety status": "look at the cell; release the stop at the pendant when it is safe",
    "gripper": "activate it at the pendant, close it on the peg; gripper.port; null if there is"
    " none",
    "payload": "does the tool hang free and upright? then correct payload.mass_kg and center_mm",
    "camera": "is it connected, not in use, and camera.source, where, width and height right?",
    "tare drift": "wait until the arm is warm and the tool at rest, in free hang",
    "wrist sign": "turn wrist.sign round, or is wrist.axis another? let the arm press nothing"
    " before: it would not feel it",
    "picture": "peg and block must be in the picture, in good light: look at it with pliant teach,"
    " then pick the colours with pliant calibrate",
    "calibration": "pliant calibrate",
    "safety limits": "is the task frame right? then widen the controller's safety planes at the"
    " pendant, or teach these goals inside them",
    "goals": "teach them in this cell with pliant teach, or widen the workspace",
}


def check(where: Where, task: Task) -> list[Finding]:
    """Make every check of a cell, in order.

    Raises:
        InputError: the cell's file cannot be used, or an extra is missing.
    """
    findings: list[Finding] = []
    try:
        with _attached(where, task) as robot:
            for finding in chain(
                _arm(where, robot), _in_the_cell(where, task, robot), _permitted(where, task, robot)
            ):
                findings.append(finding)  # one by one: a fault leaves those before it
    except RobotFault as fault:
        if fault.kind == "interrupted":
            raise KeyboardInterrupt from fault
        findings += _after(fault, {f.check for f in findings})
    return [*findings, _goals(where, task)]


# --- reaching it ---------------------------------------------------------------------------------


@contextmanager
def _attached(where: Where, task: Task) -> Iterator[Robot]:
    """The robot as it stands. A simulated or emulated cell is set up first."""
    configuration = where.configuration
    with ExitStack() as stack:
        if configuration is None or configuration.emulator is not None:
            cell = where.open()
            if close := getattr(cell, "close", None):  # a simulated one has nothing to close
                stack.callback(close)
            robot = cell.prepare(task, Setup(seed=0))
            if configuration is None:
                yield stack.enter_context(robot)
                return
            stack.pop_all().close()
        from pliant.ur5e.camera import open_camera
        from pliant.ur5e.driver import Driver
        from pliant.ur5e.driver_process import ArmDriver
        from pliant.ur5e.robot import UrRobot

        assert configuration is not None
        driver = Driver(configuration)
        stack.callback(driver.close)
        driver.connect()
        driver.ask(partial(ArmDriver.set_up, holds=configuration.gripper is not None))
        camera = open_camera(configuration.camera, configuration.patience.picture_ms * 1e-3)
        stack.callback(camera.close)
        yield stack.enter_context(UrRobot(configuration, driver, camera, task))


# --- the checks ----------------------------------------------------------------------------------


def _arm(where: Where, robot: Robot) -> Iterator[Finding]:
    """The checks that reaching the robot has made already, and that of its payload."""
    configuration = where.configuration
    if configuration is None:
        yield from map(_simulated, _OF_ARM)
        return
    yield _passed("connection", configuration.arm.address)
    yield _passed("safety status", "normal")
    yield _passed("mode", "running, the control program too")
    if configuration.gripper is None:
        yield Finding(check="gripper", state=CheckState.NONE, found="the cell has none")
    else:
        yield _passed("gripper", "active, it holds the peg")
    force = _mean_compression(robot) * configuration.wrist.stiffness_n_mm * 1e3
    found = f"{configuration.payload.mass_kg:g} kg set, {force:+.1f} N felt before taring"
    yield _judged("payload", abs(force) <= PAYLOAD_N, found)
    robot.observe()
    yield _passed("camera", f"{configuration.camera.source}, fresh pictures")


def _in_the_cell(where: Where, task: Task, robot: Robot) -> Iterator[Finding]:
    robot.tare()
    before = _mean_compression(robot)
    robot.settle(_DRIFT_S)
    drift = _mean_compression(robot) - before
    found = f"{drift * 1e3:+.2f} mm in {_DRIFT_S:g} s, at most {DRIFT_M * 1e3:g}"
    yield _judged("tare drift", abs(drift) <= DRIFT_M, found)
    yield _sign(where, robot)
    observation = robot.observe()
    scene = measure(observation.views["side"], task, where.colours)
    seen = scene.peg is not None and scene.hole is not None
    yield _judged("picture", seen, "peg and hole" if seen else "; ".join(scene.problems))
    if seen:
        yield _calibration(where, task, observation, scene)
    else:
        yield _unknown("calibration", "peg and hole are not seen")


@runtime_checkable
class _Weighing(Protocol):
    """A robot that can be told that its tool is lighter."""

    def weigh(self, lighter_kg: float) -> float: ...


def _sign(where: Where, robot: Robot) -> Finding:
    """Check the wrist's sign: weight that the controller does not make up for must read as
    stretching."""
    name, configuration = "wrist sign", where.configuration
    if configuration is None or not isinstance(robot, _Weighing):
        return _simulated(name)
    lighter_kg = min(_LIGHTER_KG, configuration.payload.mass_kg / 2)
    stretched = lighter_kg * GRAVITY / (configuration.wrist.stiffness_n_mm * 1e3)
    felt = -robot.weigh(lighter_kg)
    found = (
        f"{lighter_kg:g} kg of the tool stretch by {felt * 1e3:+.1f} of {stretched * 1e3:.1f} mm"
    )
    low, high = WEIGHT_FELT
    return _judged(name, low * stretched <= felt <= high * stretched, found)


def _calibration(where: Where, task: Task, observation: Observation, scene: Scene) -> Finding:
    """Check that the board's surface and the hole are near where they must be, and the peg where
    the arm holds it: across, at the height that the wrist sags to, and as wide as it is."""
    peg, hole = scene.peg, scene.hole
    assert peg is not None
    assert hole is not None
    pose = observation.pose
    parts = [
        ("surface", hole.surface_z.value, SURFACE_M),
        ("hole", hole.y.value, HOLE_M),
        ("peg's width", _width(peg, task, observation) - 2 * task.peg.half_extents[1], WIDTH_M),
    ]
    if abs(pose.roll) < _UPRIGHT and abs(pose.pitch) < _UPRIGHT:
        across = peg.tip_y.value - task.tip_below_grasp * math.sin(peg.tilt.value) - pose.y
        height = peg.tip_z.value - (pose.z - task.tip_below_hinge - _sag(where, task))
        parts += [("peg across", across, ACROSS_M), ("peg's height", height, HEIGHT_M)]
    bad = [name for name, off, most in parts if not abs(off) <= most]
    found = ", ".join(f"{name} {off * 1e3:+.1f}" for name, off, _ in parts)
    wrong = f"; too far off: {', '.join(bad)}" if bad else ""
    return _judged("calibration", not bad, f"off by [mm] {found}{wrong}")


@runtime_checkable
class _Limited(Protocol):
    """A robot whose controller has limits of its own."""

    def permits(self, pose: Pose) -> bool: ...


def _permitted(where: Where, task: Task, robot: Robot) -> Iterator[Finding]:
    """Check that the controller would let the arm be at every pose that the taught plan commands: a
    line for each at which it would not."""
    name = "safety limits"
    if not isinstance(robot, _Limited):
        yield _simulated(name)
        return
    try:
        commanded = _commanded(where, task)
    except InputError:
        yield _unknown(name, "the goals cannot be used")
        return
    excluded = dict.fromkeys(_in_words(c) for c in commanded if not robot.permits(c.pose))
    found = "\n".join(excluded) or f"the controller permits all {len(commanded)} poses"
    yield _judged(name, not excluded, found)


def _in_words(line: Commanded) -> str:
    again = " after a retreat" if line.is_retreat else ""
    at = describe({axis: line.pose[axis] for axis in Axis})
    return f"{line.formation}{again}: the controller's safety limits exclude {at}"


def _commanded(where: Where, task: Task) -> list[Commanded]:
    """The motions that the taught plan commands. Raises InputError when the goals cannot be
    used."""
    path, limits = where.goals, where.limits
    taught = teaching.shipped() if path is None else teaching.load(path, limits, where.colours)
    return plan_of(taught.for_task(task), task, limits)


def _goals(where: Where, task: Task) -> Finding:
    """Check that every pose that the taught plan commands, retreats included, lies in the
    workspace."""
    path = where.goals
    try:
        commanded = _commanded(where, task)
    except InputError as error:
        return _judged("goals", False, str(error))
    outside = [line for line in commanded if line.problem is not None]
    found = f"{'the shipped ones' if path is None else path}, {len(commanded)} poses"
    if outside:
        found = f"{outside[0].formation}: {outside[0].problem}"
    return _judged("goals", not outside, found)


# --- inside --------------------------------------------------------------------------------------


def _after(fault: RobotFault, done: set[str]) -> list[Finding]:
    """The findings of the checks not yet made when a fault ended them: on the way to the robot
    those before the one that failed are good, else it would have been another fault."""
    names = (*_OF_ARM, *_WITH_ROBOT)
    failed = _CHECK_OF_FAULT.get(fault.kind, "connection")
    if failed in done:  # it happened later than its own check
        failed = next(name for name in names if name not in done)
    at = names.index(failed)
    good = [_passed(name, "good enough to go on") for name in names[:at] if name not in done]
    rest = [_unknown(name, f"the {failed} comes first") for name in names[at + 1 :]]
    return [*good, _judged(failed, False, str(fault)), *rest]


def _sag(where: Where, task: Task) -> float:
    """The distance [m] that the tool hangs below the unsprung wrist."""
    given = where.configuration
    if given is not None:
        return given.payload.mass_kg * GRAVITY / (given.wrist.stiffness_n_mm * 1e3)
    from pliant.sim import constants

    return (constants.GRIPPER_MASS + constants.PEG_MASS) * GRAVITY / task.wrist.stiffness_z


def _width(peg: PegSeen, task: Task, observation: Observation) -> float:
    """The peg's width as the picture shows it [m]."""
    a, b, c, _ = peg.box_px
    metres = observation.views["side"].camera.metres_per_pixel(task.peg.silhouette_x)
    return min(math.dist(a, b), math.dist(b, c)) * metres


def _mean_compression(robot: Robot) -> float:
    readings = []
    for _ in range(_READINGS):
        readings.append(robot.observe(cameras=()).compression_m)
        robot.settle(0.1)
    return float(np.mean(readings))


def _passed(name: str, found: str) -> Finding:
    return Finding(check=name, state=CheckState.PASS, found=found)


def _judged(name: str, good: bool, found: str) -> Finding:
    state = CheckState.PASS if good else CheckState.FAIL
    return Finding(check=name, state=state, found=found, advice="" if good else _ADVICE[name])


def _simulated(name: str) -> Finding:
    return Finding(check=name, state=CheckState.NONE, found="the cell is simulated")


def _unknown(name: str, found: str) -> Finding:
    return Finding(check=name, state=CheckState.UNKNOWN, found=found)
