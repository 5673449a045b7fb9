"""A cell of your own: the simulated one, seen through a camera that is out of focus.

pliant run --cell examples/13_your_own_cell.py:OutOfFocus
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Observation, Robot
from pliant.conditions import Setup
from pliant.sim.cell import SimCell
from pliant.task import Task

BLUR_PX = 15


def blurred(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.GaussianBlur(image, (BLUR_PX, BLUR_PX), 0), np.uint8)


class Blurred:
    """A robot (protocol `pliant.cell.Robot`) whose pictures are blurred; all else is passed on."""

    def __init__(self, robot: Any) -> None:
        self._robot = robot

    def __enter__(self) -> Self:
        self._robot.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._robot.__exit__(*error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robot, name)

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        seen: Observation = self._robot.observe(cameras)
        views = {
            name: replace(view, image=blurred(view.image)) for name, view in seen.views.items()
        }
        return replace(seen, views=views)


class OutOfFocus(SimCell):
    """A workcell (protocol `pliant.cell.Workcell`)."""

    kind = "out_of_focus"

    def prepare(self, task: Task, setup: Setup) -> Robot:  # type: ignore[override]
        return Blurred(super().prepare(task, setup))


if __name__ == "__main__":
    import pliant

    for cell in (SimCell(), OutOfFocus()):
        trial = pliant.run(cell=cell)
        peg = trial.executions[0].outcome.scene.peg
        found = "not seen" if peg is None else f"y {peg.tip_y.value * 1e3:.2f} mm"
        print(f"{cell.kind}: {trial.end_reason}, inserted {trial.inserted}; tip at first {found}")
