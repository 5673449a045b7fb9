"""What the looks so far say about the hole and the grasp: a pure fold over measurements."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from pliant.formations import Formation
from pliant.vision.scene import Measured, Scene


@dataclass(frozen=True, kw_only=True)
class Belief:
    """Estimates of what the method cannot know beforehand; None until something was seen.

    `hole_y` [m] is the hole's centre; `grasp_roll` [rad] the peg's angle in the grasp.
    """

    hole_y: Measured | None = None
    grasp_roll: Measured | None = None


def fold(scenes: Iterable[tuple[Formation, Scene]], taught_approach: Scene | None) -> Belief:
    """The belief after looking at `scenes` in order.

    The hole does not move and all its readings share one calibration, so its estimate is their
    mean. The grasp angle is read at Approach, where the peg hangs freely: its tilt less the tilt
    that the same flange angle gave when the goals were taught with an aligned peg.
    """
    belief = Belief()
    hole_readings = 0
    for formation, scene in scenes:
        if scene.hole is not None:
            hole_readings += 1
            seen, before = scene.hole.y, belief.hole_y
            mean = (
                seen.value
                if before is None
                else before.value + (seen.value - before.value) / hole_readings
            )
            belief = replace(belief, hole_y=Measured(value=mean, sd=seen.sd))
        if (
            formation is Formation.APPROACH
            and scene.peg is not None
            and taught_approach is not None
            and taught_approach.peg is not None
        ):
            seen, taught = scene.peg.tilt, taught_approach.peg.tilt
            angle = Measured(value=seen.value - taught.value, sd=math.hypot(seen.sd, taught.sd))
            belief = replace(belief, grasp_roll=angle)
    return belief
