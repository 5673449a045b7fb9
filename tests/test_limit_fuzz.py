"""The wrist's limit under hostile plans, wrong beliefs and lying sensors, simulated with both
methods and on the emulated arm: `benchmarks/limit_fuzz.py` tries more of the same."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))

from limit_fuzz import EMULATED, SENSORS, Ended, emulated, simulated

from pliant.methods.named import METHODS
from pliant.wrist import LIMIT_M

OVER_M = {"honest": 0.0025, "noisy": 0.0025}  # with any other sensor: 5 mm


def none_is_crushed(sensor: str, trials: list[Ended]) -> None:
    for trial in trials:
        assert trial.load_m < LIMIT_M + OVER_M.get(sensor, 0.005), (sensor, trial)


def test_no_plan_belief_or_sensor_lets_the_wrist_be_crushed() -> None:
    found = simulated(len(SENSORS), first_seed=120, executions=4)
    assert len(found) == len(METHODS) * len(SENSORS)
    for (_, sensor), trials in found.items():
        none_is_crushed(sensor, trials)


@pytest.mark.system
def test_five_hundred_hostile_plans_in_a_hundred_states_crush_no_wrist() -> None:
    found = simulated(66, first_seed=5001)
    trials = [trial for ended in found.values() for trial in ended]
    print(f"{sum(trial.plans for trial in trials)} plans in {len(trials)} trials")
    assert sum(trial.plans for trial in trials) >= 500
    assert len(trials) >= 100
    for (_, sensor), ended in found.items():
        none_is_crushed(sensor, ended)


@pytest.mark.system
@pytest.mark.parametrize("sensor", EMULATED)
def test_no_plan_or_sensor_crushes_the_wrist_of_the_emulated_arm(sensor: str) -> None:
    none_is_crushed(sensor, emulated(3, sensor, executions=8))
