"""Measures a picture without colour in two ways, by edges and by a learned network, and joins what
they say.

Where they agree on the peg, each quantity is their mean, weighted by what they state. Of the hole
the network alone is nearer from the side; from the front both err as little, and each for itself:
there its place is their mean, too. Where they contradict each other by more than both standard
deviations and a margin allow, the network is believed, which was the nearer one in nearly all of
such pictures (docs/learned-sight.md), and the scene's `doubts` say so. What one does not find is
the other's.
"""

import math
from dataclasses import replace

import numpy as np

from pliant.cell import View
from pliant.pose import Pose
from pliant.task import Task
from pliant.vision.edges import NOMINAL, Aside, measure_edges
from pliant.vision.learned import measure_learned
from pliant.vision.offset import UNKNOWN, Offset
from pliant.vision.scene import Measured, PegSeen, Scene
from pliant.vision.seen import peg_seen
from pliant.vision.surround import FRONT

_DEVIATIONS = 4.0  # of both together that a difference may be
_MARGIN_M, _MARGIN_RAD = 0.001, math.radians(1.0)  # and so much more
_SHARED = Measured(value=0.0, sd=0.0)  # of a tilt: nothing


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
    return joined(by_edges, learned, view, task, pose, aside=aside, offset=offset)


def joined(
    by_edges: Scene,
    learned: Scene,
    view: View,
    task: Task,
    pose: Pose,
    *,
    aside: Aside = NOMINAL,
    offset: Offset = UNKNOWN,
) -> Scene:
    """Join what edges and what the network measured in the same picture."""
    peg, hole = by_edges.peg or learned.peg, learned.hole or by_edges.hole
    doubts: list[str] = []
    if by_edges.peg is not None and learned.peg is not None:
        # Edges take the tip's nearest corner for its middle: wrong where it leans to the camera.
        blurred = max(task.peg.half_extents) * aside.lean
        z = replace(by_edges.peg.tip_z, sd=math.hypot(by_edges.peg.tip_z.sd, blurred))
        edges = replace(by_edges.peg, tip_z=z)
        peg, off = _pegs_joined(edges, learned.peg, view, task, pose, offset)
        doubts += _doubt("peg", off)
    if by_edges.hole is not None and learned.hole is not None:
        one, other = by_edges.hole, learned.hole
        off = [
            *_millimetres("y", one.y, other.y, offset.y),
            *_millimetres("z", one.surface_z, other.surface_z, offset.z),
        ]
        doubts += _doubt("hole", off)
        if view.camera.name == FRONT and not off:
            hole = replace(other, y=_joined(one.y, other.y, offset.y))
    problems = []
    for thing, found in (("hole", hole), ("peg", peg)):
        if found is None:
            both = (
                p for s in (by_edges, learned) for p in s.problems if p.startswith(f"no {thing}")
            )
            problems.append("; ".join(both))
    return replace(by_edges, peg=peg, hole=hole, problems=tuple(problems), doubts=tuple(doubts))


def _pegs_joined(
    one: PegSeen, other: PegSeen, view: View, task: Task, pose: Pose, offset: Offset
) -> tuple[PegSeen, list[str]]:
    """A peg from both measurements, and by what they contradict each other."""
    tilt = _joined(one.tilt, other.tilt, _SHARED)
    y, z = _joined(one.tip_y, other.tip_y, offset.y), _joined(one.tip_z, other.tip_z, offset.z)
    off = [
        *_millimetres("y", one.tip_y, other.tip_y, offset.y),
        *_millimetres("z", one.tip_z, other.tip_z, offset.z),
        *_degrees("tilt", one.tilt, other.tilt),
    ]
    if off:
        return other, off
    tops = np.array([peg.box_px[1:3] for peg in (one, other)])
    top = tops.mean(axis=(0, 1))
    return peg_seen(view.camera, task.peg, pose.yaw, top=top, tilt=tilt, y=y, z=z), off


def _joined(one: Measured, other: Measured, shared: Measured) -> Measured:
    """The mean, weighted by what is not known beside what both share. They see the same picture: it
    is no surer than the surer one."""
    a, b = (max(1e-12, m.sd**2 - shared.sd**2) for m in (one, other))
    return Measured(value=(b * one.value + a * other.value) / (a + b), sd=min(one.sd, other.sd))


def _doubt(thing: str, off: list[str]) -> list[str]:
    differ = "edges differ from the learned sight, which is believed, by"
    return [f"{thing}: {differ} {', '.join(off)}"] if off else []


def _millimetres(name: str, one: Measured, other: Measured, offset: Measured) -> list[str]:
    # What is not known of the camera's place is the same for both.
    sd = math.sqrt(max(0.0, one.sd**2 + other.sd**2 - 2 * offset.sd**2))
    off = one.value - other.value
    return [f"{name} {off * 1e3:+.1f} mm"] if abs(off) > _MARGIN_M + _DEVIATIONS * sd else []


def _degrees(name: str, one: Measured, other: Measured) -> list[str]:
    off = one.value - other.value
    far = abs(off) > _MARGIN_RAD + _DEVIATIONS * math.hypot(one.sd, other.sd)
    return [f"{name} {math.degrees(off):+.1f} deg"] if far else []
