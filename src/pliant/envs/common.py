"""The parts that both environments share: options checked once, seeds, the truth for `info`,
pictures."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pliant.cell import Truth
from pliant.conditions import Condition, Setup, condition
from pliant.errors import InputError, unknown
from pliant.sim.cell import SimRobot

RENDER_MODES = ["rgb_array"]
RENDER_FPS = 25
SEEDS = 2**31  # a reset without a seed draws the trial's from 0 to this


def chosen(what: str, value: str, valid: Sequence[str]) -> str:
    """`value`, if it is one of the valid ones; else an InputError that lists them."""
    if value not in valid:
        raise unknown(what, value, valid)
    return value


def as_condition(given: str | Condition) -> Condition:
    return given if isinstance(given, Condition) else condition(given)


def check_render_mode(mode: str | None) -> str | None:
    return None if mode is None else chosen("render_mode", mode, RENDER_MODES)


def check_options(options: dict[str, Any] | None) -> None:
    if options:
        names = ", ".join(sorted(options))
        raise InputError(f"reset has no option '{names}': give the seed alone")


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


def picture(robot: SimRobot, camera: str) -> NDArray[np.uint8]:  # (480, 640, 3)
    return robot.observe((camera,)).views[camera].image
