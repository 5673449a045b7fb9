"""The figures that the prompts name, so that a model can turn what it sees into a goal: sizes and
places in millimetres and in pixels, of the task, the camera and the goals at hand."""

import math
from collections.abc import Mapping

import numpy as np

from pliant.checks import DEPTH_MARGIN_M, ON_HOLE_M, TILT_TOLERANCE_DEG, half_hole
from pliant.envelope import Limits
from pliant.formations import MOST_TURN, OWNED, Formation
from pliant.pose import Axis
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case
from pliant.task import BLOCK_SIZE
from pliant.vision.surround import SIDE


def figures(case: Case, settings: Settings, limits: Limits) -> Mapping[str, str]:
    """The figures by the names that the prompts call them: `_mm`, `_deg`, `_px` for their units."""
    task, camera = case.task, case.outcome.looks[-1].observation.views[SIDE].camera
    column, row = camera.project(np.zeros(3))
    at_peg = 1e-3 / camera.metres_per_pixel(0.0)  # [px/mm]
    at_block = 1e-3 / camera.metres_per_pixel(BLOCK_SIZE[0] / 2)
    peg_mm, length_mm = 2e3 * task.peg.half_extents[1], 1e3 * task.peg.length
    hole_mm, play_mm = 2e3 * half_hole(task), 1e3 * task.hole.clearance
    depth_mm, block_mm = 1e3 * task.depth, 1e3 * BLOCK_SIZE[1]
    lever_mm = 1e3 * task.tip_below_hinge * math.radians(1.0)
    taught = {f: case.teaching.goals.formations[f][OWNED[f][0]] for f in Formation}
    touch_mm = 1e3 * (taught[Formation.APPROACH] - taught[Formation.FIT])
    measured_mm = depth_mm + 1e3 * DEPTH_MARGIN_M
    return {
        "peg": f"the {task.peg.name}, {length_mm:.0f} mm long and {peg_mm:.0f} mm wide",
        "method": case.method.name,
        "plans": _plans(settings),
        "colours": _colours(case),
        "width_px": f"{camera.width}",
        "height_px": f"{camera.height}",
        "column_px": f"{column:.0f}",
        "row_px": f"{row:.0f}",
        "px_per_mm": f"{at_peg:.2f}",
        "block_px_per_mm": f"{at_block:.2f}",
        "nearer_px": f"{20 * (at_block - at_peg):.0f}",
        "peg_mm": f"{peg_mm:.0f}",
        "peg_px": f"{peg_mm * at_peg:.0f}",
        "length_mm": f"{length_mm:.0f}",
        "length_px": f"{length_mm * at_peg:.0f}",
        "block_mm": f"{block_mm:.0f}",
        "block_px": f"{block_mm * at_block:.0f}",
        "hole_mm": f"{hole_mm:.0f}",
        "half_hole_mm": f"{hole_mm / 2:.1f}",
        "half_hole_px": f"{hole_mm / 2 * at_peg:.0f}",
        "clearance_mm": f"{play_mm:g}",
        "clearance_px": f"{play_mm * at_peg:.1f}",
        "depth_mm": f"{depth_mm:g}",
        "visible_mm": f"{length_mm - depth_mm:.0f}",
        "visible_px": f"{(length_mm - depth_mm) * at_peg:.0f}",
        "measured_mm": f"{measured_mm:.1f}",
        "shown": _shown(case, at_peg),
        "on_hole_mm": f"{1e3 * ON_HOLE_M:.0f}",
        "tilt_deg": f"{TILT_TOLERANCE_DEG:.0f}",
        "lever_mm": f"{lever_mm:.1f}",
        "touch_mm": f"{touch_mm:.0f}",
        "limit_mm": f"{1e3 * limits.compression_m:.0f}",
        "step_limit_mm": f"{settings.step_limit_mm:g}",
        "turn_limit_deg": f"{Axis.PITCH.to_report(MOST_TURN):g}",
    }


def _plans(settings: Settings) -> str:
    if settings.plan is Plans.ABSOLUTE:
        return "Plans give absolute goals."
    return f"Plans change goals by at most {settings.step_limit_mm:g} mm."


def _colours(case: Case) -> str:
    if case.colours is None:
        return (
            "Colours, light and background may be anything: know the peg by its straight sides"
            " between the gripper's fingers, and the block by the level edge on which it stands out"
            " below the peg."
        )
    return (
        f"The peg is {case.colours.peg_word}, the block with the hole is {case.colours.block_word}."
    )


def _shown(case: Case, px_per_mm: float) -> str:
    """The sentence on the goal picture of Insertion."""
    taught = case.teaching.scenes.get(Formation.INSERTION)
    how = case.teaching.demonstrations.get(Formation.INSERTION)
    if taught is None or taught.peg is None or taught.hole is None or how is None:
        return "There is no goal picture."
    depth_mm = 1e3 * (taught.hole.surface_z.value - taught.peg.tip_z.value)
    peg = "the same peg" if how.peg == case.task.peg.name else f"another peg, the {how.peg}"
    return (
        f"The goal picture shows {peg}, {depth_mm:.0f} mm deep, perhaps at another place: it is"
        " deeper than it needs to be. Compare heights above the block's top edge alone."
    )
