"""A model that answers as the rules would, whichever provider it is asked through."""

import json
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from loopback import Fields
from strict import Asked, Said
from voices import analysis, bounded, judgement

from pliant.reasoners.rules import Rules
from pliant.records import Case, Recovery, Verdict
from pliant.recovery import Reasoner


@dataclass
class Honest:
    """A reasoner's conversations, as the model behind them sees it: which form it is asked for
    next, and what is right to say there."""

    mind: Any = None
    expected: deque[tuple[str, Fields]] = field(default_factory=deque)
    name: str = "vlm"

    def asks(self, mind: Reasoner) -> "Honest":
        self.mind = mind
        return self

    def judge(self, case: Case) -> Verdict:
        self.expected.append(("judge", judgement(Rules().judge(case))))
        verdict: Verdict = self.mind.judge(case)
        if not verdict.exchanges:  # not every formation is asked about
            self.expected.clear()
        return verdict

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        right = Rules().recover(case, verdict)
        assert right is not None
        self.expected += [("analyse", analysis(right, case)), ("plan", bounded(right, case))]
        return self.mind.recover(case, verdict)

    def answer(self, asked: Asked) -> Said:
        """The right form; where another must be called, that is a mistake of the client."""
        form, fields = self.expected.popleft()
        assert asked.choice in (None, form), f"{asked.choice} must be called for {form}"
        if not asked.tools:
            return Said(words=json.dumps(fields))
        assert form in asked.tools
        return Said(tool=form, fields=fields)
