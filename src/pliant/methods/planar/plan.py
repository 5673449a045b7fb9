"""The rules for what to do after one of the paper's single motions failed: the next goals, by what
is seen.

Fit travels toward -y: "further" means more negative. Everything here is in the plane of insertion.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pliant.cell import Stop
from pliant.checks import half_hole, low_corner, near_rim
from pliant.formations import OWNED, Formation, steps_from
from pliant.methods.planar.checks import IN_HOLE_DEPTH_M
from pliant.methods.recoveries import going_on, stopping
from pliant.records import Case, FailureAnalysis, Outcome, Recovery, Verdict
from pliant.vision.scene import PegSeen

_CLEAR_RIM = 0.003  # [m] further than where the trailing corner would just drop in
_ADVANCE = (0.003, 0.012)  # [m] least and most of one advance of Fit
_LESS_TRAVEL = 0.003  # [m] less over-travel each time the peg popped over the far rim
_ALIGN_MOST = 0.015  # [m] of one correction of Align
_DEEPER = 0.004  # [m] of one more push
_DEEPEST = 0.012  # [m] below the taught Insertion goal, at most


@dataclass(frozen=True)
class Planner:
    """Plans by the rules, signed `by` whoever asks."""

    by: str

    def plan(self, case: Case, verdict: Verdict) -> Recovery:
        """The next steps after a failed execution."""
        formation = case.outcome.step.formation
        scene = case.outcome.scene
        if scene.peg is None or scene.hole is None:
            return self._blind(case, "; ".join(scene.problems))
        if formation in (Formation.APPROACH, Formation.CONTACT):
            return self._refit(case, f"{formation} did not reach its goal", verdict.reason)
        if formation is Formation.INSERTION:
            return self._after_insertion(case, scene.peg)
        if formation is Formation.ALIGN:
            return self._after_align(case, scene.peg)
        return self._after_fit(case, scene.peg)

    # --- Fit -------------------------------------------------------------------------------------

    def _after_fit(self, case: Case, peg: PegSeen) -> Recovery:
        where = _where(case, case.outcome)
        if where == "beyond":
            return self._refit(case, "the peg slid over the hole and out at the far rim")
        past_rim = near_rim(case.task, case.outcome.scene) - peg.right_y
        advance = min(max(_CLEAR_RIM - past_rim, _ADVANCE[0]), _ADVANCE[1])
        what = (
            "the trailing corner still stands on the near rim"
            if where in ("edge", "in")
            else "the peg's tip did not reach the hole's far wall"
        )
        return self._plan(
            case,
            what,
            "Fit travelled too little for this hole, angle and friction",
            "slide further in the same direction",
            {Formation.FIT: case.goals.target(Formation.FIT).y - advance},
        )

    def _refit(
        self, case: Case, what: str, why: str = "Fit travelled too far for where this hole is"
    ) -> Recovery:
        """Lift, go back before the hole, touch down and fit again, with less over-travel each time
        that the peg has popped over the far rim."""
        popped = sum(
            e.outcome.step.formation is Formation.FIT and _where(case, e.outcome) == "beyond"
            for e in case.history
        )
        taught = case.teaching.goals.target(Formation.FIT).y
        return self._plan(
            case,
            what,
            why,
            "lift, go back before the hole, touch down and fit again relative to the hole seen",
            {Formation.FIT: _hole(case) + taught + _LESS_TRAVEL * popped},
            retreat=True,
        )

    # --- Align -----------------------------------------------------------------------------------

    def _after_align(self, case: Case, peg: PegSeen) -> Recovery:
        where = _where(case, case.outcome)
        if where in ("before", "beyond"):
            return self._refit(case, "the peg is out of the hole")
        if where == "edge":
            return self._plan(
                case,
                "the trailing corner is back on the near rim",
                "Align moved before the peg was free of the rim",
                "fit further, then align",
                {Formation.FIT: case.goals.target(Formation.FIT).y - _ADVANCE[0]},
            )
        return self._plan(
            case,
            f"the peg leans {math.degrees(peg.tilt.value):.1f} deg in the hole",
            "the hinge is not above the hole for this grasp angle",
            "move the hinge so that the peg stands upright",
            {Formation.ALIGN: _upright_y(case, peg)},
        )

    # --- Insertion -------------------------------------------------------------------------------

    def _after_insertion(self, case: Case, peg: PegSeen) -> Recovery:
        where = _where(case, case.outcome)
        if where in ("before", "beyond"):
            return self._refit(case, "the peg is out of the hole")
        if where == "edge":
            return self._refit(case, "a corner of the peg stands on the rim")
        stopped = case.outcome.stop is Stop.COMPRESSION
        z = case.goals.target(Formation.INSERTION).z
        deepest = case.teaching.goals.target(Formation.INSERTION).z - _DEEPEST
        deeper = z if stopped else max(z - _DEEPER, deepest)
        return self._plan(
            case,
            "the wrist gave way before the peg was deep enough"
            if stopped
            else "the peg is not deep enough",
            f"it is wedged, leaning {math.degrees(peg.tilt.value):.1f} deg",
            "back off, straighten, and push" + ("" if stopped else " deeper"),
            {Formation.ALIGN: _upright_y(case, peg), Formation.INSERTION: deeper},
        )

    # --- without a measurement -------------------------------------------------------------------

    def _blind(self, case: Case, problem: str) -> Recovery:
        """Plan where nothing can be measured: look again once after a retreat, then stop."""
        before = case.history[-1].outcome.scene if case.history else None
        again = before is not None and (before.peg is None or before.hole is None)
        what = "the picture does not show what is needed to see the result"
        if again:
            return stopping(self.by, what, problem)
        analysis = FailureAnalysis(
            what=what, why=problem, how="lift, and fit again from the start", motion={}
        )
        steps = steps_from(Formation.FIT, case.goals.formations, retreat=True)
        return Recovery(analysis=analysis, steps=steps, by=self.by)

    # --- the plan --------------------------------------------------------------------------------

    def _plan(
        self,
        case: Case,
        what: str,
        why: str,
        how: str,
        wanted: Mapping[Formation, float],
        *,
        retreat: bool = False,
    ) -> Recovery:
        """The plan that starts with the first formation whose goal is `wanted` [m]; of the others
        Align brings the hinge above the hole, and Insertion keeps its goal."""
        start = next(iter(wanted))
        insertion = case.goals.target(Formation.INSERTION).z
        usual = {Formation.ALIGN: _hinge_over_hole(case), Formation.INSERTION: insertion}
        goals = {f: {OWNED[f][0]: value} for f, value in {**usual, **wanted}.items()}
        steps = steps_from(start, goals, retreat=retreat)
        if case.method.presses_on(steps[0], case):
            steps = steps_from(start, goals, retreat=True)
            how = f"lift, since the wrist gave way, and {how}"
        return going_on(case, self.by, what, why, how, steps)


def _hole(case: Case) -> float:
    """The y [m] where the hole is believed to be."""
    believed = case.belief.hole_y
    return believed.value if believed is not None else 0.0


def _hinge_over_hole(case: Case) -> float:
    """The y [m] of the hinge for the peg to stand upright in the hole: off the hole's centre by the
    grasp angle's lever."""
    angle = case.belief.grasp_roll.value if case.belief.grasp_roll is not None else 0.0
    offset = case.teaching.goals.target(Formation.ALIGN).y
    return _hole(case) + offset + case.task.grasp_below_hinge * math.sin(angle)


def _upright_y(case: Case, peg: PegSeen) -> float:
    """Align's goal so far, corrected by the lean that is seen [m]."""
    correction = case.task.tip_below_hinge * math.sin(peg.tilt.value)
    bounded = max(-_ALIGN_MOST, min(_ALIGN_MOST, correction))
    return case.outcome.target.y + bounded


def _where(case: Case, outcome: Outcome) -> str:
    """The place where the peg is seen. "in": both lower corners inside the rims; "edge": the low
    one in, the other on the near rim; "before" or "beyond" the hole; "unseen"."""
    peg, seen = outcome.scene.peg, outcome.scene.hole
    if peg is None or seen is None:
        return "unseen"
    hole, half = _hole(case), half_hole(case.task)
    y, z = low_corner(peg)
    if z > seen.surface_z.value - IN_HOLE_DEPTH_M:
        return "beyond" if peg.tip_y.value < hole - half / 4 else "before"
    if y < hole - half - 0.002:
        return "beyond"
    return "in" if peg.right_y <= hole + half + 0.0005 else "edge"
