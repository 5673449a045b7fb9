"""The five contact formations, the axes each owns, their goals, and plan steps (Sec. IV)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from pliant.errors import InputError
from pliant.pose import Axis, Partial, Pose, describe


class Formation(StrEnum):
    """The five contact formations, CF0 to CF4, in order."""

    APPROACH = "approach"
    CONTACT = "contact"
    FIT = "fit"
    ALIGN = "align"
    INSERTION = "insertion"

    @property
    def order(self) -> int:
        return list(Formation).index(self)


OWNED: Mapping[Formation, tuple[Axis, ...]] = {
    Formation.APPROACH: (Axis.Y, Axis.Z, Axis.ROLL),
    Formation.CONTACT: (Axis.Z,),
    Formation.FIT: (Axis.Y,),
    Formation.ALIGN: (Axis.Y,),
    Formation.INSERTION: (Axis.Z,),
}
"""The axes that each formation's goal sets (Sec. IV); all others stay at the goal of the formation
before it, the paper's "-"."""

RECOVERABLE = (Formation.FIT, Formation.ALIGN, Formation.INSERTION)
"""The formations where a recovery plan may start (Sec. IV): Approach and Contact succeed under a
fixed board."""

MOST_TURN = math.radians(5)
"""The most by which one step may shift pitch or yaw [rad]."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One commanded skill: a formation, its goal, and whether to leave the hole first.

    `retreat` lifts straight up, travels in y and comes down before the formation's own motion.
    The goal may also hold shifts, where the method takes them: how far from what is believed to aim
    [m, rad], for this step alone.
    """

    formation: Formation
    goal: Partial
    retreat: bool = False

    def __str__(self) -> str:
        how = " after a retreat" if self.retreat else ""
        return f"{self.formation} to {describe(self.goal)}{how}"


@dataclass(frozen=True, kw_only=True)
class Goals:
    """One goal per formation [m, rad].

    Raises:
        InputError: a formation is missing, lacks an axis it owns, or sets one it does not own.
    """

    formations: Mapping[Formation, Partial]

    def __post_init__(self) -> None:
        for formation in Formation:
            if formation not in self.formations:
                raise InputError(f"goals: no goal for {formation}")
            check_axes(formation, self.formations[formation])

    def target(self, formation: Formation) -> Pose:
        """A formation's whole goal pose: its own axes, the rest from the formations before."""
        pose = Pose()
        for earlier in list(Formation)[: formation.order + 1]:
            pose = pose.updated(self.formations[earlier])
        return pose

    def updated(self, step: Step) -> "Goals":
        """The goals with the step's goal in place of its formation's; the step's shifts pass."""
        owned = OWNED[step.formation]
        kept = {axis: value for axis, value in step.goal.items() if axis in owned}
        merged = {**self.formations[step.formation], **kept}
        return Goals(formations={**self.formations, step.formation: merged})

    def touch_down_y(self, step: Step) -> float | None:
        """The y [m] where a retreat comes down: for Fit as far before its goal as was taught, for
        the others at the goal. None: the step does not retreat, or comes down where it is."""
        if not step.retreat or Axis.Y not in step.goal:
            return None
        taught = self.target(Formation.APPROACH).y - self.target(Formation.FIT).y
        return step.goal[Axis.Y] + (taught if step.formation is Formation.FIT else 0.0)

    def step(self, formation: Formation, *, retreat: bool = False) -> Step:
        """The step to a formation's goal as it is."""
        return Step(formation=formation, goal=self.formations[formation], retreat=retreat)


def steps_from(
    start: Formation, goals: Mapping[Formation, Partial], *, retreat: bool = False
) -> tuple[Step, ...]:
    """The steps from a recoverable formation to Insertion, to these goals; the first one may leave
    the hole before it."""
    rest = RECOVERABLE[RECOVERABLE.index(start) :]
    return tuple(Step(formation=f, goal=goals[f], retreat=retreat and f is start) for f in rest)


def check_axes(formation: Formation, goal: Partial, *, shifts: tuple[Axis, ...] = ()) -> None:
    """Refuse a goal that does not name exactly the axes its formation owns; it may name `shifts`
    too.

    Raises:
        InputError: an axis is missing, or one too many.
    """
    owned = OWNED[formation]
    names = ", ".join(owned)
    for axis in goal:
        if axis not in owned and axis not in shifts:
            raise InputError(
                f"goal for {formation} sets {axis}, which {formation} does not own; it owns {names}"
            )
    for axis in owned:
        if axis not in goal:
            raise InputError(f"goal for {formation} lacks {axis}; it must give {names}")
