"""A fault of measuring, on purpose: now and then the hole is read 10 mm beside where it is.

The picture is right and so is everything else in it: what a bad segmentation or a mirror-like
surface does. A method sees it in no single reading, but can in a row of them.
"""

from dataclasses import replace

from pliant.conditions import Setup
from pliant.task import BLOCK_SIZE
from pliant.vision.scene import HoleSeen, Scene

MISREAD_BY = 0.010  # [m] along y, to either side


class Misreading:
    """Wrong in a trial's share of the readings (`Setup.misread`): which ones, the seed decides."""

    def __init__(self, setup: Setup) -> None:
        self._share = setup.misread
        self._random = setup.stream("misread")

    def __call__(self, scene: Scene) -> Scene:
        """A reading as it reaches the method."""
        chance, side = self._random.uniform(size=2)
        if scene.hole is None or chance >= self._share:
            return scene
        return replace(scene, hole=_moved(scene.hole, MISREAD_BY if side < 0.5 else -MISREAD_BY))


def _moved(hole: HoleSeen, by: float) -> HoleSeen:
    """The hole seen `by` metres further to the right, its pixels with it."""
    columns = [u for u, _ in hole.box_px]
    pixels = by * (max(columns) - min(columns)) / BLOCK_SIZE[1]
    a, b, c, d = ((u + pixels, v) for u, v in hole.box_px)
    return replace(
        hole,
        box_px=(a, b, c, d),
        center_px=(hole.center_px[0] + pixels, hole.center_px[1]),
        y=replace(hole.y, value=hole.y.value + by),
    )
