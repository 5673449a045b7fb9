"""The ladder: named levels of difficulty, as data (`levels.yaml`), on top of the paper's grid; and
scenarios in which the task itself is wrong (`scenarios.yaml`), which are run in the same way.

A level sets the hole's clearance and the depth that counts as inserted, adds to what a condition
draws, and names the method that its axes need and the pegs that it is measured with. A scenario
says besides what is right in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources

from pliant import files
from pliant.conditions import CONDITIONS, QUANTITIES, Condition, Quantity, Ranges
from pliant.diagnosis import Hypothesis
from pliant.errors import unknown
from pliant.pose import Axis

COLOUR, EDGES = "colour", "edges"
INSERTED_DEPTH_M = 0.010
"""The depth [m] below the board's surface of an inserted peg's bottom face, at its centre: the
paper's criterion of overall success."""

INSERT, STOP, EITHER = "insert", "stop", "either"


@dataclass(frozen=True, kw_only=True)
class Level:
    """A rung of the ladder: `clearance` [m] in place of a peg file's own, `depth` [m] of insertion,
    `ranges` that are drawn besides a condition's own, the `method` that is used unless another is
    asked for, and the `senses` that measure its pictures. `right` is what a method should do in the
    end: insert, stop and say so, or either; `truly` are the hypotheses that are right about it. Of
    its `scenarios` one trial in two has one, which then says what is right."""

    name: str
    tests: str
    clearance: float | None
    depth: float
    ranges: Ranges
    method: str
    senses: str
    pegs: tuple[str, ...]
    right: str = INSERT
    truly: tuple[Hypothesis, ...] = (Hypothesis.AS_TOLD,)
    is_scenario: bool = False
    scenarios: Mapping[str, Ranges] = field(default_factory=dict)

    @property
    def may_be_wrong(self) -> bool:
        """Whether a trial's task may be wrong, so that stopping may be right."""
        return self.is_scenario or bool(self.scenarios)

    def in_trial(self, seed: int) -> "Level":
        """The level that says what is right in the trial of a seed: its scenario, if it has one."""
        scenario = self.on(CONDITIONS["none"]).scenario(seed)
        return self if scenario is None else load_level(scenario)

    def on(self, condition: Condition) -> Condition:
        """A condition with what the level draws besides. Where both draw a quantity, a condition of
        the user's own keeps its range, and one of the paper's takes the level's."""
        first, then = self.ranges, condition.ranges
        if condition.name in CONDITIONS:
            first, then = then, first
        return replace(condition, ranges={**first, **then}, scenarios=self.scenarios)


def load_level(name: str) -> Level:
    """The level or scenario of that name.

    Raises:
        InputError: no level has that name.
    """
    levels = shipped_levels()
    if name not in levels:
        raise unknown("level", name, levels)
    return levels[name]


@cache
def shipped_levels() -> Mapping[str, Level]:
    """Every level by its name, from the lowest rung, and then the scenarios."""
    rungs, scenarios = (
        files.parse_yaml((resources.files("pliant") / name).read_bytes(), name).fields()
        for name in ("levels.yaml", "scenarios.yaml")
    )
    levels: dict[str, Level] = {}
    for name, fields in {**rungs, **scenarios}.items():
        ranges: dict[str, tuple[float, float]] = {}
        for other in fields.get("like", []):
            ranges.update(levels[other].ranges)
        for drawn, (low, high) in fields.get("draws", {}).items():
            quantity, axis = FIELDS[drawn]
            in_si = [float(v) if axis is None else axis.from_report(v) for v in (low, high)]
            ranges[quantity] = (in_si[0], in_si[1])
        clearance, depth = fields.get("clearance_mm"), fields.get("depth_mm")
        levels[name] = Level(
            name=name,
            tests=fields["tests"],
            clearance=None if clearance is None else clearance * 1e-3,
            depth=INSERTED_DEPTH_M if depth is None else depth * 1e-3,
            ranges=ranges,
            method=fields.get("method", "guided"),
            senses=fields.get("senses", COLOUR),
            pegs=tuple(fields.get("pegs", ("circle", "square", "rectangle_narrow"))),
            right=fields.get("right", INSERT),
            truly=tuple(Hypothesis(h) for h in fields.get("truly", [Hypothesis.AS_TOLD])),
            is_scenario=name in scenarios,
        )
    for name, fields in rungs.items():
        mixed = {s: levels[s].ranges for s in fields.get("scenarios", [])}
        levels[name] = replace(levels[name], scenarios=mixed)
    return levels


def _field(name: str, quantity: Quantity) -> str:
    unit = quantity.symbol if quantity.unit is None else quantity.unit.report_unit
    return f"{name}_{unit}" if unit else name


FIELDS: Mapping[str, tuple[str, Axis | None]] = {
    _field(name, q): (name, q.unit) for name, q in QUANTITIES.items()
}
"""The fields by which a level or a custom condition draws: the field's name, the quantity, its
unit's axis."""
