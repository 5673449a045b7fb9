"""The belief of the paper's method: that the hole does not move, and that nothing is measured wrong
but by noise."""

import math
from dataclasses import replace

from pliant.belief import Belief, Seen
from pliant.formations import Formation
from pliant.teaching import Teaching
from pliant.vision.scene import Measured


def mean(belief: Belief, look: Seen, teaching: Teaching) -> Belief:
    """The belief after one more look. All readings of the hole share one calibration, so its
    estimate is their mean. The grasp angle is read at Approach, where the peg hangs freely: its
    tilt less the tilt that the same flange angle gave when the goals were taught with an aligned
    peg.
    """
    scene, taught = look.scene, teaching.scenes.get(Formation.APPROACH)
    if scene.hole is not None:
        seen, before = scene.hole.y, belief.hole_y
        readings = (*belief.readings.get("hole_y", ()), seen.value)
        value = seen.value
        if before is not None:
            value = before.value + (seen.value - before.value) / len(readings)
        belief = replace(
            belief,
            hole_y=Measured(value=value, sd=seen.sd),
            readings={**belief.readings, "hole_y": readings},
        )
    if (
        look.step.formation is Formation.APPROACH
        and scene.peg is not None
        and taught is not None
        and taught.peg is not None
    ):
        tilt, before_tilt = scene.peg.tilt, taught.peg.tilt
        sd = math.hypot(tilt.sd, before_tilt.sd)
        angle = Measured(value=tilt.value - before_tilt.value, sd=sd)
        belief = replace(belief, grasp_roll=angle)
    return belief
