"""The parts that both environments share: the cell, options checked once, seeds, the truth for
`info`, pictures."""

from collections.abc import Sequence
from typing import Any, TypeVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Truth
from pliant.conditions import Condition, Setup, condition
from pliant.errors import InputError, unknown
from pliant.sim.cell import SimCell, SimRobot

RENDER_MODES = ["rgb_array"]
_SEEDS = 2**31  # a reset without a seed draws the trial's from 0 to this


Seen = TypeVar("Seen")


def chosen(what: str, value: str, valid: Sequence[str]) -> str:
    """`value`, if it is one of the valid ones; else an InputError that lists them."""
    if value not in valid:
        raise unknown(what, value, valid)
    return value


def as_condition(given: str | Condition) -> Condition:
    return given if isinstance(given, Condition) else condition(given)


def check_action(action: object, size: int) -> NDArray[np.float64]:
    """Check an action (size,), and cut it to -1 to 1.

    Raises:
        InputError: it has another shape, or is not finite.
    """
    values = np.asarray(action, dtype=np.float64)
    if values.shape != (size,):
        raise InputError(f"action has shape {values.shape}: it must be ({size},)")
    if not np.isfinite(values).all():
        raise InputError(f"action {values.tolist()} is not finite: give numbers from -1 to 1")
    return np.clip(values, -1.0, 1.0)


def known(truth: Truth, setup: Setup) -> dict[str, Any]:
    """The truth as the environments' `info["truth"]`: for rewards, plots and privileged critics,
    not for a policy."""
    return {
        "inserted": bool(truth.inserted),
        "fit": bool(truth.fit),
        "depth_m": truth.depth_m,
        "tip_y": truth.tip[1],
        "tilt_rad": truth.tilt_rad,
        **setup.quantities(),
    }


class CellEnv(gymnasium.Env[Seen, NDArray[Any]]):
    """An environment on the simulated cell, with what was drawn for the trial that it is in."""

    needs_reset = "step and render"
    """What can be called only after `reset`."""

    def __init__(self, render_mode: str | None) -> None:
        if render_mode is not None:
            chosen("render_mode", render_mode, RENDER_MODES)
        self.render_mode = render_mode
        self._cell = SimCell()
        self._robot: SimRobot | None = None
        self._setup = Setup(seed=0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        if options:
            names = ", ".join(sorted(options))
            raise InputError(f"reset has no option '{names}': give the seed alone")
        return super().reset(seed=seed)

    def render(self) -> NDArray[np.uint8] | None:
        """The wide camera's picture (480, 640, 3), or None without a render mode."""
        if self.render_mode is None:
            return None
        return self._ready().observe(("wide",)).views["wide"].image

    def close(self) -> None:
        if self._robot is not None:
            self._robot.cameras.close()

    def _ready(self) -> SimRobot:
        if self._robot is None:
            raise gymnasium.error.ResetNeeded(f"call reset before {self.needs_reset}")
        return self._robot

    def _drawn_seed(self) -> int:
        return int(self.np_random.integers(_SEEDS))
