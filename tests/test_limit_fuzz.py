"""The wrist's limit under hostile plans, wrong beliefs and lying sensors, a few of each kind: the
benchmark that this is taken from runs them by the hundred."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))

from limit_fuzz import SENSORS, emulated, simulated

from pliant.wrist import LIMIT_M

OVER_M = {"honest": 0.0025, "noisy": 0.0025}  # with any other sensor: 5 mm


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, str], list[tuple[float, str]]]:
    return simulated(len(SENSORS), first_seed=120, executions=6)


@pytest.mark.parametrize("sensor", SENSORS)
def test_no_plan_belief_or_sensor_lets_the_wrist_be_crushed(
    found: dict[tuple[str, str], list[tuple[float, str]]], sensor: str
) -> None:
    ended = [trial for (_, kind), trials in found.items() if kind == sensor for trial in trials]
    assert len(ended) == 2  # one a method
    for load_m, _ in ended:
        assert load_m < LIMIT_M + OVER_M.get(sensor, 0.005)


@pytest.mark.system
@pytest.mark.parametrize("noise_n", [0.0, 1.0])
def test_no_plan_crushes_the_wrist_of_the_emulated_arm(noise_n: float) -> None:
    assert emulated(3, noise_n, executions=6) < LIMIT_M + OVER_M["honest"]
