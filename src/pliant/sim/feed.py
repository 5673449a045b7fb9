"""The pictures that the simulated cameras deliver, beside what they see (`render`): now and then
the one before, from some time on always the same, or none near the board."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pliant.cell import View
from pliant.conditions import Setup
from pliant.sim import constants as c


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
