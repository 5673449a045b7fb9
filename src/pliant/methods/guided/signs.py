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
from pliant.methods.guided.touch import shows_nothing
from pliant.records import Execution, Outcome
from pliant.task import Task
from pliant.vision.scene import Measured, Scene

_WIDER_M = 0.002  # healthy: within 0.8 mm
_NOTHING_SEEN = {Hypothesis.CAMERA_BLIND: 3.0}
_LOOKS = 3  # that must have measured it
_LONGER_M = 0.004
_PITCHED = math.radians(2.0)
_STILL_M, _WENT_M = 0.0005, 0.010  # of the tip that is seen, and that it must have gone
_FLAT_M = 0.0015  # a low corner so far below the board has found an edge
_HIGH_M, _CLEARLY_HIGH_M = 0.0012, 0.0025  # the low corner above the board, pressed onto it
_FELT_M = 0.002  # of compression; they press by 3 mm
_HELD_M = 0.005  # of compression that does not bring it deeper
_UPRIGHT = math.radians(1.5)
_SAME_DEPTH_M = 0.0005
_ENTERED_M = 0.001
_ELSEWHERE_M, _CLEARLY_IN_M = 0.004, 0.005


def signs(
    task: Task, history: Sequence[Execution], outcome: Outcome, belief: Belief
) -> tuple[Sign, ...]:
    """All signs of the executions so far, the last of which ended as `outcome`."""
    all_of = [*((e.outcome, e.belief) for e in history), (outcome, belief)]
    outcomes = [o for o, _ in all_of]
    if any(shows_nothing(look.scene) for o in outcomes for look in o.looks):
        blind = Sign(says="pictures show neither peg nor board", speaks=_NOTHING_SEEN)
        return (blind, *_of_size(outcomes))
    stuck = _of_motion(outcomes)
    if stuck:  # then no picture says anything
        return tuple(stuck)
    return (
        *_of_size(outcomes),
        *(sign for o, b in all_of if (sign := _of_height(o, b)) is not None),
        *_of_touch(outcomes),
        *_of_search(all_of),
        *_of_depth(task, all_of),
        *_of_place(outcome, belief),
    )


def _of_motion(outcomes: Sequence[Outcome]) -> list[Sign]:
    """The hand went up or down by more than the wrist was felt to give, and the picture stayed as
    it was."""
    looks = [look for outcome in outcomes for look in outcome.looks]
    seen = [(k.observation, k.scene.peg) for k in looks if k.scene.peg is not None]
    found = []
    since = 0
    for k in range(1, len(seen)):
        (before, was), (now, peg) = seen[since], seen[k]
        moved = math.hypot(peg.tip_y.value - was.tip_y.value, peg.tip_z.value - was.tip_z.value)
        went = abs(now.pose.z - before.pose.z + now.compression_m - before.compression_m)
        if moved > _STILL_M:
            since = k
        elif went > _WENT_M:
            says = f"the tip should be {went * 1e3:.0f} mm from where the camera still shows it"
            found.append(Sign(says=says, speaks={Hypothesis.CAMERA_WRONG: 4.0}))
            since = k
    return found


def _of_size(outcomes: Sequence[Outcome]) -> list[Sign]:
    """The peg is wider, narrower, longer or shorter than it should be, by one of the cameras."""
    scenes = [s for o in outcomes for look in o.looks if not _leans_away(s := look.scene)]
    pegs = [scene.peg for scene in scenes if scene.peg is not None]
    across = [scene.across for scene in scenes if scene.across is not None]
    found = []
    for camera, measured, least, more, less in (
        ("side", [p.wider for p in pegs], _WIDER_M, "wider", "narrower"),
        ("front", [a.wider for a in across], _WIDER_M, "wider", "narrower"),
        ("side", [p.longer for p in pegs], _LONGER_M, "longer", "shorter"),
    ):
        sizes: list[Measured] = [m for m in measured if m is not None]
        if len(sizes) < _LOOKS:
            continue
        by = median(m.value for m in sizes)
        if abs(by) > least:
            says = (
                f"by the {camera} camera the peg is {abs(by) * 1e3:.1f} ±"
                f" {sizes[-1].sd * 1e3:.1f} mm {more if by > 0 else less} than the task's"
            )
            found.append(Sign(says=says, speaks={Hypothesis.PEG_OTHER: 5.0}))
    return found


def _leans_away(scene: Scene) -> bool:
    """Whether the front camera shows the peg to lean along the side camera's view, which then
    measures it longer than it is."""
    across = scene.across
    return across is not None and across.pitch is not None and abs(across.pitch.value) > _PITCHED


def _height(outcome: Outcome, belief: Belief, *formations: Formation) -> float | None:
    """The height [m] of the low corner above the board after one of the formations; None: it was
    another, or not seen."""
    peg, surface = outcome.scene.peg, belief.surface_z
    if outcome.step.formation not in formations or peg is None or surface is None:
        return None
    return low_corner(peg)[1] - surface.value


def _of_height(outcome: Outcome, belief: Belief) -> Sign | None:
    """The peg stands on something above the board, where it was pressed down over the hole."""
    height = _height(outcome, belief, Formation.CONTACT, Formation.FIT)
    if height is None or height < _HIGH_M:
        return None
    says = f"pressed down over the hole, the peg stands {height * 1e3:.1f} mm above the board"
    clearly = height >= _CLEARLY_HIGH_M
    return Sign(says=says, speaks={Hypothesis.OBJECT_ON_BOARD: 2.0 if clearly else 1.3})


def _of_touch(outcomes: Sequence[Outcome]) -> list[Sign]:
    """Contact or Fit moved, which press the peg, and nothing was felt."""
    found = []
    for outcome in outcomes:
        presses = outcome.step.formation in (Formation.CONTACT, Formation.FIT)
        felt = [look.observation.compression_m for look in outcome.looks]
        if presses and outcome.motions and max(outcome.peak_compression_m, *felt) < _FELT_M:
            says = f"{outcome.step.formation} pressed the peg down, and nothing was felt"
            speaks = {Hypothesis.PEG_MISSING: 2.3, Hypothesis.SENSOR_WRONG: 1.0}
            found.append(Sign(says=says, speaks=speaks))
    return found


def _of_search(all_of: Sequence[tuple[Outcome, Belief]]) -> list[Sign]:
    """No edge of a hole was felt, wherever Fit looked for it. The low corner is dragged over more
    than a hole's width each time, so that little is left after four wide shifts."""
    found = []
    for outcome, belief in all_of:
        height = _height(outcome, belief, Formation.FIT)
        if height is None or height > _HIGH_M:
            continue
        if height < -_FLAT_M:
            return []
        by, wide = belief.hole_shift, abs(belief.hole_shift) > _ELSEWHERE_M
        says = f"no edge is felt {by * 1e3:+.0f} mm along y from where the hole is seen"
        speaks = {Hypothesis.HOLE_ELSEWHERE: 0.3, Hypothesis.HOLE_BLOCKED: 0.9 if wide else 0.3}
        found.append(Sign(says=says, speaks=speaks))
    return found


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


def _of_place(outcome: Outcome, belief: Belief) -> list[Sign]:
    """The peg is in the hole that was felt for elsewhere than the camera shows it."""
    peg, surface, by = outcome.scene.peg, belief.surface_z, belief.hole_shift
    if abs(by) < _ELSEWHERE_M or outcome.step.formation is not Formation.INSERTION:
        return []
    if peg is None or surface is None or surface.value - peg.tip_z.value < _CLEARLY_IN_M:
        return []
    says = f"the peg went in {by * 1e3:+.0f} mm along y from where the camera shows the hole"
    return [Sign(says=says, speaks={Hypothesis.HOLE_ELSEWHERE: 5.0})]
