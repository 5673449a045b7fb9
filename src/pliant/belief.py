"""What the looks so far say about the hole and the grasp: a pure fold over measurements."""

from dataclasses import dataclass

from pliant.vision.scene import Measured


@dataclass(frozen=True, kw_only=True)
class Belief:
    """Estimates of what the method cannot know beforehand; None until something was seen.

    `grasp_roll` [rad] is the peg's angle in the grasp; `hole_y` [m] the hole's centre.
    """

    hole_y: Measured | None = None
    grasp_roll: Measured | None = None
    tip_bias_z: float | None = None  # seen minus expected height of the tip in free hang [m]
