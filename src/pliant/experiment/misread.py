"""A fault of measuring, on purpose: now and then the hole is read 10 mm beside where it is, or
always by as much. It is the sensor's, so it wraps the sight that a loop is given.

The picture is right and so is everything else in it: what a bad segmentation or a mirror-like
surface does, or a camera that was moved. A method sees it in no single reading, but can in a row of
them where some are right, and by what touch tells where none is.
"""

from dataclasses import replace

from pliant.cell import Observation
from pliant.conditions import Setup
from pliant.task import BLOCK_SIZE
from pliant.vision.scene import HoleSeen, Scene
from pliant.vision.sight import Sight

MISREAD_BY = 0.010  # [m] along y, to either side


class Misread:
    """A sight (protocol `pliant.vision.sight.Sight`) that is wrong about the hole: in a trial's
    share of the readings (`Setup.misread`), which the seed decides, and in all by
    `Setup.hole_misread`."""

    def __init__(self, sight: Sight, setup: Setup) -> None:
        self._sight, self.colours = sight, sight.colours
        self._share, self._always = setup.misread, setup.hole_misread
        self._random = setup.stream("misread")

    def __call__(self, observation: Observation) -> Scene:
        scene = self._sight(observation)
        chance, side = self._random.uniform(size=2)
        now = (MISREAD_BY if side < 0.5 else -MISREAD_BY) if chance < self._share else 0.0
        by = self._always + now
        return (
            scene if scene.hole is None or not by else replace(scene, hole=_moved(scene.hole, by))
        )


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
