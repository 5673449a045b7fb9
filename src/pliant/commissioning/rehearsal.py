"""The rehearsal of a trial: every motion that it could command, on paper; or run above the board.

The motions are those that the skills themselves command, of a robot that only takes notes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from pliant.belief import Belief
from pliant.cell import Motion, Observation, Robot, Stop, Trace
from pliant.envelope import Guarded, Limits
from pliant.errors import InputError
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.methods.planar.skills import PlanarSkills
from pliant.pose import Axis, Pose
from pliant.records import Look, Outcome
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.scene import Scene

CLEARANCE = 0.04  # [m] of the peg above the board in an air run; the wrist sags by a part of it
AIR_COMPRESSION = 0.005  # [m] more has touched something; a free motion swings the tool by 1 mm
_MARGIN = 0.001  # [m] that the envelope keeps a goal inside the workspace
_UNSEEN = Scene(peg=None, hole=None)


@dataclass(frozen=True, kw_only=True)
class Commanded:
    """One motion that a trial could command: of which formation, whether after a failure, where to,
    how fast [m/s], the compression that ends it [m], and why the envelope would refuse it."""

    formation: Formation
    is_retreat: bool
    pose: Pose
    speed_m_s: float
    compression_m: float
    problem: str | None


@dataclass(frozen=True, kw_only=True)
class Bound:
    """The interval in which one recovery may put a goal, and that in which any number of them may
    [m]."""

    formation: Formation
    axis: Axis
    taught: float
    one: tuple[float, float]
    all: tuple[float, float]


def plan_of(taught: Teaching, task: Task, limits: Limits) -> list[Commanded]:
    """The motions of the nominal plan, then of each formation's retreat and second try, with the
    taught goals."""
    goals = taught.goals
    nominal = [(goals.step(f), False) for f in Formation]
    again = [(goals.step(f, retreat=True), True) for f in RECOVERABLE]
    skill = PlanarSkills(taught=goals, contact_speed_m_s=limits.contact_speed_m_s)
    lines: list[Commanded] = []
    for step, is_retreat in [*nominal, *again]:
        notes = _Notes(pose=goals.target(step.formation))
        _execute(notes, skill, step)
        lines += [
            Commanded(
                formation=step.formation,
                is_retreat=is_retreat,
                pose=motion.requested,
                speed_m_s=min(speed, limits.speed_m_s),
                compression_m=min(stop, limits.compression_m),
                problem=limits.outside({a: motion.requested[a] for a in Axis}),
            )
            for motion, speed, stop in notes.motions
        ]
    return lines


def bounds_of(taught: Teaching, limits: Limits) -> list[Bound]:
    """The bounds in which recoveries may move each goal: by a step from the goal in force, in the
    workspace."""
    bounds = []
    for formation in RECOVERABLE:
        for axis in OWNED[formation]:
            value = taught.goals.formations[formation][axis]
            reach = limits.goal_step_m  # none of them owns an angle
            low, high = limits.low[axis] + _MARGIN, limits.high[axis] - _MARGIN
            one = max(low, value - reach), min(high, value + reach)
            bounds.append(
                Bound(formation=formation, axis=axis, taught=value, one=one, all=(low, high))
            )
    return bounds


def above(taught: Teaching, task: Task, limits: Limits) -> Goals:
    """The taught goals, all lifted by as much as keeps the peg clear of the board.

    Raises:
        InputError: the workspace has no room for that.
    """
    lowest = min(taught.goals.target(f).z for f in Formation)
    lift = max(0.0, task.tip_below_hinge + CLEARANCE - lowest)
    goals = Goals(
        formations={
            formation: {a: v + lift if a is Axis.Z else v for a, v in goal.items()}
            for formation, goal in taught.goals.formations.items()
        }
    )
    for formation in Formation:
        outside = limits.outside(goals.formations[formation], margin=True)
        if outside is not None:
            raise InputError(
                f"no room for an air run: lifted by {lift * 1e3:.0f} mm, {formation} {outside}"
            )
    return goals


def air(robot: Robot, taught: Teaching, task: Task, limits: Limits) -> Iterator[Outcome]:
    """Run the nominal plan above the board, as `above` lifts it, one formation after the other. It
    ends early, with the outcome that says so, when something presses the wrist.

    Raises:
        InputError: the workspace has no room for that.
        RobotFault: the robot cannot go on.
    """
    goals = above(taught, task, limits)
    skill = PlanarSkills(
        taught=goals,
        contact_speed_m_s=limits.contact_speed_m_s,
        compression_limit_m=AIR_COMPRESSION,
    )
    with Guarded(robot, limits) as guarded:
        for formation in Formation:
            outcome = _execute(guarded, skill, goals.step(formation))
            yield outcome
            if outcome.stop.is_early:
                return


def _execute(robot: Robot, skill: PlanarSkills, step: Step) -> Outcome:
    def look(cameras: Sequence[str] = ("side",)) -> Look:
        return Look(observation=robot.observe(cameras), scene=_UNSEEN)

    return skill(robot, look, skill.taught.target(step.formation), step, Belief())


@dataclass(kw_only=True)
class _Notes:
    """A robot on paper: it is at once where it is told to be, and keeps what it was told."""

    pose: Pose
    motions: list[tuple[Motion, float, float]] = field(default_factory=list)  # [m/s], [m]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the context: there is nothing to halt."""

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        none = np.zeros(0)
        self.pose = pose
        motion = Motion(
            requested=pose,
            commanded=pose,
            ended=pose,
            stop=Stop.REACHED,
            peak_compression_m=0.0,
            started_s=0.0,
            ended_s=0.0,
            trace=Trace(time_s=none, pose=none.reshape(0, 6), compression_m=none),
        )
        self.motions.append((motion, speed_m_s, stop_at_compression_m))
        return motion

    def settle(self, seconds: float) -> None:
        """Do nothing: on paper no time passes."""

    def tare(self) -> None:
        """Do nothing: nothing presses."""

    def clock(self) -> float:
        return 0.0

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        return Observation(time_s=0.0, pose=self.pose, compression_m=0.0, views={})

    def halt(self) -> None:
        """Do nothing: the robot on paper stands already."""
