"""Intervals and tests agree with published values, and behave as intervals and tests must."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.experiment.statistics import Pairs, mcnemar, paired_difference, wilson

counts = st.integers(0, 400)
pairs_of = st.builds(
    Pairs, both=counts, only_first=counts, only_second=counts, neither=counts
).filter(lambda p: p.n > 0)
proportions = st.integers(1, 2000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [  # Newcombe 1998, Statistics in Medicine 17, 857, Table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_gives_the_published_intervals(
    successes: int, n: int, low: float, high: float
) -> None:
    interval = wilson(successes, n)
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(
    ("table", "low", "high"),
    [  # Newcombe 1998, Statistics in Medicine 17, 2635, Table III, method 10
        ((36, 12, 2, 0), 0.0569, 0.3404),
        ((18, 12, 2, 18), 0.0562, 0.3290),
        ((53, 0, 0, 1), -0.0729, 0.0729),
        # Altman et al. 2000, Statistics with Confidence, Table 6.2
        ((14, 5, 0, 22), 0.0115, 0.2265),
    ],
)
def test_the_paired_difference_has_the_published_interval(
    table: tuple[int, int, int, int], low: float, high: float
) -> None:
    interval = paired_difference(_pairs(*table))
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(
    ("table", "p"),
    [  # Fagerland et al. 2013, BMC Medical Research Methodology 13, 91: Bentur et al. 2009
        ((1, 1, 7, 12), 0.0703),
        ((14, 5, 0, 22), 0.0625),  # 2 / 2**5
        ((9, 0, 0, 4), 1.0),
    ],
)
def test_mcnemar_gives_the_exact_p_value(table: tuple[int, int, int, int], p: float) -> None:
    assert mcnemar(_pairs(*table)) == pytest.approx(p, abs=5e-5)


@given(proportions)
def test_wilson_holds_the_estimate_and_mirrors_with_it(case: tuple[int, int]) -> None:
    k, n = case
    interval, mirrored = wilson(k, n), wilson(n - k, n)
    assert 0.0 <= interval.low <= k / n <= interval.high <= 1.0
    assert mirrored.low == pytest.approx(1 - interval.high, abs=1e-12)


@given(proportions)
def test_wilson_narrows_with_more_trials_and_widens_with_confidence(case: tuple[int, int]) -> None:
    k, n = case
    width = _width(k, n, 0.95)
    assert _width(4 * k, 4 * n, 0.95) < width < _width(k, n, 0.99)


@given(pairs_of)
def test_the_paired_interval_holds_the_difference_and_mirrors(pairs: Pairs) -> None:
    interval, swapped = paired_difference(pairs), paired_difference(_swapped(pairs))
    assert -1.0 <= interval.low <= pairs.difference <= interval.high <= 1.0
    assert swapped.low == pytest.approx(-interval.high, abs=1e-12)


@given(pairs_of)
def test_mcnemar_is_a_probability_that_does_not_mind_the_order(pairs: Pairs) -> None:
    p = mcnemar(pairs)
    assert 0.0 <= p <= 1.0
    assert p == mcnemar(_swapped(pairs))
    assert pairs.only_first != pairs.only_second or p == 1.0


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_equals_the_binomial_sum(b: int, c: int) -> None:
    tail = sum(math.comb(b + c, k) for k in range(min(b, c) + 1)) / 2 ** (b + c)
    assert mcnemar(_pairs(3, b, c, 4)) == pytest.approx(min(1.0, 2 * tail))


def test_counts_that_cannot_be_are_refused() -> None:
    for successes, n in ((-1, 3), (4, 3), (0, 0)):
        with pytest.raises(ValueError, match="successes"):
            wilson(successes, n)
    with pytest.raises(ValueError, match="confidence"):
        wilson(1, 2, confidence=1.0)
    with pytest.raises(ValueError, match="negative"):
        _pairs(1, -1, 0, 0)


def _pairs(both: int, only_first: int, only_second: int, neither: int) -> Pairs:
    return Pairs(both=both, only_first=only_first, only_second=only_second, neither=neither)


def _swapped(pairs: Pairs) -> Pairs:
    return _pairs(pairs.both, pairs.only_second, pairs.only_first, pairs.neither)


def _width(k: int, n: int, confidence: float) -> float:
    interval = wilson(k, n, confidence)
    return interval.high - interval.low
