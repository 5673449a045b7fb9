"""The coin: judges and plans at random, as the row below which nothing should fall."""

import random
from dataclasses import dataclass

from pliant.formations import OWNED, RECOVERABLE, Step
from pliant.records import Case, FailureAnalysis, Recovery, Verdict

NAME = "coin"
MOST_M = 0.010  # of its change of a goal


@dataclass(frozen=True)
class Coin:
    """A seeded coin (protocol `pliant.recovery.Reasoner`). It has no memory: its answers depend on
    the seed and on the pose that the arm ended at, so the order of cases changes nothing."""

    seed: int = 1
    name: str = NAME
    model: str | None = None

    def judge(self, case: Case) -> Verdict:
        return Verdict(
            success=self._toss(case, "judge").random() < 0.5,
            reason="a coin was tossed",
            votes=case.evidence.votes,
            conflict=None,
            by=self.name,
        )

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        """Plan a start, a change of its goal and a retreat or none, at random; the rest as it
        is."""
        toss = self._toss(case, "recover")
        start, change = toss.choice(RECOVERABLE), toss.uniform(-MOST_M, MOST_M)
        axis = OWNED[start][0]
        goal = {axis: case.goals.formations[start][axis] + change}
        first = Step(formation=start, goal=goal, retreat=toss.random() < 0.5)
        rest = (case.goals.step(f) for f in RECOVERABLE if f.order > start.order)
        analysis = FailureAnalysis(
            what="not asked", why="not asked", how="a coin was tossed", motion={axis: change}
        )
        return Recovery(analysis=analysis, steps=(first, *rest), by=self.name)

    def _toss(self, case: Case, what: str) -> random.Random:
        return random.Random(f"{self.seed} {what} {case.outcome.pose}")
