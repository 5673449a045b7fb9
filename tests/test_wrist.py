"""The rule of the wrist's limit, on readings to order."""

import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.errors import RobotFault
from pliant.wrist import LIMIT_M, OVER_M, Load, Watch

MARGIN_M = 0.0001
DOWN, UP, ACROSS = 0.01, -0.01, 0.0
READINGS = st.floats(-LIMIT_M - OVER_M, LIMIT_M + OVER_M)


def read(*readings: float, margin: float = MARGIN_M) -> Watch:
    watch = Watch()
    for reading in readings:
        watch.read(reading, margin)
    return watch


def ended(watch: Watch, toward: float, readings: Iterable[float], stop_at: float = LIMIT_M) -> bool:
    """Whether a motion with these readings is ended, or not even begun."""
    first, *rest = readings
    if not watch.begin(first, toward, stop_at):
        return True
    for reading in rest:
        watch.read(reading, MARGIN_M)
        if watch.ends(reading, MARGIN_M):
            return True
    return False


@pytest.mark.parametrize("side", [1, -1])
def test_past_the_limit_a_wrist_may_only_be_unloaded(side: int) -> None:
    for toward, allowed in ((DOWN, False), (ACROSS, True), (UP, True)):
        watch = read(side * 0.0205)
        assert watch.begin(side * 0.0205, side * toward, LIMIT_M) is allowed
    assert ended(read(side * 0.0205), ACROSS, [side * 0.0205, side * 0.0207])
    assert not ended(read(side * 0.0205), side * UP, [side * 0.0205, side * 0.0160, side * 0.0165])


def test_what_was_unloaded_is_not_lost_again_by_creeping_across() -> None:
    watch = read(0.0215, 0.0205)
    for reading in (0.0206, 0.0207, 0.0208):
        watch.read(reading, MARGIN_M)
        assert ended(watch, ACROSS, [reading, reading + 0.00005]) is (reading > 0.0205)


@pytest.mark.parametrize("side", [1, -1])
def test_a_wrist_that_came_back_may_be_pressed_again(side: int) -> None:
    assert read(side * 0.0205, side * 0.0199).load.side == side  # hardly
    watch = read(side * 0.0205, side * 0.0190)
    assert watch.load == Load()
    assert watch.begin(side * 0.019, side * DOWN, LIMIT_M)


def test_a_noisy_wrist_has_come_back_when_its_noise_cannot_say_so() -> None:
    assert read(0.0205, 0.0180, margin=0.003).load.side == 1
    assert read(0.0205, 0.0160, margin=0.003).load.side == 0


@pytest.mark.parametrize("stop_at", [0.004, 0.012, LIMIT_M])
def test_a_motion_ends_at_its_own_limit_when_pressed_and_at_the_wrists_when_stretched(
    stop_at: float,
) -> None:
    assert ended(read(), DOWN, [0.0, stop_at + 0.0001], stop_at)
    assert not ended(read(), DOWN, [0.0, stop_at - 0.0001], stop_at)
    assert not ended(read(), UP, [0.0, -stop_at + 0.0001], stop_at)
    assert ended(read(), UP, [0.0, -LIMIT_M - 0.0001], stop_at)


@given(st.lists(READINGS, max_size=12), READINGS)
def test_no_history_lets_a_loaded_wrist_be_loaded_on(readings: list[float], last: float) -> None:
    watch = read(*readings, last)
    if abs(last) > LIMIT_M:
        assert not watch.begin(last, math.copysign(DOWN, last), LIMIT_M)
        assert watch.begin(last, -math.copysign(DOWN, last), LIMIT_M)


@pytest.mark.parametrize("side", [1, -1])
def test_well_past_the_limit_the_cell_counts_as_broken(side: int) -> None:
    read(side * (LIMIT_M + 0.99 * OVER_M))
    with pytest.raises(RobotFault, match=r"(pressed|stretched) by 22\.6 mm") as fault:
        read(side * (LIMIT_M + 1.04 * OVER_M))
    assert fault.value.kind == "compression"


def test_noise_moves_where_a_cell_counts_as_broken_by_five_millimetres_at_most() -> None:
    read(LIMIT_M + 0.004, margin=0.0045)
    with pytest.raises(RobotFault):
        read(LIMIT_M + 0.0051, margin=0.1)
