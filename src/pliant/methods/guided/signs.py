"""The signs by which a guided trial shows that something is not as the task says: what its cameras
measure, where it touches, and how deep it gets.

The weights are chosen, not fitted: a sign that no healthy trial of the ladder showed decides alone,
or nearly; one that some showed has to come again, in other places.
"""

import math
from collections.abc import Sequence
from statistics import median

from pliant.belief import Belief
from pliant.checks import DEPTH_MARGIN_M, low_corner
from pliant.diagnosis import Hypothesis, Sign
from pliant.formations import Formation
from pliant.records import Execution, Outcome
from pliant.task import Task
from pliant.vision.scene import Measured

_WIDER_M = 0.002  # healthy: within 0.8 mm
_LOOKS = 3  # that must have measured it
_HIGH_M, _CLEARLY_HIGH_M = 0.0012, 0.0025  # the low corner above the board, pressed onto it
_HELD_M = 0.005  # of compression that does not bring it deeper
_UPRIGHT = math.radians(1.5)
_SAME_DEPTH_M = 0.0005
_ENTERED_M = 0.001


def signs(
    task: Task, history: Sequence[Execution], outcome: Outcome, belief: Belief
) -> tuple[Sign, ...]:
    """All signs of the executions so far, the last of which ended as `outcome`."""
    all_of = [*((e.outcome, e.belief) for e in history), (outcome, belief)]
    return (
        *_of_width([o for o, _ in all_of]),
        *(sign for o, b in all_of if (sign := _of_height(o, b)) is not None),
        *_of_depth(task, all_of),
    )


def _of_width(outcomes: Sequence[Outcome]) -> list[Sign]:
    """The peg is wider or narrower than it should be, by one of the cameras."""
    looks = [look.scene for outcome in outcomes for look in outcome.looks]
    found = []
    for camera, measured in (
        ("side", [s.peg.wider for s in looks if s.peg is not None]),
        ("front", [s.across.wider for s in looks if s.across is not None]),
    ):
        widths: list[Measured] = [m for m in measured if m is not None]
        if len(widths) < _LOOKS:
            continue
        by = median(m.value for m in widths)
        if abs(by) > _WIDER_M:
            how = "wider" if by > 0 else "narrower"
            says = (
                f"by the {camera} camera the peg is {abs(by) * 1e3:.1f} ±"
                f" {widths[-1].sd * 1e3:.1f} mm {how} than the task's"
            )
            found.append(Sign(says=says, speaks={Hypothesis.PEG_OTHER: 5.0}))
    return found


def _of_height(outcome: Outcome, belief: Belief) -> Sign | None:
    """The peg stands on something above the board, where it was pressed down over the hole."""
    peg, surface = outcome.scene.peg, belief.surface_z
    if outcome.step.formation not in (Formation.CONTACT, Formation.FIT):
        return None
    if peg is None or surface is None:
        return None
    height = low_corner(peg)[1] - surface.value
    if height < _HIGH_M:
        return None
    says = f"pressed down over the hole, the peg stands {height * 1e3:.1f} mm above the board"
    clearly = height >= _CLEARLY_HIGH_M
    return Sign(says=says, speaks={Hypothesis.OBJECT_ON_BOARD: 2.0 if clearly else 1.3})


def _of_depth(task: Task, all_of: Sequence[tuple[Outcome, Belief]]) -> list[Sign]:
    """An upright peg was pressed and stopped in the hole, more than once at the same depth."""
    depths: list[float] = []
    found = []
    for outcome, belief in all_of:
        peg, surface = outcome.scene.peg, belief.surface_z
        if outcome.step.formation is not Formation.INSERTION or peg is None or surface is None:
            continue
        depth = surface.value - peg.tip_z.value
        pressed = outcome.looks[-1].observation.compression_m
        upright = abs(peg.tilt.value) < _UPRIGHT
        short = _ENTERED_M < depth < task.depth + DEPTH_MARGIN_M
        if not (pressed > _HELD_M and upright and short):
            continue
        again = any(abs(depth - before) < _SAME_DEPTH_M for before in depths)
        depths.append(depth)
        times = "again " if again else ""
        says = (
            f"upright and pressed by {pressed * 1e3:.0f} mm, the peg stops {times}at"
            f" {depth * 1e3:.0f} mm"
        )
        found.append(Sign(says=says, speaks={Hypothesis.HOLE_BLOCKED: 2.5 if again else 1.5}))
    return found
