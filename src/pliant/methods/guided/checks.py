"""The checks after a guided skill. Its goal is where it went by itself, Fit is right at the far
wall, and what is measured in metres takes the hole where it is believed to be, so that one wrong
reading fails nothing."""

from dataclasses import replace

from pliant.belief import Belief
from pliant.checks import (
    BESIDE_M,
    TILT_TOLERANCE_DEG,
    gathered,
    half_hole,
    low_corner,
    metric,
    metric_insertion,
    standing,
    unmade,
)
from pliant.formations import Formation
from pliant.methods.guided.touch import SLIDES_M, placed, shows_nothing
from pliant.records import Check, Evidence, Outcome
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.scene import Scene

UPRIGHT_DEPTH_M = 0.001  # Align: the high corner, beyond what is over-read
DEEP_M = 0.005  # Align: the high corner of a peg that is in the hole, wherever it is read
ASIDE_M = 0.003  # Align: the tip across the plane of insertion
_BY_TOUCH = ("metric", "goal_picture")
CORNER_IN_M = 0.0015  # a low corner so deep is in the hole
FAR_WALL_M = (-0.0055, 0.0025)  # where the low corner is read when it touches the far wall


def check(task: Task, outcome: Outcome, teaching: Teaching, belief: Belief) -> Evidence:
    """Make every check that the executed formation calls for: by touch, where nothing is seen."""
    metrics = {
        Formation.FIT: metric_far_wall,
        Formation.ALIGN: metric_upright,
        Formation.INSERTION: metric_insertion,
    }
    scene = placed(task, teaching, outcome.looks[-1], belief)
    if not shows_nothing(outcome.scene):
        return gathered(task, outcome, teaching.scenes, metrics, scene)
    surely = replace(task, depth=task.depth + SLIDES_M)
    evidence = gathered(surely, outcome, teaching.scenes, metrics, scene)
    return Evidence(
        checks=tuple(
            replace(c, message=f"by touch: {c.message}") if c.name in _BY_TOUCH else c
            for c in evidence.checks
        )
    )


def metric_far_wall(task: Task, scene: Scene) -> Check:
    """Check that the low corner is in the hole, near its far wall, while the trailing one stands on
    the rim, where a tight hole must leave it; or that both are in."""
    if scene.peg is None or scene.hole is None:
        return unmade("metric", scene)
    y, z = low_corner(scene.peg)
    depth = scene.hole.surface_z.value - z
    short = y - (scene.hole.y.value - half_hole(task))
    words = f"low corner {depth * 1e3:.1f} mm deep, {short * 1e3:+.1f} mm from the far wall"
    near = FAR_WALL_M[0] <= short <= FAR_WALL_M[1]
    inside = scene.hole.surface_z.value > max(scene.peg.left_z, scene.peg.right_z)
    return metric(depth >= CORNER_IN_M and (near or inside), words)


def metric_upright(task: Task, scene: Scene) -> Check:
    """Check as `metric_align` does, but well below the rim, and across the plane of insertion too.
    Of a deep peg little is seen, and where its tip is follows from far above it; but nothing is
    deep beside the hole."""
    if scene.peg is None or scene.hole is None:
        return unmade("metric", scene)
    offset, tilt, depth, words = standing(scene.peg, scene.hole)
    across, aside = scene.across, 0.0
    if across is not None and across.tip_x is not None and across.hole_x is not None:
        aside = across.tip_x.value - across.hole_x.value
    deep = depth >= DEEP_M
    beside = half_hole(task) if deep else task.hole.clearance / 2 + BESIDE_M
    inside = abs(offset) <= beside and (deep or abs(aside) <= ASIDE_M)
    stands = abs(tilt) <= TILT_TOLERANCE_DEG and depth >= UPRIGHT_DEPTH_M
    return metric(inside and stands, f"{words}, {aside * 1e3:+.1f} mm across")
