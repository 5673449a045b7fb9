"""Numbers and outcomes in words for people: millimetres, degrees, true minus signs."""

import math

from pliant.cell import Truth
from pliant.conditions import QUANTITIES
from pliant.formations import Step
from pliant.pose import Axis, Partial, Pose
from pliant.records import End, Trial
from pliant.text import rounded

_ENDS = {
    End.INSERTED: "judged inserted",
    End.EXHAUSTED: "gave up: ten failed verdicts in a row",
    End.CAP: "stopped at forty executions, the most that a trial may take",
    End.STOPPED: "the reasoner could not or should not go on",
    End.REFUSED: "nothing of the reasoner's plan may be done",
    End.FINISHED: "the open-loop plan ran out",
}
_DRAWN = {
    "friction": "friction of the hole",
    "hole_y": "hole's place y",
    "grasp_roll": "grasp angle",
    "looks": "random looks",
    "stale": "stale pictures",
    "misread": "misread hole",
}
_FACTORS = ("friction", "wrist_stiffness")


def number(value: float, digits: int = 1, *, sign: bool = False) -> str:
    """A number in so many digits, with a true minus sign."""
    value = rounded(value, digits)
    shown = f"{value:+.{digits}f}" if sign and value else f"{value:.{digits}f}"
    return shown.replace("-", "\N{MINUS SIGN}")


def millimetres(metres: float) -> str:
    return f"{number(metres * 1e3)} mm"


def in_units(axis: Axis, value: float, *, sign: bool = False) -> str:
    """An axis's value in its unit for people: "−35.0 mm", "10.0°"."""
    return f"{number(axis.to_report(value), sign=sign)}{unit(axis)}"


def unit(axis: Axis) -> str:
    return "°" if axis.is_angle else " mm"


def goal(partial: Partial) -> str:
    return ", ".join(f"{axis} {in_units(axis, value)}" for axis, value in partial.items())


def pose(at: Pose) -> str:
    return goal({axis: at[axis] for axis in Axis})


def step(planned: Step) -> str:
    retreat = ", after a retreat" if planned.retreat else ""
    return f"{str(planned.formation).capitalize()} to {goal(planned.goal)}{retreat}"


def yes_no(value: bool | None) -> str:
    return "not known" if value is None else "yes" if value else "no"


def end(trial: Trial) -> str:
    """The reason why the trial ended, in words."""
    if trial.end_reason in list(End):
        return _ENDS[End(trial.end_reason)]
    return f"{trial.end_reason}: {trial.fault}" if trial.fault else trial.end_reason


def drawn(name: str, value: float) -> tuple[str, str]:
    """A drawn quantity's name and value, in words."""
    words, known = _DRAWN.get(name, name.replace("_", " ")), QUANTITIES[name]
    if known.unit is not None:
        return words, in_units(known.unit, value)
    if name in _FACTORS:
        return words, f"× {number(value, 2)}"
    return words, f"{number(value, 2)} {known.symbol}".rstrip()


def drawn_range(name: str, bounds: tuple[float, float]) -> str:
    """The range of a drawn quantity, in words: "hole's place y 8.0 mm to 12.0 mm"."""
    (words, low), (_, high) = (drawn(name, value) for value in bounds)
    return f"{words} {low} to {high}"


def drawn_unit(name: str) -> str:
    """A drawn quantity's unit, in a heading."""
    known = QUANTITIES[name]
    if known.unit is not None:
        return known.unit.report_unit.replace("deg", "°")
    return "factor" if name in _FACTORS else known.symbol or "share"


def truth(now: Truth) -> list[tuple[str, str]]:
    """The truth as names and values; of a real cell, a person's label."""
    label = ("inserted", yes_no(now.inserted))
    _, y, z = now.tip
    if not math.isfinite(z):
        return [label]
    return [
        label,
        ("low corner in the hole", yes_no(now.fit)),
        ("depth", millimetres(now.depth_m)),
        ("tip y, z", f"{number(y * 1e3)}, {number(z * 1e3)} mm"),
        ("tilt", in_units(Axis.ROLL, now.tilt_rad)),
        ("hole y", millimetres(now.hole_y)),
        ("compression", millimetres(now.compression_m)),
    ]
