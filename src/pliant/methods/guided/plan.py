"""The rules for what to do after a guided skill failed.

The guided skills correct themselves from what they see, so there is less to plan: go on where the
peg is, or lift, hang it above the hole anew and feel for it elsewhere.
"""

import math

from pliant.belief import Belief
from pliant.cell import Stop
from pliant.checks import half_hole, low_corner
from pliant.formations import Formation, steps_from
from pliant.methods.guided.checks import CORNER_IN_M, FAR_WALL_M
from pliant.methods.guided.touch import placed, shows_nothing
from pliant.methods.recoveries import going_on, stopping
from pliant.pose import Axis
from pliant.records import Case, Outcome, Recovery

_NEAR = (0.0, -0.0015, 0.0015, -0.003, 0.003, -0.0045)
_WIDE = (0.010, -0.010, 0.017, -0.017, 0.005, -0.005)
_NEAR_FIRST = 2
"""The places [m], from where the hole is seen, at which it is felt for in turn: near where an edge
was felt there, else, after the first of those, wide, as a camera may be off. Fit finds a hole that
is up to 3 mm from them."""
_ASIDE_M = 0.0048  # more is wide
_IN_HOLE = 0.0005  # [m] of the tip
_BLIND = 4  # executions in a row whose pictures do not show it all: no more are tried
_RAKES = 6  # executions of Fit by touch
_PATIENCE = 2  # executions of Align, or of Insertion, from one fit


def plan(case: Case, by: str) -> Recovery:
    """The next steps after a failed execution of a guided skill."""
    if case.diagnosis is not None and case.diagnosis.is_hopeless:
        return stopping(by, case.diagnosis.leading.words, case.diagnosis.why)
    if case.probes:
        how, why = "the peg is not in the hole", "it was lifted out to probe"
        return _touch_down_anew(case, by, how, why)
    scene = placed(case.task, case.teaching, case.outcome.looks[-1], case.belief)
    formation = case.outcome.step.formation
    if scene.peg is None or scene.hole is None:
        return _blind(case, by, "; ".join(scene.problems))
    surface = case.belief.surface_z.value if case.belief.surface_z is not None else 0.0
    depth = surface - scene.peg.tip_z.value
    again = formation in (Formation.ALIGN, Formation.INSERTION) and not _tired(case, formation)
    if again and depth > _IN_HOLE:
        leans = f"leans {math.degrees(scene.peg.tilt.value):.1f} deg in the hole"
        what, why = f"the peg {leans}", "its trailing edge caught on the rim"
        how = "turn it upright again"
        if formation is Formation.INSERTION:
            stopped = case.outcome.stop is Stop.COMPRESSION
            what = "the wrist gave way" if stopped else "the peg stuck"
            what, why = f"{what} {depth * 1e3:.1f} mm deep", f"it {leans}"
            how = "straighten it, and push again"
        return _steps(case, by, what, why, how, Formation.ALIGN)
    what = "the peg is not in the hole" if depth < _IN_HOLE else "the peg does not come free"
    why = "it touched down beside the hole, or slipped out of it"
    return _touch_down_anew(case, by, what, why)


def _tired(case: Case, formation: Formation) -> bool:
    """Whether this formation was executed often enough since the last Fit."""
    since = 1
    for execution in reversed(case.history):
        if execution.formation is Formation.FIT:
            break
        since += execution.formation is formation
    return since >= _PATIENCE


def _touch_down_anew(case: Case, by: str, what: str, why: str) -> Recovery:
    """Plan to touch down anew where it was not tried yet."""
    aim = _next_aim(case)
    if aim is None or _felt_in_vain(case):
        return stopping(by, "the hole was not found", f"{what} wherever it is felt for")
    how = f"lift, look again, and touch down {aim * 1e3:+.1f} mm from where the hole is seen"
    return _steps(case, by, what, why, how, Formation.FIT, aim=aim)


def _felt_in_vain(case: Case) -> bool:
    """Whether Fit has raked the place often enough where nothing is seen."""
    fits = [
        o for o in case.outcomes if o.step.formation is Formation.FIT and shows_nothing(o.scene)
    ]
    return len(fits) >= _RAKES


def _next_aim(case: Case) -> float | None:
    """The next place to feel for the hole [m]; None: all were tried."""
    taught = case.teaching.goals.formations[Formation.FIT][Axis.Y]
    fits = [
        (outcome.step.goal[Axis.Y] - taught, outcome, belief)
        for outcome, belief in (
            *((e.outcome, e.belief) for e in case.history),
            (case.outcome, case.belief),
        )
        if outcome.step.formation is Formation.FIT
    ]
    again = [shift for shift, outcome, _ in fits if outcome.step.retreat]
    near = sum(abs(shift) < _ASIDE_M for shift in again)
    wide = len(again) - near
    felt = [_felt(case, o, b) for shift, o, b in fits if abs(shift) < _ASIDE_M]
    is_there = True in felt and False not in felt
    if near < _NEAR_FIRST or (is_there and near < len(_NEAR)):
        return _NEAR[near]
    if wide < len(_WIDE):
        return _WIDE[wide]
    return _NEAR[near] if near < len(_NEAR) else None


def _felt(case: Case, outcome: Outcome, belief: Belief) -> bool | None:
    """Whether Fit ended with the low corner in the hole, at the far wall where it is believed; in
    the hole beyond it, it is elsewhere. None: not in the hole, or not seen."""
    peg = placed(case.task, case.teaching, outcome.looks[-1], belief).peg
    hole, surface = belief.hole_y, belief.surface_z
    if peg is None or hole is None or surface is None:
        return None
    y, z = low_corner(peg)
    if surface.value - z < CORNER_IN_M:
        return None
    short = y - (hole.value - half_hole(case.task))
    return FAR_WALL_M[0] <= short <= FAR_WALL_M[1]


def _blind(case: Case, by: str, problem: str) -> Recovery:
    last = case.outcomes[-_BLIND:]
    if len(last) == _BLIND and all(o.scene.peg is None or o.scene.hole is None for o in last):
        return stopping(by, "the picture does not show what is needed to see the result", problem)
    what = "the picture does not show what is needed to see the result"
    return _touch_down_anew(case, by, what, problem)


def _steps(
    case: Case, by: str, what: str, why: str, how: str, start: Formation, *, aim: float = 0.0
) -> Recovery:
    taught = case.teaching.goals.formations
    goals = {**taught, Formation.FIT: {Axis.Y: taught[Formation.FIT][Axis.Y] + aim}}
    steps = steps_from(start, goals, retreat=start is Formation.FIT)
    return going_on(case, by, what, why, how, steps)
