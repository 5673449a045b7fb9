"""Measures a picture without colour in two ways: by edges, which are precise where they are right,
and by a learned network, which sees what edges do not.

Edges are believed unless they find nothing, or are farther from what the network sees than both
standard deviations and a margin allow; then the scene's `doubts` say so.
"""

import math
from dataclasses import replace

from pliant.cell import View
from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.edges import NOMINAL, Aside, measure_edges
from pliant.vision.learned import measure_learned
from pliant.vision.offset import UNKNOWN, Offset
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Scene

_DEVIATIONS = 4.0  # of both together that a difference may be
_MARGIN_M, _MARGIN_RAD = 0.001, math.radians(1.0)  # and so much more


def measure_fused(
    view: View,
    task: Task,
    pose: Pose,
    *,
    aside: Aside = NOMINAL,
    offset: Offset = UNKNOWN,
    pressed: float | None = None,
) -> Scene:
    """Measure a picture from +x as `measure_edges` does, with its arguments, by edges and by the
    network."""
    by_edges, learned = (
        measure(view, task, pose, aside=aside, offset=offset, pressed=pressed)
        for measure in (measure_edges, measure_learned)
    )
    peg, hole = by_edges.peg, by_edges.hole
    problems, doubts = [], []
    if peg is None:
        peg = learned.peg
    elif learned.peg is not None and (off := _apart(peg, learned.peg, offset)):
        doubts.append(f"peg: edges differ from the learned sight by {off}, which is believed")
        peg = learned.peg
    if hole is None:
        hole = learned.hole
    elif learned.hole is not None and (off := _hole_apart(hole, learned.hole, offset)):
        doubts.append(f"hole: edges differ from the learned sight by {off}, which is believed")
        hole = learned.hole
    for thing, found in (("hole", hole), ("peg", peg)):
        if found is None:
            both = (
                p for s in (by_edges, learned) for p in s.problems if p.startswith(f"no {thing}")
            )
            problems.append("; ".join(both))
    return replace(by_edges, peg=peg, hole=hole, problems=tuple(problems), doubts=tuple(doubts))


def _apart(one: PegSeen, other: PegSeen, offset: Offset) -> str:
    """By what two measurements of a peg contradict each other; empty: they do not."""
    return ", ".join(
        _millimetres("y", one.tip_y, other.tip_y, offset.y)
        + _millimetres("z", one.tip_z, other.tip_z, offset.z)
        + _degrees("tilt", one.tilt, other.tilt)
    )


def _hole_apart(one: HoleSeen, other: HoleSeen, offset: Offset) -> str:
    return ", ".join(
        _millimetres("y", one.y, other.y, offset.y)
        + _millimetres("z", one.surface_z, other.surface_z, offset.z)
    )


def _millimetres(name: str, one: Measured, other: Measured, offset: Measured) -> list[str]:
    # What is not known of the camera's place is the same for both.
    sd = math.sqrt(max(0.0, one.sd**2 + other.sd**2 - 2 * offset.sd**2))
    off = other.value - one.value
    return [f"{name} {off * 1e3:+.1f} mm"] if abs(off) > _MARGIN_M + _DEVIATIONS * sd else []


def _degrees(name: str, one: Measured, other: Measured) -> list[str]:
    off = other.value - one.value
    far = abs(off) > _MARGIN_RAD + _DEVIATIONS * math.hypot(one.sd, other.sd)
    return [f"{name} {math.degrees(off):+.1f} deg"] if far else []
