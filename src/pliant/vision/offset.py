"""A camera that is not quite where its calibration says, corrected by a tip whose place the arm
knows: it shows everything near the peg too far to one side, by the same everywhere."""

import math
from dataclasses import dataclass

from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.scene import Measured, PegSeen

_UNKNOWN = Measured(value=0.0, sd=0.004)  # [m] of a third of a degree and a few millimetres


@dataclass(frozen=True, kw_only=True)
class Offset:
    """The offset to be added to where a camera's pictures show things, y and z [m] in its plane,
    each with its standard deviation. By default: of a camera that was not looked through yet."""

    y: Measured = _UNKNOWN
    z: Measured = _UNKNOWN

    @property
    def reach(self) -> float:
        """The distance [m] from their place at which things may still be seen."""
        return 0.0005 + 2.2 * max(self.y.sd, self.z.sd)


UNKNOWN = Offset()


def offset_between(predicted: tuple[Measured, Measured], seen: PegSeen) -> Offset:
    """The offset from where the arm knows the tip to be, y and z [m], and where a picture that was
    measured without an offset shows it."""
    pairs = zip(predicted, (seen.tip_y, seen.tip_z), (UNKNOWN.y, UNKNOWN.z), strict=True)
    y, z = (
        Measured(
            value=known.value - shown.value,
            sd=math.sqrt(known.sd**2 + max(0.0, shown.sd**2 - unknown.sd**2)),
        )
        for known, shown, unknown in pairs
    )
    return Offset(y=y, z=z)


def tip_in_line(task: Task, pose: Pose, tilt: float, pressed: float) -> tuple[float, float]:
    """The place of the tip, y and z [m], where tool and peg hang in a line from the hinge with that
    tilt, the wrist shorter by `pressed` [m] than unloaded."""
    below = task.tip_below_hinge
    return pose.y + below * math.sin(tilt), pose.z - below * math.cos(tilt) + pressed


def hanging_tip(
    task: Task, pose: Pose, tilt: Measured, *, hang_share: float, sag_m: float, sd: float = 0.0001
) -> tuple[Measured, Measured]:
    """The place of the tip, y and z [m], while the peg hangs freely with that tilt: the wrist
    stretched along the hand, by `sag_m` where that is upright, the tool below it at `hang_share` of
    the hand's roll, the peg below the grasp. `sd` [m] is that of the arm and these two."""
    tool, below = hang_share * pose.roll, task.tip_below_grasp
    sag = sag_m * math.cos(pose.roll)  # the part of the weight that stretches
    y = pose.y + sag * math.sin(pose.roll) + task.grasp_below_hinge * math.sin(tool)
    z = pose.z - sag * math.cos(pose.roll) - task.grasp_below_hinge * math.cos(tool)
    return (
        Measured(
            value=y + below * math.sin(tilt.value),
            sd=math.hypot(sd, below * math.cos(tilt.value) * tilt.sd),
        ),
        Measured(
            value=z - below * math.cos(tilt.value),
            sd=math.hypot(sd, below * math.sin(tilt.value) * tilt.sd),
        ),
    )
