"""What the simulated robot is told: the wrist's reading, exactly, or with noise that a filter then
takes out of what the compression limit is watched on, as a real controller's does; and the pictures
that the cameras deliver, beside what they see (`render`): now and then the one before, from some
time on always the same, or none near the board.

The filter lags by 30 ms: at 50 mm/s a limit is then passed by 1.5 mm before it is noticed. A dead
sensor feels nothing of what happens after the trial's begin.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pliant.cell import View
from pliant.conditions import Setup
from pliant.sim import constants as c

_FILTER_S = 0.030  # of the first-order low pass
_SHARE = -math.expm1(-c.CONTROL_PERIOD / _FILTER_S)  # of a new reading
_CAUGHT_UP_S = 4 * _FILTER_S
_DEVIATIONS = 4.0  # of the filtered noise


class Sensor:
    """The wrist's slide [m], read once in every control period."""

    def __init__(self, setup: Setup, slide: float) -> None:
        self._sd = setup.compression_noise
        self._hangs, self._scale = slide, setup.compression_scale
        self._dead_at = slide if setup.is_on("compression_dead") else None
        self._random = setup.stream("compression_noise")
        self._filtered = slide
        self.noise = 0.0  # of the last reading
        # How far the filtered value strays by itself.
        self.margin = _DEVIATIONS * self._sd * math.sqrt(_SHARE / (2.0 - _SHARE))
        self.delay_s = _CAUGHT_UP_S if self._sd else 0.0  # until it has caught up after a stop

    def felt(self, slide: float) -> float:
        """The slide [m] that the sensor feels for the one that is truly there."""
        if self._dead_at is not None:
            return self._dead_at
        return self._hangs + self._scale * (slide - self._hangs) if self._scale != 1.0 else slide

    def read(self, slide: float) -> None:
        """Take a reading of the slide, which is felt there."""
        if self._sd:
            self.noise = self._sd * float(self._random.standard_normal())
            self._filtered += _SHARE * (slide + self.noise - self._filtered)

    def watched(self, slide: float) -> float:
        """The slide [m] as the controller takes it to be: filtered, or, without noise, exactly as
        felt."""
        return self._filtered if self._sd else slide


class Feed:
    """The cameras of one trial, as they deliver their pictures."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._random = setup.stream("stale")
        self._last: dict[str, View] = {}  # picture of each camera

    def deliver(self, camera: str, time_s: float, height_m: float, see: Callable[[], View]) -> View:
        """What `see` gives, or the picture before with its old time stamp, or, of a camera that is
        stuck, with a new one; a dark one where the tip's height above the board is too low for it
        to be shown."""
        setup = self._setup
        is_stale = self._random.uniform() < setup.stale
        is_frozen = setup.is_on("pictures_frozen") and time_s > c.FREEZES_S
        if not ((is_stale or is_frozen) and camera in self._last):
            view = see()
            if setup.blind_below > 0.0 and height_m < setup.blind_below:
                view = replace(view, image=np.full_like(view.image, c.COVERED_LEVEL))
            self._last[camera] = view
        return replace(self._last[camera], time_s=time_s) if is_frozen else self._last[camera]
