"""What a method, a reasoner or a model sees holds nothing of where it came from, by value: no name
of a level, a scenario or a condition, no seed, and no quantity that was drawn."""

import re
from collections.abc import Mapping, Sequence, Set
from contextlib import closing
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import islice

import numpy as np
import pytest
from stand_ins import cell_for

from pliant.conditions import CONDITIONS, Condition, Setup, condition
from pliant.envelope import Limits
from pliant.experiment.bench.cases import SHIPPED, Cases, Origin
from pliant.experiment.one import Spec, composed
from pliant.levels import load_level, shipped_levels
from pliant.pose import Axis
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.prompt import instructions, situation
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Case, Verdict
from pliant.task import load_task, shipped_pegs
from pliant.teaching import shipped

SET = Cases(SHIPPED)
NAMES = frozenset(shipped_levels())
TOLD = Settings(measurements=True, picture=False, goal_picture=False, history=40)
LEAST_SEED = 1000  # a smaller one is a number like any other


@dataclass
class Held:
    """Every name, text and number in a record; pictures are left out."""

    texts: set[str] = field(default_factory=set)
    numbers: list[float] = field(default_factory=list)

    def add(self, value: object) -> None:
        if is_dataclass(value) and not isinstance(value, type):
            for f in fields(value):
                self.texts.add(f.name)
                self.add(getattr(value, f.name))
        elif isinstance(value, Mapping):
            self.texts.update(map(str, value))
            for item in value.values():
                self.add(item)
        elif isinstance(value, np.ndarray):
            if value.dtype != np.uint8:
                self.numbers += value.ravel().tolist()
        elif isinstance(value, str):
            self.texts.add(str(value))
        elif isinstance(value, Sequence):
            for item in value:
                self.add(item)
        elif isinstance(value, int | float):
            self.numbers.append(float(value))


def prompts(case: Case) -> str:
    told = situation(case, TOLD, asked="", verdict=Rules().judge(case))
    return "\n".join([instructions(TOLD, case, Limits()), *map(str, told)])


def drawn(of: Condition, setup: Setup) -> dict[str, float]:
    """What was drawn from a range, in SI units and as it is reported."""
    found: dict[str, float] = {}
    for name, (low, high) in of.ranges.items():
        if low < high:
            value = getattr(setup, name)
            found |= {name: value, f"{name} in mm": 1e3 * value}
            found[f"{name} in deg"] = Axis.ROLL.to_report(value)
    return found


def told(case: Case, names: Set[str], seed: int, values: Mapping[str, float]) -> list[str]:
    """What a case, or a prompt made from it, tells that it must not."""
    held = Held()
    held.add(case)
    text = "\n".join([*held.texts, prompts(case)])
    words = set(re.findall(r"[\w+]+", text)) | set(re.findall(r"\w+", text))
    written = [float(n) for n in re.findall(r"-?\d+\.\d{6,}", text)]
    numbers = np.unique(np.array(held.numbers + written))
    said = sorted(names & words)
    if seed >= LEAST_SEED and (seed in numbers or str(seed) in words):
        said.append(f"seed {seed}")
    for name, value in values.items():
        low, high = sorted((value * (1 - 1e-9), value * (1 + 1e-9)))
        if np.searchsorted(numbers, low) < np.searchsorted(numbers, high, side="right"):
            said.append(f"{name} {value}")
    return said


def condition_of(origin: Origin) -> Condition:
    """What was drawn in a trial of the set: the level's ranges, and a scenario's besides."""
    of_level = load_level(origin.level).on(condition("all"))
    if origin.condition in CONDITIONS:
        return Condition(name="", ranges={**of_level.ranges})
    return Condition(name="", ranges={**of_level.ranges, **load_level(origin.condition).ranges})


def test_no_case_of_the_set_tells_where_it_is_from() -> None:
    for question in SET:
        origin = question.key.origin
        of = condition_of(origin)
        values = drawn(of, of.draw(origin.seed))
        assert len(values) >= 9
        said = told(question.case, NAMES, origin.seed, values)
        assert not said, f"case {question.name}: {said}"


@dataclass(frozen=True)
class Keeps(Rules):
    """The rules, and the cases that they judged."""

    cases: list[Case] = field(default_factory=list)

    def judge(self, case: Case) -> Verdict:
        self.cases.append(case)
        return super().judge(case)


def cases(spec: Spec, most: int) -> list[Case]:
    """The first cases of a trial."""
    keeps, cell = Keeps(), cell_for(spec.task.peg.name)
    setup, taught = spec.condition.draw(spec.seed), shipped().for_task(spec.task)
    run = composed(spec, cell.prepare(spec.task, setup), setup, taught, keeps)
    with closing(iter(run)) as executions:
        list(islice(executions, most))
    return keeps.cases


@pytest.mark.parametrize("seed", [612344, 612345])
def test_no_case_of_a_trial_tells_its_condition_seed_or_setup(seed: int) -> None:
    mine = replace(condition("all"), name="zephyr")
    spec = Spec(task=load_task("circle"), condition=mine, seed=seed, reasoner="rules")
    values = drawn(mine, mine.draw(seed))
    last = cases(spec, 9)[-1]  # holds those before it
    assert not told(last, NAMES | {"zephyr"}, seed, values)


@pytest.mark.parametrize("level", ["L6+", "L8", "wrong_peg", "lying_camera"])
def test_no_case_of_a_guided_trial_tells_its_level_scenario_seed_or_setup(level: str) -> None:
    mine = load_level(level).on(replace(condition("all"), name="zephyr"))
    task = load_task("square", level)
    method = load_level(level).method
    spec = Spec(
        task=task, level=level, condition=mine, seed=612346, reasoner="rules", method=method
    )
    values = drawn(mine, mine.draw(612346))
    assert len(values) >= 9
    last = cases(spec, 3)[-1]
    assert not told(last, NAMES | {"zephyr"}, 612346, values)


def test_what_is_planted_is_found() -> None:
    mine = replace(condition("all"), name="zephyr")
    spec = Spec(task=load_task("circle"), condition=mine, seed=1, reasoner="rules")
    setup = mine.draw(1)
    values = drawn(mine, setup)
    case = cases(spec, 1)[0]
    for name, found in (("no_peg", ["no_peg"]), ("L6+", ["L6", "L6+"])):
        named = replace(case, task=replace(case.task, peg=replace(case.task.peg, name=name)))
        assert told(named, NAMES, 1, values) == found
    planted = replace(case.evidence.checks[0], message=f"seen at seed 612345, {setup.friction!r}")
    noted = replace(case, evidence=replace(case.evidence, checks=(planted,)))
    assert told(noted, NAMES, 612345, values) == ["seed 612345", f"friction {setup.friction}"]


def test_no_shipped_peg_is_called_as_a_level_or_a_scenario_is() -> None:
    assert not NAMES & set(shipped_pegs())
