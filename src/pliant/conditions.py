"""The quantities that may differ from plan in a trial, and the conditions that draw them.

`Condition.draw(seed)` gives a `Setup`, what is actual in one trial: it belongs to the experiment's
side and never reaches a method (Sec. VI-A, "Randomized conditions").
"""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from pliant.errors import InputError, unknown
from pliant.pose import Axis


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity that can be drawn: the range that can be simulated, the axis whose unit it has
    (None: a bare number, or the `symbol` of what it counts), what it is, and its nominal value. Of
    a `two_sided` one the size is drawn from a range, and its sign besides."""

    valid: tuple[float, float]
    unit: Axis | None
    meaning: str
    nominal: float = 0.0
    two_sided: bool = False
    symbol: str = ""

    @property
    def si_unit(self) -> str:
        """The unit as results name it: m, rad, s, or 1."""
        if self.unit is None:
            return self.symbol or "1"
        return "rad" if self.unit.is_angle else "m"


_MM, _DEG = Axis.Y, Axis.ROLL  # any axis with that unit


def _quantity(low: float, high: float, meaning: str, unit: Axis | None = None, **other: Any) -> Any:
    """The field of `Setup` for a quantity that can be simulated from `low` to `high`."""
    quantity = Quantity(valid=(low, high), unit=unit, meaning=meaning, **other)
    return field(default=quantity.nominal, metadata={"quantity": quantity})


def _length(most: float, meaning: str, *, two_sided: bool = False) -> Any:
    return _quantity(0.0 if two_sided else -most, most, meaning, _MM, two_sided=two_sided)


def _angle(most_deg: float, meaning: str, *, two_sided: bool = False) -> Any:
    most = math.radians(most_deg)
    return _quantity(0.0 if two_sided else -most, most, meaning, _DEG, two_sided=two_sided)


def _size(most: float, meaning: str) -> Any:
    return _quantity(0.0, most, meaning, _MM)


def _share(meaning: str) -> Any:
    return _quantity(0.0, 1.0, meaning)


def _flag(meaning: str) -> Any:
    return _share(f"above 0.5: {meaning}")


def _factor(low: float, high: float, meaning: str) -> Any:
    return _quantity(low, high, meaning, nominal=1.0)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The actual value in one trial of every quantity that may differ from plan [m, rad, s, 1]; the
    first three are the paper's. Ground truth: it stays on the experiment's side."""

    seed: int
    friction: float = _factor(0.05, 20.0, "the hole's friction, as a factor on the nominal")
    hole_y: float = _length(0.04, "the hole's centre along y")
    grasp_roll: float = _angle(15, "the peg's angle in the grasp about x")
    hole_x: float = _length(0.02, "the hole's centre along x")
    board_z: float = _length(0.02, "the board's surface above the nominal")
    board_yaw: float = _angle(15, "the board's angle about z")
    grasp_pitch: float = _angle(10, "the peg's angle in the grasp about y")
    grasp_yaw: float = _angle(45, "the peg's turn in the grasp about its own axis", two_sided=True)
    looks: float = _flag("colours, textures, light, noise and camera places are random")
    occluder: float = _flag("a post before the side and one before the front camera")
    stale: float = _share("share of pictures that are the one before, with its time stamp")
    misread: float = _share("share of the hole's measurements that are 10 mm off")
    board_shift: float = _size(0.02, "how far the board is pushed when it is struck")
    board_shift_heading: float = _angle(180, "the direction of that push, about z from x")
    grasp_turn: float = _angle(
        10, "how far the peg turns in the grasp about x then", two_sided=True
    )
    grasp_slide: float = _size(0.01, "how far the peg slides up in the grasp then")
    struck_at: float = _quantity(
        0.0, 600.0, "when board and grasp are struck, on the robot's clock", nominal=8.0, symbol="s"
    )
    wrist_stiffness: float = _factor(0.2, 5.0, "the wrist's stiffness on every axis, as a factor")
    compression_noise: float = _size(
        0.002, "standard deviation of a reading of the wrist's compression"
    )
    peg_missing: float = _flag("the gripper holds no peg")
    peg_wider: float = _quantity(
        -0.01,
        0.02,
        "how much wider along x the peg is, which then is a box; 0: it is right",
        _MM,
    )
    peg_longer: float = _length(
        0.03, "how much longer the peg is, which then is a box; 0: it is right"
    )
    plugged_at: float = _size(0.05, "how far below the surface the hole is plugged; 0: it is not")
    bar_height: float = _size(0.02, "height of a steel bar across the board; 0: there is none")
    bar_y: float = _length(0.04, "that bar's middle along y from the hole's", two_sided=True)
    hole_misread: float = _length(
        0.02, "how far off every reading of the hole's y is", two_sided=True
    )
    compression_dead: float = _flag("the wrist's compression always reads the same")
    compression_scale: float = _factor(0.1, 3.0, "what the wrist's compression reads, as a factor")
    pictures_frozen: float = _flag(
        "after 4 s every camera's picture stays as it is, its time does not"
    )
    blind_below: float = _size(
        0.1, "while the tip is lower than this over the board no camera shows it"
    )

    def quantities(self) -> dict[str, float]:
        """Every quantity by its name, drawn or nominal."""
        return {name: getattr(self, name) for name in NOMINAL}

    def disturbed(self) -> dict[str, float]:
        """The quantities that are not nominal, by their names."""
        return {name: v for name, v in self.quantities().items() if v != NOMINAL[name]}

    def is_on(self, flag: str) -> bool:
        """Whether a quantity that is 0 or 1 counts as 1, by its name."""
        return float(getattr(self, flag)) > 0.5

    def stream(self, name: str) -> np.random.Generator:
        """A named stream of this trial's own random numbers, for what is not drawn once but again
        and again."""
        return _stream(self.seed, name)


QUANTITIES: Mapping[str, Quantity] = {
    f.name: f.metadata["quantity"] for f in fields(Setup) if f.metadata
}
"""The quantities that may differ from plan in a trial. The first three are the paper's."""

NOMINAL: Mapping[str, float] = {name: q.nominal for name, q in QUANTITIES.items()}

PAPER_RANGES: Mapping[str, tuple[float, float]] = {
    "friction": (1.0, 5.0),
    "hole_y": (-0.02, 0.02),
    "grasp_roll": (-math.radians(5), math.radians(5)),
}


def in_words(quantity: str, value: float) -> str:
    """A quantity's value as a person reads it: "-20 mm", "5 deg", "3"."""
    known = QUANTITIES[quantity]
    axis = known.unit
    if axis is None:
        return f"{value:g} {known.symbol}".rstrip()
    return f"{axis.to_report(value):g} {axis.report_unit}"


def check_range(what: str, quantity: str, low: float, high: float) -> None:
    """See that a quantity can be drawn from a range [m, rad, s, 1], which messages call `what`.

    Raises:
        InputError: it is out of order, or cannot be simulated.
    """
    least, most = QUANTITIES[quantity].valid
    if not least <= low <= high <= most:
        raise InputError(
            f"{what} from {in_words(quantity, low)} to {in_words(quantity, high)} cannot be; it"
            f" must lie in order within {in_words(quantity, least)} to {in_words(quantity, most)}"
        )


Ranges = Mapping[str, tuple[float, float]]
"""The range [m, rad, s, 1] of each quantity that is drawn, by its name."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A condition: the quantities that are drawn, each uniformly from its range; the others stay
    nominal. Where there are `scenarios`, every other trial, by chance, has one of them, whose
    ranges go before the condition's own.

    Raises:
        InputError: a quantity is unknown, or its range is out of order or cannot be simulated.
    """

    name: str
    ranges: Ranges = field(default_factory=dict)
    scenarios: Mapping[str, Ranges] = field(default_factory=dict)

    def __post_init__(self) -> None:
        all_ranges = (self.ranges, *self.scenarios.values())
        for name, (low, high) in (item for ranges in all_ranges for item in ranges.items()):
            if name not in QUANTITIES:
                raise unknown("quantity", name, QUANTITIES)
            check_range(f"condition '{self.name}': {name}", name, low, high)

    def draw(self, seed: int) -> Setup:
        """The trial's setup. Every quantity has a stream of its own, so that a seed means the same
        draw in every condition and for every peg."""
        scenario = self.scenario(seed)
        ranges = {**self.ranges, **(self.scenarios[scenario] if scenario is not None else {})}
        return Setup(seed=seed, **{name: _draw(seed, name, *r) for name, r in ranges.items()})

    def scenario(self, seed: int) -> str | None:
        """The name of the scenario that the trial has, for the experiment's side; None: none."""
        if not self.scenarios:
            return None
        stream = _stream(seed, "scenario")
        if stream.uniform() < 0.5:
            return None
        return list(self.scenarios)[int(stream.integers(len(self.scenarios)))]

    @property
    def quantities(self) -> list[str]:
        """The names of all quantities that a trial may draw."""
        return list(dict.fromkeys([*self.ranges, *(q for r in self.scenarios.values() for q in r)]))


def _draw(seed: int, name: str, low: float, high: float) -> float:
    stream = _stream(seed, name)
    size = float(stream.uniform(low, high))
    return -size if QUANTITIES[name].two_sided and stream.uniform() < 0.5 else size


def _stream(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


CONDITIONS: Mapping[str, Condition] = {
    name: Condition(name=name, ranges={q: PAPER_RANGES[q] for q in drawn})
    for name, drawn in {
        "none": (),
        "friction": ("friction",),
        "pose": ("hole_y", "grasp_roll"),
        "all": tuple(PAPER_RANGES),
    }.items()
}


def condition(name: str) -> Condition:
    """One of the paper's four conditions.

    Raises:
        InputError: no condition has that name.
    """
    if name not in CONDITIONS:
        raise unknown("condition", name, CONDITIONS)
    return CONDITIONS[name]
