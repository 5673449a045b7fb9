"""The compression of the wrist from the force that the controller measures (Sec. V-A).

The sensor sits above the wrist: along the wrist's axis the force is the spring's. What hangs below
it also presses on it less when the tool leans, which the simulated cell shows and the controller,
which compensates the payload, does not: it is put back, so that both cells count alike.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from pliant.ur5e.configuration import Configuration
from pliant.wrist import GRAVITY, Reading

_RECENT_S = 0.1  # what an observation is the mean of
_LEAST_MARGIN = 0.00015  # [m], for the tool's inertia
_DEVIATIONS = 4.0  # of the filtered noise


class Compression:
    """Reads forces, knows the compression [m] from free hang: `now` filtered, `mean` of the last
    tenth of a second."""

    def __init__(self, configuration: Configuration) -> None:
        wrist = configuration.wrist
        self.filter_s = wrist.filter_ms * 1e-3
        self.margin = _LEAST_MARGIN
        self._per_newton = 1e-3 / wrist.stiffness_n_mm  # [m/N]
        self._column, self._sign = "xyz".index(wrist.axis), wrist.sign
        self._weight = configuration.payload.mass_kg * GRAVITY
        self.noise_m = 0.0  # standard deviation of a reading
        self._zero = 0.0
        self._time_s = -math.inf
        self._recent: deque[tuple[float, float]] = deque()
        self.now = 0.0

    def read(self, time_s: float, force: NDArray[np.float64], tool: NDArray[np.float64]) -> None:
        """Take the force (3,) [N] of the surroundings on the tool and the tool's rotation (3, 3),
        both in base axes. The same time stamp again is no new reading."""
        if time_s <= self._time_s:
            return
        up = self._sign * tool[:, self._column]
        raw = (float(force @ up) + self._weight * (1.0 - float(up[2]))) * self._per_newton
        raw -= self._zero
        passed = time_s - self._time_s
        self._time_s = time_s
        self.now += (raw - self.now) * -math.expm1(-passed / max(self.filter_s, 1e-6))
        self._recent.append((time_s, raw))
        while self._recent[0][0] < time_s - _RECENT_S:
            self._recent.popleft()

    @property
    def mean(self) -> float:
        return float(np.mean([raw for _, raw in self._recent])) if self._recent else self.now

    @property
    def mean_sd(self) -> float:
        """The standard deviation that the readings' noise leaves in `mean` [m]."""
        return self.noise_m / math.sqrt(max(1, len(self._recent)))

    def tare(self, readings: NDArray[np.float64], period_s: float) -> None:
        """Count from the mean of `readings` (n,) [m], which were taken every `period_s` at rest in
        free hang; their noise says how far the filtered value may stray by itself."""
        kept = -math.expm1(-period_s / max(self.filter_s, 1e-6))
        self.noise_m = float(np.std(readings))
        deviation = self.noise_m * math.sqrt(kept / (2.0 - kept))
        self.margin = max(_LEAST_MARGIN, _DEVIATIONS * deviation)
        self._zero += float(np.mean(readings))
        self._recent.clear()
        self.now = 0.0

    def allowance(self, speed_m_s: float, stop_m_s2: float, latency_s: float) -> float:
        """The distance [m] by which to stop earlier than the limit: what the filter lags behind,
        the way until the arm begins to brake, and its braking."""
        delay_s = self.filter_s + latency_s
        return speed_m_s * delay_s + speed_m_s**2 / (2.0 * stop_m_s2)

    def reading(self, along_m: float | None) -> Reading:
        """The last reading, as the wrist's watch takes it, `along_m` on a straight press's way."""
        return Reading(
            time_s=self._time_s,
            read_m=self.latest,
            filtered_m=self.now,
            margin_m=self.margin,
            noise_m=self.noise_m,
            along_m=along_m,
        )

    @property
    def latest(self) -> float:
        """The last reading, unfiltered [m]."""
        return self._recent[-1][1] if self._recent else self.now
