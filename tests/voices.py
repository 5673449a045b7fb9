"""Scripted models: what a VLM might say, told from the rules, through the real conversation code.

Each is also a reasoner that an experiment can name: `tests/voices.py:SpeaksForRules`.
"""

import json
import random
from dataclasses import dataclass, field
from typing import Any

from pydantic_ai.messages import (
    ModelMessage,
    ModelResponse,
    ModelResponsePart,
    TextPart,
    ToolCallPart,
)
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.usage import RequestUsage
from vlm_cases import asked

from pliant.formations import OWNED, RECOVERABLE
from pliant.methods.guided.skills import SHIFTED, SHIFTS
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.reasoner import Vlm
from pliant.reasoners.vlm.replies import change_field, motion_field, shift_field
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case, Recovery, Verdict

Fields = dict[str, Any]
_NO_LIMIT = 10**12  # a scripted model's tokens are counted by guess, pictures byte by byte
_VOTES = {True: "success", False: "failure", None: "not available"}


def reply(info: AgentInfo, fields: Fields) -> ModelResponse:
    """The fields as the reply that this request asks for: a function call, or JSON."""
    parts: list[ModelResponsePart] = [TextPart(json.dumps(fields))]
    if info.output_tools:
        chosen = (info.model_settings or {}).get("tool_choice")
        name = chosen[0] if isinstance(chosen, list) else info.output_tools[0].name
        parts = [ToolCallPart(name, fields)]
    # The library's own estimate counts a picture's bytes as tokens, and soon spends the budget.
    usage = RequestUsage(input_tokens=900, output_tokens=60)
    return ModelResponse(parts=parts, usage=usage)


def judgement(verdict: Verdict) -> Fields:
    votes = verdict.votes
    return {
        "pose_check": _VOTES[votes.get("pose")],
        "compression_check": _VOTES[votes.get("compression")],
        "table_i": _VOTES[votes.get("table_i")],
        "picture": _VOTES[votes.get("metric")],
        "conflict": verdict.conflict or "",
        "reason": verdict.reason,
        "success": verdict.success,
    }


def no_shifts(case: Case, *names: str) -> Fields:
    """The fields that replies with the guided skills have beside the others, at 0."""
    return dict.fromkeys(names, 0) if case.method.follows_belief else {}


NOTHING_WRONG: Fields = {
    "bottom_left_corner": "not seen",
    "bottom_right_corner": "not seen",
    "what_happened": "",
    "why": "",
    "wrong_goal": "none",
    "how_to_recover": "",
    "fit_y_change_mm": 0,
    "align_y_change_mm": 0,
    "insertion_z_change_mm": 0,
}
"""An analysis that says nothing."""


def analysis(recovery: Recovery, case: Case, gain: float = 1.0) -> Fields:
    told = recovery.analysis
    first = str(recovery.steps[0].formation) if recovery.steps else "none"
    return {
        **NOTHING_WRONG,
        "what_happened": told.what,
        "why": told.why,
        "wrong_goal": first,
        "how_to_recover": told.how,
        **_changes(recovery, case, gain),
    }


def _changes(recovery: Recovery, case: Case, gain: float) -> Fields:
    goals = {step.formation: step.goal for step in recovery.steps}
    fields: Fields = {}
    for formation in RECOVERABLE:
        axis = OWNED[formation][0]
        now = case.goals.formations[formation][axis]
        change = goals.get(formation, {}).get(axis, now) - now
        fields[f"{formation}_{axis}_change_mm"] = round(gain * change * 1e3)
    return fields


def absolute(recovery: Recovery, case: Case, gain: float = 1.0) -> Fields:
    steps = []
    for step in recovery.steps:
        ((axis, goal),) = step.goal.items()
        now = case.goals.formations[step.formation][axis]
        steps.append(
            {
                "skill": str(step.formation),
                "goal_mm": (now + gain * (goal - now)) * 1e3 if gain != 1.0 else goal * 1e3,
                "retreat_first": step.retreat,
                **no_shifts(case, *map(shift_field, SHIFTS)),
            }
        )
    return {"steps": steps}


def bounded(recovery: Recovery, case: Case, gain: float = 1.0) -> Fields:
    names = (change_field(f, axis) for f in SHIFTED for axis in SHIFTED[f])
    fields: Fields = {"resume_from": "stop", "retreat_first": False, **no_shifts(case, *names)}
    if recovery.steps:
        fields["resume_from"] = str(recovery.steps[0].formation)
        fields["retreat_first"] = recovery.steps[0].retreat
    return fields | _changes(recovery, case, gain)


def scripted(**changes: Any) -> Settings:
    """Settings of a scripted model."""
    return Settings(model="scripted", max_tokens=_NO_LIMIT, **{"deadline_s": 20, **changes})


@dataclass(kw_only=True)
class Scripted(Vlm):
    """A VLM whose model is a function of the case it is asked about."""

    settings: Settings = field(default_factory=scripted)
    asked: Any = None
    case: Case | None = None
    verdict: Verdict | None = None

    def __post_init__(self) -> None:
        self.asked = FunctionModel(self.answer, model_name="scripted")
        super().__post_init__()

    def judge(self, case: Case) -> Verdict:
        self.case = case
        return super().judge(case)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        self.case, self.verdict = case, verdict
        return super().recover(case, verdict)

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        raise NotImplementedError


@dataclass(kw_only=True)
class SpeaksForRules(Scripted):
    """Says what the rules would do. `gain` multiplies its advice, `flipped` is how often it points
    the other way."""

    gain: float = 1.0
    flipped: float = 0.0
    seed: int = 0
    _gain: float = 1.0

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        assert self.case is not None
        stage = asked(messages)
        if stage.startswith("judge"):
            return reply(info, judgement(Rules().judge(self.case)))
        assert self.verdict is not None
        recovery = Rules().recover(self.case, self.verdict)
        assert recovery is not None
        fields: Fields = {}
        if stage.startswith("analyse"):
            draw = random.Random(f"{self.seed} {len(self.case.history)}")
            self._gain = -self.gain if draw.random() < self.flipped else self.gain
            fields |= analysis(recovery, self.case, self._gain)
            fields |= no_shifts(self.case, *map(motion_field, SHIFTS))
        if "plan" in stage:
            write = absolute if self.settings.plan is Plans.ABSOLUTE else bounded
            fields |= write(recovery, self.case, self._gain)
        return reply(info, fields)


@dataclass(kw_only=True)
class TenTimes(SpeaksForRules):
    """Right in direction, ten times too much."""

    gain: float = 10.0


@dataclass(kw_only=True)
class OftenWrong(SpeaksForRules):
    """Points the wrong way in 30 % of its decisions."""

    flipped: float = 0.3


@dataclass(kw_only=True)
class Silent(Scripted):
    """Never answers."""

    settings: Settings = field(default_factory=lambda: scripted(deadline_s=0.2))

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        raise ConnectionError("nobody is there")


@dataclass(kw_only=True)
class AbsoluteRules(SpeaksForRules):
    settings: Settings = field(default_factory=lambda: scripted(plan=Plans.ABSOLUTE))


@dataclass(kw_only=True)
class TenTimesAlone(TenTimes):
    settings: Settings = field(default_factory=lambda: scripted(fallback=False))


@dataclass(kw_only=True)
class OftenWrongAlone(OftenWrong):
    settings: Settings = field(default_factory=lambda: scripted(fallback=False))
