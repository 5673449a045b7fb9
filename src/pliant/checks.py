"""The success checks of one execution: Table I, pose and compression as in the paper, and pliant's
own metric check beside them (Sec. V-A).

Table I is applied to the picture's pixels, literally. Where it cannot see a failure (the trailing
corner still on the near rim looks like a fit), the metric check votes too. A check that cannot be
made has no vote, and says why.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from pliant.belief import Belief, sag_m
from pliant.cell import Stop
from pliant.formations import OWNED, Formation
from pliant.levels import INSERTED_DEPTH_M
from pliant.pose import Partial, describe
from pliant.records import Check, Evidence, Outcome
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.scene import HoleSeen, PegSeen, Scene

POSE_TOLERANCE_M = 0.001  # the paper's p_th
POSE_TOLERANCE_RAD = math.radians(0.5)  # our choice
TILT_TOLERANCE_DEG = 5.0  # Table I
ON_HOLE_M = 0.008  # Table I's "on the hole": P_center this close to H_center; our choice

BESIDE_M = 0.0015  # metric Align: the tip this far beyond the play, at most, from the hole's centre
DEPTH_MARGIN_M = 0.0008  # metric Insertion: measured depth this far beyond the criterion

SEEN_M = 0.015  # pressed further than felt, by the picture: the sensor is wrong
MOST_SLID_M = 0.010  # 11 mm were seen in one of 98 trials of L6+
UNFELT_M = 0.003  # the tip, below the surface: a peg may go in without being felt


def gathered(
    task: Task,
    outcome: Outcome,
    taught: Mapping[Formation, Scene],
    metrics: Mapping[Formation, Callable[[Task, Scene], Check]],
    scene: Scene | None = None,
) -> Evidence:
    """Make every check that the executed formation calls for, with a method's own in metres. Table
    I reads the picture as it is; `scene` is what the others go by, if not what was measured
    last. The check in metres says too where two sights contradict each other."""
    scene = outcome.scene if scene is None else scene
    formation = outcome.step.formation
    checks = [pose_check(outcome), compression_check(outcome)]
    if formation in (Formation.FIT, Formation.ALIGN):
        checks.append(table_i(formation, outcome.scene, on_hole_px(outcome)))
    if formation in metrics:
        metric = metrics[formation](task, scene)
        doubts = outcome.scene.doubts
        checks.append(replace(metric, message="; ".join([metric.message, *doubts])))
    if formation is Formation.INSERTION:
        checks.append(goal_picture(scene, taught.get(formation)))
    return Evidence(checks=tuple(checks))


# --- the paper's checks ------------------------------------------------------------------------


def pose_check(outcome: Outcome) -> Check:
    """Check the terminal pose over the axes that the formation owns: the distance to the goal is at
    most 1 mm (the paper's p_th), each angle within 0.5 degrees."""
    owned = OWNED[outcome.step.formation]
    error = outcome.target.error(outcome.pose, owned)
    distance = math.hypot(*(e for a, e in error.items() if not a.is_angle))
    turned = max((abs(e) for a, e in error.items() if a.is_angle), default=0.0)
    reached = distance <= POSE_TOLERANCE_M and turned <= POSE_TOLERANCE_RAD
    if reached:
        return Check(name="pose", vote=True, message=f"reached {describe(outcome.step.goal)}")
    off = {a: e for a, e in error.items() if abs(e) > 0.1 * POSE_TOLERANCE_M}
    return Check(name="pose", vote=False, message=f"off by {_signed(off)}")


def compression_check(outcome: Outcome) -> Check:
    """Check whether the compression limit ended a motion."""
    peak = f"{outcome.peak_compression_m * 1e3:.1f} mm"
    if outcome.stop is Stop.COMPRESSION:
        return Check(name="compression", vote=False, message=f"limit reached at {peak}")
    return Check(name="compression", vote=True, message=f"at most {peak}")


def table_i(formation: Formation, scene: Scene, on_hole: float) -> Check:
    """Apply Table I, with the paper's words. `on_hole` is the tolerance in pixels."""
    if scene.peg is None or scene.hole is None:
        return Check(name="table_i", vote=None, message="; ".join(scene.problems))
    center, edge = scene.peg.center_px[0], scene.peg.edge_px[0]
    hole = scene.hole.center_px[0]
    if formation is Formation.FIT:
        message = _fit_message(center, edge, hole)
        return Check(name="table_i", vote=message == "success", message=message)
    message = _align_message(center - hole, scene.peg.tilt_deg, on_hole)
    return Check(name="table_i", vote=message == "Align success", message=message)


def _fit_message(center: float, edge: float, hole: float) -> str:
    if center <= hole:
        return "success" if edge > hole else "p_gy was too small."
    return "p_gy was too big."


def _align_message(offset: float, tilt_deg: float, on_hole: float) -> str:
    side = 0 if abs(offset) <= on_hole else (-1 if offset < 0 else 1)
    lean = 0 if abs(tilt_deg) <= TILT_TOLERANCE_DEG else (1 if tilt_deg > 0 else -1)
    return {
        (0, 0): "Align success",
        (0, 1): "peg is tilted to the left.",
        (0, -1): "peg is tilted to the right.",
        (-1, 0): "p_ey was too small.",
        (1, 0): "p_ey was too big.",
        (-1, 1): "peg is tilted to the left. p_gy was too small.",
        (1, 1): "p_gy was too big. also tilted to the left.",
        (-1, -1): "p_gy was too small. also tilted to the right.",
        (1, -1): "p_gy was too big. also tilted to the right.",
    }[side, lean]


def on_hole_px(outcome: Outcome) -> float:
    """The tolerance of Table I's "on the hole" in the outcome's picture [px]."""
    camera = outcome.looks[-1].observation.views["side"].camera
    return ON_HOLE_M / camera.metres_per_pixel(0.0)


# --- whether the wrist's compression can be believed --------------------------------------------


def doubt(
    task: Task, outcome: Outcome, belief: Belief, teaching: Teaching, *, answered: bool
) -> str | None:
    """The reason why what was read of the wrist's compression cannot be true, or None: it is held
    against how high the picture shows the tip. `answered` says whether the wrist's sensor has
    answered to being pressed at all, which by the end of Insertion only a peg that is in the hole
    excuses."""
    felt = outcome.looks[-1].observation.compression_m
    seen = seen_compression(task, outcome, belief, teaching)
    if seen is not None and seen - felt > SEEN_M:
        return f"the picture shows {seen * 1e3:.1f} mm, {felt * 1e3:.1f} mm is felt"
    scene = outcome.scene
    if outcome.step.formation is not Formation.INSERTION or answered:
        return None
    if scene.peg is None:
        return "it has never answered to being pressed, and no picture shows where the peg is"
    surface = scene.hole.surface_z.value if scene.hole is not None else 0.0
    if scene.peg.tip_z.value < surface - UNFELT_M:
        return None
    return "it has never answered to being pressed as it should"


def slid(task: Task, outcome: Outcome, belief: Belief, teaching: Teaching) -> float | None:
    """The distance [m] that the peg has slid up in the grasp, by what is seen more than felt, or
    None if the peg is not seen. No peg is believed to slide further than by `MOST_SLID_M`."""
    seen = seen_compression(task, outcome, belief, teaching)
    if seen is None:
        return None
    return min(MOST_SLID_M, max(0.0, seen - outcome.looks[-1].observation.compression_m))


def sunk(scene: Scene) -> float | None:
    """The depth [m] to which a picture shows the tip in the hole of a board that is no higher than
    nominal, 0 where it shows it above; None: the peg is not seen."""
    if scene.peg is None:
        return None
    surface = min(0.0, scene.hole.surface_z.value) if scene.hole is not None else 0.0
    depth = surface - scene.peg.tip_z.value
    return depth if depth > UNFELT_M else 0.0


def seen_compression(
    task: Task, outcome: Outcome, belief: Belief, teaching: Teaching
) -> float | None:
    """The wrist's compression [m] by the tip's height in the last picture; a peg that slid up in
    the grasp adds to it. None: the peg is not seen."""
    peg, pose = outcome.scene.peg, outcome.pose
    if peg is None:
        return None
    grasp = belief.grasp_roll.value if belief.grasp_roll is not None else 0.0
    tilt = peg.tilt.value
    above = task.grasp_below_hinge * math.cos(tilt - grasp) + task.tip_below_grasp * math.cos(tilt)
    return peg.tip_z.value - (pose.z - sag_m(teaching) - above)


# --- pliant's own checks -----------------------------------------------------------------------


def standing(peg: PegSeen, hole: HoleSeen) -> tuple[float, float, float, str]:
    """The tip's offset from the hole's centre along y [m], the tilt [deg], the high corner's depth
    [m], and these in words."""
    offset = peg.tip_y.value - hole.y.value
    tilt = math.degrees(peg.tilt.value)
    depth = hole.surface_z.value - max(peg.left_z, peg.right_z)
    words = (
        f"tip {offset * 1e3:+.1f} mm from the hole,"
        f" high corner {depth * 1e3:.1f} mm deep, tilt {tilt:.1f} deg"
    )
    return offset, tilt, depth, words


def metric_insertion(task: Task, scene: Scene) -> Check:
    """Check that the centre of the bottom face is 10 mm deep, inside the hole."""
    if scene.peg is None or scene.hole is None:
        return unmade("metric", scene)
    depth = scene.hole.surface_z.value - scene.peg.tip_z.value
    offset = scene.peg.tip_y.value - scene.hole.y.value
    words = f"{depth * 1e3:.1f} mm deep, {offset * 1e3:+.1f} mm from the hole's centre"
    deep = depth >= task.depth + DEPTH_MARGIN_M
    return metric(deep and abs(offset) <= half_hole(task), words)


def goal_picture(scene: Scene, taught: Scene | None) -> Check:
    """Compare the picture with the goal picture, relative to the hole: as much of the peg is
    hidden, to the criterion's depth, and it stands as upright. The paper asks the VLM this
    question."""
    if taught is None or taught.peg is None or taught.hole is None:
        return Check(name="goal_picture", vote=None, message="no goal picture", paper=True)
    if scene.peg is None or scene.hole is None:
        return unmade("goal_picture", scene, paper=True)
    height = scene.peg.tip_z.value - scene.hole.surface_z.value
    goal = taught.peg.tip_z.value - taught.hole.surface_z.value
    lean = math.degrees(scene.peg.tilt.value - taught.peg.tilt.value)
    words = (
        f"peg {1e3 * (height - goal):+.1f} mm above the goal picture's,"
        f" tilt {lean:+.1f} deg from it"
    )
    allowed = -goal - INSERTED_DEPTH_M - DEPTH_MARGIN_M
    like = height - goal <= allowed and abs(lean) <= TILT_TOLERANCE_DEG
    return Check(name="goal_picture", vote=like, message=words)


def half_hole(task: Task) -> float:
    """Half the hole's width along y [m]."""
    return task.peg.half_extents[1] + task.hole.clearance / 2


def near_rim(task: Task, scene: Scene) -> float:
    """The y [m] of the rim that the peg comes from: Fit travels toward -y."""
    assert scene.hole is not None
    return scene.hole.y.value + half_hole(task)


def low_corner(peg: PegSeen) -> tuple[float, float]:
    """The place (y, z) [m] of the lower of the two bottom corners."""
    left, right = (peg.left_y, peg.left_z), (peg.right_y, peg.right_z)
    return left if left[1] <= right[1] else right


def metric(vote: bool, message: str) -> Check:
    return Check(name="metric", vote=vote, message=message, paper=False)


def unmade(name: str, scene: Scene, *, paper: bool = False) -> Check:
    return Check(name=name, vote=None, message="; ".join(scene.problems), paper=paper)


def _signed(goal: Partial) -> str:
    return ", ".join(f"{a} {a.to_report(v):+.1f} {a.report_unit}" for a, v in goal.items())
