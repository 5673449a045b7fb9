"""The paper's method: single straight motions in the plane of insertion (Sec. IV and V)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pliant.belief import Belief, Seen
from pliant.cell import Stop
from pliant.envelope import Limits
from pliant.formations import OWNED, Formation, Step
from pliant.methods import Skill
from pliant.methods.planar import checks
from pliant.methods.planar.plan import Planner
from pliant.methods.planar.skills import PlanarSkills
from pliant.methods.sight import shipped_sight
from pliant.methods.words import words_of
from pliant.records import Case, Evidence, Execution, Outcome, Recovery, Verdict
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.measure import Colours
from pliant.vision.scene import Measured
from pliant.vision.sight import Sight
from pliant.vision.surround import SIDE

_UNLOADS_M = 0.002  # z; a stop passes its limit by less


@dataclass(frozen=True)
class Planar:
    """The paper's method (protocol `pliant.methods.Method`)."""

    name = "planar"
    plannable = OWNED
    follows_belief = False
    cameras = (SIDE,)
    retakes = 0
    prober = None  # as in the paper

    @property
    def words(self) -> Mapping[str, str]:
        return words_of(__name__)

    def sight(self, task: Task, teaching: Teaching, colours: Colours | None) -> Sight:
        return shipped_sight(task, teaching, colours)

    def skill(self, task: Task, teaching: Teaching, limits: Limits) -> Skill:
        return PlanarSkills(taught=teaching.goals, contact_speed_m_s=limits.contact_speed_m_s)

    def believe(self, belief: Belief, look: Seen, teaching: Teaching) -> Belief:
        """The belief after one more look: that the hole does not move, and that nothing is measured
        wrong but by noise. All readings of the hole share one calibration, so its estimate is their
        mean. The grasp angle is read at Approach, where the peg hangs freely: its tilt less the
        tilt that the same flange angle gave when the goals were taught with an aligned peg."""
        scene, taught = look.scene, teaching.scenes.get(Formation.APPROACH)
        if scene.hole is not None:
            seen, before = scene.hole.y, belief.hole_y
            readings = (*belief.readings.get("hole_y", ()), seen.value)
            if before is not None:
                seen = replace(
                    seen, value=before.value + (seen.value - before.value) / len(readings)
                )
            belief = replace(belief, hole_y=seen, readings={**belief.readings, "hole_y": readings})
        if look.step.formation is Formation.APPROACH and scene.peg and taught and taught.peg:
            tilt, before = scene.peg.tilt, taught.peg.tilt
            sd = math.hypot(tilt.sd, before.sd)
            angle = Measured(value=tilt.value - before.value, sd=sd)
            belief = replace(belief, grasp_roll=angle)
        return belief

    def signs(
        self, task: Task, history: Sequence[Execution], outcome: Outcome, belief: Belief
    ) -> None:
        return None  # as in the paper

    def check(self, task: Task, outcome: Outcome, belief: Belief, teaching: Teaching) -> Evidence:
        return checks.check(task, outcome, teaching.scenes)

    def presses_on(self, step: Step, case: Case) -> bool:
        """Whether a step would press on after a compression stop: from a pressed wrist it must
        rise, from a stretched one go down."""
        if case.outcome.stop is not Stop.COMPRESSION:
            return False
        at = case.outcome.looks[-1].observation
        stretched = at.compression_m < 0.0
        if step.retreat:
            return stretched
        rises = case.goals.updated(step).target(step.formation).z - at.pose.z
        return (-rises if stretched else rises) < _UNLOADS_M

    def plan(self, case: Case, verdict: Verdict, by: str) -> Recovery:
        return Planner(by).plan(case, verdict)
