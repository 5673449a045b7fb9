"""The arm's tour above the board: a few safe poses, a picture of the hanging peg at each."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from pliant.calibration.camera import CalibrationShot
from pliant.calibration.outline import Points
from pliant.cell import View
from pliant.envelope import Guarded
from pliant.errors import RobotFault
from pliant.pose import Axis, Pose
from pliant.task import Task
from pliant.vision.measure import SIMULATED, Colours, largest_contour

SPEED_M_S = 0.05
LIMIT_M = 0.010  # of compression: nothing is to be touched
_STOPS = (  # y, the tip above the board, x [mm], roll, pitch [deg]
    (0, 60, 0, 0, 0),
    (-60, 60, -25, 0, 0),
    (-60, 30, 25, 12, 8),
    (-30, 45, 0, -12, -8),
    (0, 30, 25, 0, 8),
    (0, 45, -25, 15, 0),
    (30, 60, 25, -15, 0),
    (60, 30, -25, -12, 8),
    (60, 60, 25, 0, -8),
    (40, 45, 0, 12, -8),
    (0, 30, -25, -15, 0),
    (-40, 35, 25, 0, 0),
    (-80, 45, 0, -8, 0),
    (80, 45, 0, 8, 0),
    (20, 30, 25, 15, 8),
    (-20, 60, -25, 8, -8),
)
_LOOKS = (0.2, 0.3)  # [s] between looks at a peg that may still swing, in turn
_STILL_PX = 0.3  # of its middle and of its ends, in two looks running
_MOST_LOOKS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """A pose of the tour with its picture and outlines; no outlines, and the reason, where the
    picture is of no use."""

    pose: Pose
    view: View = field(repr=False)
    shot: CalibrationShot | None
    problem: str = ""


def stops(task: Task) -> list[Pose]:
    """The poses of the hinge point at which the tour stops."""
    return [
        Pose(
            x=x * 1e-3,
            y=y * 1e-3,
            z=task.tip_below_hinge + above * 1e-3,
            roll=math.radians(roll),
            pitch=math.radians(pitch),
        )
        for y, above, x, roll, pitch in _STOPS
    ]


def travel(
    robot: Guarded,
    task: Task,
    colours: Colours = SIMULATED,
    tell: Callable[[Taken], None] = lambda taken: None,
) -> list[Taken]:
    """Move the arm round the tour, leaving out stops outside the envelope, with a picture at each.

    Raises:
        RobotFault: the robot's own, or "touched" when something was in the way.
    """
    result = []
    for pose in stops(task):
        if robot.limits.outside({axis: pose[axis] for axis in Axis}, margin=True):
            continue
        motion = robot.move_to(pose, speed_m_s=SPEED_M_S, stop_at_compression_m=LIMIT_M)
        if motion.stop.is_early:
            raise RobotFault("touched", "something is in the arm's way above the board")
        result.append(_still_picture(robot, colours))
        tell(result[-1])
    return result


def _still_picture(robot: Guarded, colours: Colours) -> Taken:
    """Take a picture of the peg once two looks running found it in the same place."""
    before: Points | None = None
    agreed = 0
    for i in range(_MOST_LOOKS):
        robot.settle(_LOOKS[i % len(_LOOKS)])
        taken = _look(robot, colours)
        if taken.shot is None:
            return taken
        box = cv2.boxPoints(cv2.minAreaRect(taken.shot.peg.astype(np.float32)))
        marks = np.vstack([box.mean(axis=0), np.sort(box, axis=0)])
        moved = math.inf if before is None else float(np.max(np.abs(marks - before)))
        agreed = agreed + 1 if moved < _STILL_PX else 0
        if agreed == 2:
            return taken
        before = marks
    raise RobotFault("swinging", "the peg does not come to rest: damp the wrist, or hold it once")


def _look(robot: Guarded, colours: Colours) -> Taken:
    seen = robot.observe()
    view = seen.views["side"]
    hsv = cv2.cvtColor(view.image, cv2.COLOR_RGB2HSV).astype(np.uint8, copy=False)
    size = (view.camera.width, view.camera.height)
    peg = largest_contour(hsv, colours.peg)
    block = largest_contour(hsv, colours.block)
    if peg is None or _is_cut_off(peg, size):
        problem = "no peg in the picture" if peg is None else "the peg is cut off by the border"
        return Taken(pose=seen.pose, view=view, shot=None, problem=problem)
    if block is not None and _is_cut_off(block, size):
        block = None
    return Taken(
        pose=seen.pose, view=view, shot=CalibrationShot(pose=seen.pose, peg=peg, block=block)
    )


def _is_cut_off(contour: Points, size: Sequence[int]) -> bool:
    return bool(np.min(contour) < 1 or np.any(contour.max(axis=0) > np.array(size) - 1))
