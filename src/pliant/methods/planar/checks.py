"""The checks after one of the paper's single motions (Sec. V-A): the paper's own, and in metres
that the peg has left the near rim after Fit and stands between the rims after Align."""

from collections.abc import Mapping

from pliant.checks import (
    BESIDE_M,
    TILT_TOLERANCE_DEG,
    gathered,
    half_hole,
    low_corner,
    metric,
    metric_insertion,
    near_rim,
    standing,
    unmade,
)
from pliant.formations import Formation
from pliant.records import Check, Evidence, Outcome
from pliant.task import Task
from pliant.vision.scene import Scene

IN_HOLE_DEPTH_M = 0.0003  # Fit: the low corner is this far below the board's surface
RIM_MARGIN_M = 0.0005  # Fit: the trailing corner is this far inside the near rim


def check(task: Task, outcome: Outcome, taught: Mapping[Formation, Scene]) -> Evidence:
    """Make every check that the executed formation calls for."""
    metrics = {
        Formation.FIT: metric_fit,
        Formation.ALIGN: metric_align,
        Formation.INSERTION: metric_insertion,
    }
    return gathered(task, outcome, taught, metrics)


def metric_fit(task: Task, scene: Scene) -> Check:
    """Check that the low corner is in the hole and the trailing corner has cleared the near rim."""
    if scene.peg is None or scene.hole is None:
        return unmade("metric", scene)
    half = half_hole(task)
    depth = scene.hole.surface_z.value - low_corner(scene.peg)[1]
    past_rim = near_rim(task, scene) - scene.peg.right_y
    beyond = (scene.hole.y.value - half) - scene.peg.tip_y.value
    words = (
        f"low corner {depth * 1e3:.1f} mm deep,"
        f" trailing corner {past_rim * 1e3:.1f} mm past the near rim"
    )
    if beyond > 0:
        return metric(False, f"peg is {beyond * 1e3:.1f} mm beyond the far rim")
    return metric(depth >= IN_HOLE_DEPTH_M and past_rim >= RIM_MARGIN_M, words)


def metric_align(task: Task, scene: Scene) -> Check:
    """Check that both lower corners are inside the hole's rims, and the peg stands within 5
    degrees."""
    if scene.peg is None or scene.hole is None:
        return unmade("metric", scene)
    offset, tilt, depth, words = standing(scene.peg, scene.hole)
    inside = abs(offset) <= task.hole.clearance / 2 + BESIDE_M
    return metric(inside and abs(tilt) <= TILT_TOLERANCE_DEG and depth > 0.0, words)
