"""The five contact formations, the axes each owns, and the goals that were taught for them (Sec. III)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import yaml

from pliant.cell import Image
from pliant.errors import InputError, unknown
from pliant.pose import Axis, Partial, Pose, describe


class Formation(StrEnum):
    """CF0 to CF4, in order."""

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
"""The axes that each formation's goal sets (Sec. III); all others stay at the goal of the formation
before it, the paper's "-"."""

RECOVERABLE = (Formation.FIT, Formation.ALIGN, Formation.INSERTION)
"""Where a recovery plan may start (Sec. III): Approach and Contact succeed under a fixed board."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One commanded skill: a formation, its goal, and whether to leave the hole first.

    `retreat` lifts straight up, travels in y and comes down before the formation's own motion.
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
        """The whole pose of a formation's goal: its own axes, the rest from the formations before."""
        pose = Pose()
        for earlier in list(Formation)[: formation.order + 1]:
            pose = pose.updated(self.formations[earlier])
        return pose

    def updated(self, step: Step) -> "Goals":
        """These goals with the step's goal in place of its formation's."""
        merged = {**self.formations[step.formation], **step.goal}
        return Goals(formations={**self.formations, step.formation: merged})

    def step(self, formation: Formation, *, retreat: bool = False) -> Step:
        return Step(formation=formation, goal=self.formations[formation], retreat=retreat)


def check_axes(formation: Formation, goal: Partial) -> None:
    """Refuse a goal that does not name exactly the axes its formation owns."""
    owned = OWNED[formation]
    names = ", ".join(owned)
    for axis in goal:
        if axis not in owned:
            raise InputError(
                f"goal for {formation} sets {axis}, which {formation} does not own; it owns {names}"
            )
    for axis in owned:
        if axis not in goal:
            raise InputError(f"goal for {formation} lacks {axis}; it must give {names}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """What was recorded when a formation's goal was taught: the pose that was reached, the picture,
    and the peg that was in the gripper (Sec. II: p_g and I_g)."""

    formation: Formation
    pose: Pose
    peg: str
    image: Image = field(repr=False)


GOALS_SCHEMA = 1


def load_goals(path: Path) -> tuple[Goals, dict[Formation, Demonstration]]:
    """Read taught goals: a YAML file with its pictures beside it.

    Raises:
        InputError: the file or a picture is missing, or broken.
    """
    import cv2

    try:
        text = path.read_text()
    except OSError as error:
        raise InputError(
            f"goal file '{path}' cannot be read: {error.strerror}; leave it out to use the shipped"
            " goals"
        ) from error
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(f"goal file '{path}' is not YAML: {str(error).splitlines()[0]}") from error
    if not isinstance(data, dict) or data.get("schema") != GOALS_SCHEMA:
        raise InputError(f"goal file '{path}' must say 'schema: {GOALS_SCHEMA}'")
    peg = str(data.get("peg", ""))
    entries = data.get("formations")
    if not isinstance(entries, dict):
        raise InputError(f"goal file '{path}' must list 'formations'")
    goals: dict[Formation, Partial] = {}
    demonstrations: dict[Formation, Demonstration] = {}
    for name, entry in entries.items():
        if name not in list(Formation):
            raise unknown("formation", name, Formation, f"in goal file '{path}'")
        formation = Formation(name)
        if not isinstance(entry, dict):
            raise InputError(f"goal file '{path}': {name} must have a goal, a pose and a picture")
        goals[formation] = _partial(entry.get("goal"), path, name)
        picture = path.parent / str(entry.get("picture"))
        bgr = cv2.imread(str(picture)) if picture.is_file() else None
        if bgr is None:
            raise InputError(f"goal file '{path}': the picture '{picture}' of {name} is missing")
        demonstrations[formation] = Demonstration(
            formation=formation,
            pose=Pose().updated(_partial(entry.get("pose"), path, name)),
            peg=peg,
            image=cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB),  # type: ignore[arg-type]
        )
    try:
        return Goals(formations=goals), demonstrations
    except InputError as error:
        raise InputError(f"goal file '{path}': {error}") from error


def _partial(entry: Any, path: Path, name: str) -> dict[Axis, float]:
    """{"y_mm": 26} to {Axis.Y: 0.026}."""
    if not isinstance(entry, dict) or not entry:
        raise InputError(f"goal file '{path}': {name} lacks its goal or pose")
    units = {f"{axis}_{axis.report_unit}": axis for axis in Axis}
    result = {}
    for key, value in entry.items():
        if key not in units:
            raise unknown("goal field", key, units, f"in goal file '{path}'")
        if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e4:
            raise InputError(f"goal file '{path}': {name} {key} is {value!r}; it must be a number")
        result[units[key]] = units[key].from_report(float(value))
    return result


def save_goals(
    path: Path, goals: Goals, demonstrations: Mapping[Formation, Demonstration]
) -> None:
    """Write taught goals as `load_goals` reads them: YAML, and a PNG per formation beside it."""
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    peg = next(iter(demonstrations.values())).peg
    entries: dict[str, Any] = {}
    for formation in Formation:
        shown = demonstrations[formation]
        picture = f"{formation}.png"
        cv2.imwrite(str(path.parent / picture), cv2.cvtColor(shown.image, cv2.COLOR_RGB2BGR))
        entries[str(formation)] = {
            "goal": _report(goals.formations[formation]),
            "pose": _report({axis: shown.pose[axis] for axis in Axis}),
            "picture": picture,
        }
    document = {"schema": GOALS_SCHEMA, "peg": peg, "frame": "task", "formations": entries}
    path.write_text(yaml.safe_dump(document, sort_keys=False))


def _report(goal: Partial) -> dict[str, float]:
    return {f"{a}_{a.report_unit}": round(a.to_report(v), 3) + 0.0 for a, v in goal.items()}
