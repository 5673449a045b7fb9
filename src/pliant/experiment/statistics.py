"""Intervals and tests for success rates: small, exact where they can be, from the standard library.

[W27]  Wilson 1927, the score interval of one proportion
[N98]  Newcombe 1998, Statistics in Medicine 17, 2635: paired proportions, method 10
[M47]  McNemar 1947, in its exact form: a two-sided binomial test of the discordant pairs
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A confidence interval, both ends included."""

    low: float
    high: float


def wilson(successes: int, n: int, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's score interval of a proportion, without continuity correction [W27].

    Raises:
        ValueError: `n` is below 1, `successes` outside 0 to n, or `confidence` outside (0, 1).
    """
    if not 0 <= successes <= n or n < 1:
        raise ValueError(f"{successes} of {n}: successes must be 0 to n, n at least 1")
    z = _quantile(confidence)
    p = successes / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return Interval(
        low=0.0 if successes == 0 else max(0.0, middle - half),
        high=1.0 if successes == n else min(1.0, middle + half),
    )


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Counts of how two methods succeeded on the same n trials.

    Raises:
        ValueError: a count is negative.
    """

    both: int
    only_first: int
    only_second: int
    neither: int

    def __post_init__(self) -> None:
        if min(self.both, self.only_first, self.only_second, self.neither) < 0:
            raise ValueError(f"{self}: counts must not be negative")

    @property
    def n(self) -> int:
        return self.both + self.only_first + self.only_second + self.neither

    @property
    def difference(self) -> float:
        """The first method's success rate less the second's."""
        return (self.only_first - self.only_second) / self.n


def paired_difference(pairs: Pairs, confidence: float = CONFIDENCE) -> Interval:
    """Interval of the difference of two paired proportions [N98, method 10].

    It squares and adds the Wilson intervals of both proportions, with their correlation.

    Raises:
        ValueError: there are no pairs.
    """
    n = pairs.n
    first, second = pairs.both + pairs.only_first, pairs.both + pairs.only_second
    one, two = wilson(first, n, confidence), wilson(second, n, confidence)
    p1, p2, phi = first / n, second / n, _correlation(pairs)
    down1, up1, down2, up2 = p1 - one.low, one.high - p1, p2 - two.low, two.high - p2
    below = math.sqrt(max(0.0, down1**2 - 2 * phi * down1 * up2 + up2**2))
    above = math.sqrt(max(0.0, up1**2 - 2 * phi * up1 * down2 + down2**2))
    difference = pairs.difference
    return Interval(low=max(-1.0, difference - below), high=min(1.0, difference + above))


def mcnemar(pairs: Pairs) -> float:
    """Two-sided p-value of the exact test that both methods succeed equally often [M47]."""
    discordant = pairs.only_first + pairs.only_second
    fewer = min(pairs.only_first, pairs.only_second)
    tail = term = 1  # sums of binomial coefficients, as integers: no rounding
    for k in range(1, fewer + 1):
        term = term * (discordant - k + 1) // k
        tail += term
    return min(1.0, 2 * tail / 2**discordant)


def _correlation(pairs: Pairs) -> float:
    """Correlation of the two methods' outcomes, with method 10's continuity correction where it is
    positive."""
    first, second = pairs.both + pairs.only_first, pairs.both + pairs.only_second
    product = first * (pairs.n - first) * second * (pairs.n - second)
    if product == 0:
        return 0.0
    covariance = float(pairs.both * pairs.neither - pairs.only_first * pairs.only_second)
    if covariance > 0:
        covariance = max(0.0, covariance - pairs.n / 2)
    return covariance / math.sqrt(product)


def _quantile(confidence: float) -> float:
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence}: it must lie between 0 and 1")
    return NormalDist().inv_cdf((1 + confidence) / 2)
