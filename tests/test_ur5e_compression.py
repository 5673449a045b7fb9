"""From force to compression: the wrist's spring, its noise, and how much earlier to stop."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.pose import rotation_matrix
from pliant.ur5e.compression import Compression
from pliant.ur5e.configuration import Configuration, load

EXAMPLE = load(Path(str(files("pliant") / "ur5e" / "example.yaml")))
UPRIGHT = np.eye(3)
TICK_S = 0.002
STOP_M_S2, LATENCY_S = 3.0, 0.015


def with_wrist(**fields: object) -> Configuration:
    return EXAMPLE.model_copy(update={"wrist": EXAMPLE.wrist.model_copy(update=fields)})


def read(
    compression: Compression,
    force: list[float],
    tool: np.ndarray,
    seconds: float,
    began: float = 1.0,
) -> None:
    """The same force for a while."""
    for k in range(round(seconds / TICK_S)):
        compression.read(began + k * TICK_S, np.array(force), tool)


def test_ten_newtons_press_a_wrist_of_one_newton_per_millimetre_by_ten() -> None:
    compression = Compression(EXAMPLE)
    read(compression, [0.0, 0.0, 10.0], UPRIGHT, 0.5)
    assert compression.now == pytest.approx(0.010, rel=1e-3)
    assert compression.mean == pytest.approx(0.010, rel=1e-3)


@pytest.mark.parametrize(
    ("axis", "sign", "force"),
    [("z", 1, [3, 4, 10]), ("z", -1, [3, 4, -10]), ("x", 1, [10, 0, 0]), ("y", -1, [0, -10, 0])],
)
def test_axis_and_sign_say_which_force_presses(axis: str, sign: int, force: list[float]) -> None:
    configuration = with_wrist(axis=axis, sign=sign, stiffness_n_mm=2.0)
    level = Compression(configuration)
    read(level, [0, 0, 0], UPRIGHT, 0.5)
    pressed = Compression(configuration)
    read(pressed, [float(f) for f in force], UPRIGHT, 0.5)
    assert pressed.now - level.now == pytest.approx(0.005, rel=1e-3)


@given(lean=st.floats(-0.4, 0.4))
def test_a_lean_takes_off_as_much_as_the_tool_presses_less(lean: float) -> None:
    compression = Compression(EXAMPLE)
    read(compression, [0.0, 0.0, 0.0], rotation_matrix(lean, 0.0, 0.0), 0.3)
    weight = EXAMPLE.payload.mass_kg * 9.81
    assert compression.now == pytest.approx(weight * (1 - np.cos(lean)) * 1e-3, abs=1e-6)


def test_after_taring_it_counts_from_there() -> None:
    compression = Compression(EXAMPLE)
    read(compression, [0.0, 0.0, 2.0], UPRIGHT, 0.5)
    compression.tare(np.full(100, 0.002), TICK_S)
    assert compression.now == 0.0
    read(compression, [0.0, 0.0, 5.0], UPRIGHT, 0.5, began=2.0)
    assert compression.now == pytest.approx(0.003, rel=1e-3)


def test_the_same_time_stamp_again_is_no_new_reading() -> None:
    compression = Compression(EXAMPLE)
    read(compression, [0.0, 0.0, 10.0], UPRIGHT, 0.01)
    before = compression.now
    for _ in range(100):
        compression.read(1.008, np.array([0.0, 0.0, 50.0]), UPRIGHT)
    assert compression.now == before


@given(seed=st.integers(0, 2**32 - 1), noise_n=st.floats(0.0, 3.0), speed_mm_s=st.floats(2.0, 20.0))
def test_contact_at_contact_speed_is_stopped_within_a_millimetre_past_the_limit(
    seed: int, noise_n: float, speed_mm_s: float
) -> None:
    """And, with 3 N of noise, no earlier than four millimetres before it."""
    rng = np.random.default_rng(seed)
    compression, limit, speed = Compression(EXAMPLE), 0.020, speed_mm_s * 1e-3
    threshold = limit - compression.allowance(speed, STOP_M_S2, LATENCY_S)
    depth, time_s = -0.005, 0.0
    while compression.now < threshold:
        time_s += TICK_S
        depth += speed * TICK_S
        force = 1e3 * max(depth, 0.0) + rng.normal(0.0, noise_n)
        compression.read(time_s, np.array([0.0, 0.0, force]), UPRIGHT)
    rest = depth + speed * LATENCY_S + speed**2 / (2 * STOP_M_S2)
    assert limit - 0.004 < rest < limit + 0.001
