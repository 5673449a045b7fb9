"""The rule of the wrist's limit, on readings to order."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.errors import RobotFault
from pliant.pose import Axis, Pose
from pliant.wrist import LIMIT_M, LOADED_M, OVER_M, Load, Reading, Watch, is_felt, is_straight

MARGIN_M = 0.0001
DOWN, UP, ACROSS = 0.01, -0.01, 0.0
READINGS = st.floats(-LIMIT_M - OVER_M, LIMIT_M + OVER_M)


def take(watch: Watch, *readings: float, margin: float = MARGIN_M, noise: float = 0.01) -> Watch:
    """Readings [m], a tenth of a second from each other; so noisy that none is a jump."""
    for reading in readings:
        time_s = 0.1 if watch.last is None else watch.last.time_s + 0.1
        watch.read(
            Reading(
                time_s=time_s,
                read_m=reading,
                filtered_m=reading,
                margin_m=margin,
                noise_m=noise,
            )
        )
    return watch


def read(*readings: float, margin: float = MARGIN_M) -> Watch:
    return take(Watch(), *readings, margin=margin)


def ended(watch: Watch, toward: float, readings: Iterable[float], stop_at: float = LIMIT_M) -> bool:
    """Whether a motion with these readings is ended, or not even begun."""
    first, *rest = readings
    if not watch.begin(first, toward, stop_at):
        return True
    return any(take(watch, reading).ends(reading, MARGIN_M) for reading in rest)


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
        take(watch, reading)
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


def test_a_blow_that_swings_past_it_for_a_moment_breaks_nothing() -> None:
    watch = Watch()
    for k in range(40):
        swing = 0.026 * math.sin(2 * math.pi * 5.3 * 0.01 * k)  # as the tool swings on its spring
        watch.read(Reading(time_s=0.01 * k, read_m=swing, filtered_m=swing))


# --- what cannot be true -------------------------------------------------------------------------


def pressing(*readings: float, toward: float = DOWN, noise: float = 0.0) -> Watch:
    watch = read(0.0)
    watch.begin(0.0, toward, LIMIT_M)
    return take(watch, *readings, noise=noise)


def doubt(*readings: float, toward: float = DOWN) -> str:
    with pytest.raises(RobotFault) as fault:
        pressing(*readings, toward=toward)
    assert fault.value.kind == "sensor"
    return str(fault.value)


def test_a_reading_that_does_not_change_in_a_motion_is_frozen() -> None:
    for toward in (DOWN, UP, ACROSS):
        assert "for a whole motion" in doubt(0.003, 0.003, 0.003, 0.003, toward=toward)
    pressing(0.003, 0.003, 0.0031, 0.0031, 0.003)
    at_rest = pressing(0.003)
    at_rest.rest()
    take(at_rest, *[0.003] * 9)


def test_a_press_that_reads_as_stretching_has_the_wrong_sign() -> None:
    assert "is its sign right?" in doubt(-0.001, -0.0025, -0.004, -0.006, -0.008)
    pressing(-0.001, -0.0025, -0.004, toward=UP)
    pressing(-0.001, -0.007, -0.001)  # a swing
    peg_popped_in = pressing(0.012, 0.001, -0.002)
    assert not peg_popped_in.ends(-0.002, MARGIN_M)


def test_a_jump_that_no_wrist_could_make_is_found() -> None:
    assert "jumped by -16.0 mm at once" in doubt(0.008, -0.008, -0.008)
    assert "jumped by -20.0 mm at once" in doubt(0.008, -0.009, -0.012)
    pressing(0.008, -0.008, -0.0081, noise=0.002, toward=UP)


def test_a_blow_to_a_held_peg_swings_back_and_is_no_jump() -> None:
    pressing(0.004, 0.021, 0.006, 0.0061, 0.006)
    pressing(0.0, -0.017, -0.001, 0.0, toward=UP)


def test_a_wrist_that_does_not_hang_where_it_hung_is_not_tared() -> None:
    watch = read()
    for hangs in (0.1, 0.1 + 0.9 * LOADED_M, 0.1 - 0.9 * LOADED_M):
        watch.tare(hangs)
    for hangs in (0.1 + 1.1 * LOADED_M, 0.1 - 1.1 * LOADED_M, math.nan):
        with pytest.raises(RobotFault, match="not tared") as fault:
            watch.tare(hangs)
        assert fault.value.kind == "loaded"
    watch.forget()
    watch.tare(0.3)


def test_a_motion_before_the_first_tare_is_watched_as_well() -> None:
    watch = Watch()
    assert watch.begin(0.0, DOWN, LIMIT_M)
    assert not watch.ends(0.001, MARGIN_M)
    assert watch.ends(0.0215, MARGIN_M)


# --- how a sensor answers to being pressed -------------------------------------------------------


def pressed(scale: float, noise: float = 0.0, slides: bool = False) -> Watch:
    """Down by 15 mm, 0.3 mm a reading, of which the last 6 press: as much is read as the wrist is
    pressed, times `scale`. Where it `slides`, the first millimetres give way."""
    watch, random = Watch(), np.random.default_rng(1)
    watch.begin(0.0, DOWN, LIMIT_M)
    for k in range(51):
        along = k * 0.0003
        press = max(0.0, along - 0.009)
        if slides:
            press = max(press / 3, along - 0.012)
        true = scale * press + 1e-9 * k  # no true reading stays the same
        watch.read(
            Reading(
                time_s=0.01 * k,
                read_m=true + float(random.normal(0.0, noise)),
                filtered_m=true,
                margin_m=noise,
                noise_m=noise,
                along_m=along,
            )
        )
    watch.rest()
    return watch


@pytest.mark.parametrize("scale", [0.3, 0.7, 1.0, 1.5])
def test_a_straight_press_tells_how_much_is_read_for_each_metre(scale: float) -> None:
    answer = pressed(scale).answer()
    assert answer is not None
    assert answer.sd == 0.0
    assert answer.slope == pytest.approx(scale, abs=1e-3)
    assert answer.is_within(2.0) is (scale == 1.0)


def test_a_tip_that_gives_way_at_first_answers_at_the_end() -> None:
    answer = pressed(1.0, slides=True).answer()
    assert answer is not None
    assert answer.slope == pytest.approx(1.0, abs=1e-3)


def test_what_noise_hides_is_known_to_a_standard_deviation_or_not_at_all() -> None:
    answer = pressed(1.0, noise=0.0003).answer()
    assert answer is not None
    assert answer.slope == pytest.approx(1.0, abs=0.2)
    assert 0.02 < answer.sd < 0.25
    assert pressed(1.0, noise=0.004).answer() is None


def test_who_presses_nothing_hears_no_answer() -> None:
    assert Watch().answer() is None
    assert pressed(0.0).answer() is None


@pytest.mark.parametrize(
    ("compression", "sd", "felt"),
    [(0.005, 0.001, True), (0.0035, 0.001, False), (0.0019, 0.0002, False), (0.005, 0.0, False)],
)
def test_a_noisy_wrist_is_felt_to_be_pressed_where_no_noise_can_feign_it(
    compression: float, sd: float, felt: bool
) -> None:
    assert is_felt(compression, sd) is felt


def test_only_a_way_straight_down_presses_and_does_nothing_else() -> None:
    at = Pose(z=0.2, roll=0.2)
    assert is_straight(at, at.updated({Axis.Z: 0.19}))
    for goal in ({Axis.Z: 0.21}, {Axis.Y: 0.01}, {Axis.Z: 0.19, Axis.Y: 0.002}):
        assert not is_straight(at, at.updated(goal))
    assert not is_straight(at, at.updated({Axis.Z: 0.19, Axis.ROLL: 0.15}))
