"""Controls: reasoners that share the rules' judge, to show what recovery, and reading the evidence,
are worth."""

from dataclasses import dataclass

from pliant.formations import Formation
from pliant.reasoners.rules import Rules
from pliant.records import Case, FailureAnalysis, Recovery, Verdict


@dataclass(frozen=True)
class OpenLoop(Rules):
    """The paper's baseline: all five skills once with the taught goals, whatever the verdicts."""

    name: str = "none"

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        return None


@dataclass(frozen=True)
class Retry(Rules):
    """Retreat, and repeat from touch-down with the taught goals."""

    name: str = "retry"

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        goals = case.teaching.goals
        return Recovery(
            analysis=FailureAnalysis(
                what=verdict.reason, why="not asked", how="retreat and repeat as taught", motion={}
            ),
            steps=(
                goals.step(Formation.FIT, retreat=True),
                goals.step(Formation.ALIGN),
                goals.step(Formation.INSERTION),
            ),
            by=self.name,
        )
