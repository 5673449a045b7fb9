"""The embedded reasoner: judges from all the evidence and plans by rules, which are its method's.

It is not a VLM and does not pretend to be one; it answers the same three questions in the same
records, so that what a VLM adds can be measured against it. It sees what a real cell would give:
pictures, poses, compression, goals and the nominal task.
"""

from dataclasses import dataclass

from pliant.formations import Formation
from pliant.records import Case, Check, Recovery, Verdict


@dataclass(frozen=True)
class Rules:
    """The rules reasoner (protocol `pliant.recovery.Reasoner`)."""

    name: str = "rules"
    model: str | None = None

    def judge(self, case: Case) -> Verdict:
        """Judge an execution: what is certainly not as the task says,
        compression or pose can fail it; else the most precise check that was
        made decides."""
        votes = case.evidence.votes
        success, decider = _decide(case)
        against = sorted(n for n, v in votes.items() if v is not None and v != success)
        conflict = f"{', '.join(against)} disagreed" if against else None
        return Verdict(
            success=success,
            reason=f"{decider.name}: {decider.message}",
            votes=votes,
            conflict=conflict,
            by=self.name,
        )

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        return case.method.plan(case, verdict, self.name)


def _decide(case: Case) -> tuple[bool, Check]:
    evidence = case.evidence
    for name in ("plausible", "compression", "pose"):
        check = evidence[name]
        if check is not None and check.vote is False:
            return False, check
    for name in ("metric", "table_i", "goal_picture"):
        check = evidence[name]
        if check is not None and check.vote is not None:
            return check.vote, check
    if case.outcome.step.formation in (Formation.APPROACH, Formation.CONTACT):
        check = evidence["pose"]
        assert check is not None
        return True, check
    unseen = evidence["metric"]
    assert unseen is not None
    return False, unseen
