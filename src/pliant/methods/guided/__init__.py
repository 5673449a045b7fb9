"""Our method: skills guided by what is seen and felt, on all six axes, for the levels above the
paper's grid.

To tell what each of its mechanisms is worth, it can be had without some of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pliant.belief import Belief, Seen
from pliant.cell import Stop
from pliant.diagnosis import Sign
from pliant.envelope import Limits
from pliant.errors import unknown
from pliant.formations import OWNED, Formation, Step
from pliant.methods import Prober
from pliant.methods.guided import checks, plan, signs
from pliant.methods.guided.belief import softly
from pliant.methods.guided.hand import MECHANISMS, Manner
from pliant.methods.guided.skills import SHIFTED, GuidedSkills
from pliant.methods.sight import shipped_sight
from pliant.methods.words import words_of
from pliant.records import Case, Evidence, Execution, Outcome, Recovery, Verdict
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.measure import Colours
from pliant.vision.sight import Sight
from pliant.vision.surround import ALL

_PLANNABLE = {formation: (*OWNED[formation], *SHIFTED[formation]) for formation in Formation}


@dataclass(frozen=True)
class Guided:
    """Our method (protocol `pliant.methods.Method`), which `lacks` some of its mechanisms.

    Raises:
        InputError: it has no such mechanism.
    """

    plannable = _PLANNABLE
    follows_belief = True
    cameras = ALL
    retakes = 4
    lacks: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for mechanism in sorted(self.lacks):
            if mechanism not in MECHANISMS:
                raise unknown("mechanism of method guided", mechanism, MECHANISMS)

    @property
    def name(self) -> str:
        return "-".join(["guided", *sorted(self.lacks)])

    @property
    def words(self) -> Mapping[str, str]:
        return words_of(__name__)

    def sight(self, task: Task, teaching: Teaching, colours: Colours | None) -> Sight:
        return shipped_sight(task, teaching, colours, calibrates="calibration" not in self.lacks)

    def skill(self, task: Task, teaching: Teaching, limits: Limits) -> GuidedSkills:
        manner = Manner(limits=limits, lacks=self.lacks)
        return GuidedSkills(task=task, teaching=teaching, manner=manner)

    def prober(self, task: Task, teaching: Teaching, limits: Limits) -> Prober:
        return self.skill(task, teaching, limits).probe

    def believe(self, belief: Belief, look: Seen, teaching: Teaching) -> Belief:
        return softly(belief, look, teaching, Manner(lacks=self.lacks).memory)

    def signs(
        self, task: Task, history: Sequence[Execution], outcome: Outcome, belief: Belief
    ) -> Sequence[Sign]:
        return signs.signs(task, history, outcome, belief)

    def check(self, task: Task, outcome: Outcome, belief: Belief, teaching: Teaching) -> Evidence:
        return checks.check(task, outcome, teaching, belief)

    def presses_on(self, step: Step, case: Case) -> bool:
        """Whether a step would press on after a compression stop: Fit, Align and a retreat do not,
        since they see to the load before they travel."""
        stopped = case.outcome.stop is Stop.COMPRESSION
        return stopped and step.formation is Formation.INSERTION and not step.retreat

    def plan(self, case: Case, verdict: Verdict, by: str) -> Recovery:
        return plan.plan(case, by)
