"""The reasoner that asks a vision-language model (protocol `pliant.recovery.Reasoner`).

Judge, analyse, plan, as in Sec. V. A model is never trusted: its plan passes the same admission as
any other and is refused with a reason once; refused again it is cut down where the evidence points
the same way, else the rules answer in its place. The record says which.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from pydantic import BaseModel
from pydantic_ai.models import Model

from pliant.cell import Stop
from pliant.envelope import Limits
from pliant.formations import RECOVERABLE, Formation
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import plans, prompt
from pliant.reasoners.vlm.conversation import ModelAnswer, ask
from pliant.reasoners.vlm.replies import (
    Analysis,
    Inquiry,
    Judgement,
    absolute_plan,
    analysis_form,
    bounded_plan,
    with_analysis,
)
from pliant.reasoners.vlm.settings import Decider, Plans, Settings
from pliant.reasoners.vlm.tape import Tape
from pliant.reasoners.vlm.telling import tells_measurements
from pliant.reasoners.vlm.wire import Budget, Wire
from pliant.records import Case, Exchange, FailureAnalysis, Probe, Recovery, Verdict

T = TypeVar("T", bound=BaseModel)
_SILENT = 3  # decisions in a row without any reply, after which the trial asks no more
_CHECKS = "checks"
_VOTE = {"success": True, "failure": False, "not available": None}


@dataclass(kw_only=True)
class Vlm:
    """One trial's conversations with the model `asked`."""

    settings: Settings
    asked: Model
    limits: Limits = field(default_factory=Limits)
    name: str = "vlm"
    tape: Tape = field(default_factory=Tape)
    rules: Rules = field(default_factory=Rules)
    _silent: int = 0
    _last: str = ""
    _inquired: tuple[Exchange, ...] = ()  # in which it wanted no probe

    def __post_init__(self) -> None:
        most_mm = min(self.settings.step_limit_mm, self.limits.goal_step_m * 1e3)
        self.settings = replace(self.settings, step_limit_mm=most_mm)
        self._wire = Wire(self.asked, Budget(self.settings), self.tape)

    @property
    def model(self) -> str:
        return self.settings.name or self.asked.model_name

    # --- judging ---------------------------------------------------------------------------------

    def judge(self, case: Case) -> Verdict:
        settings = self.settings
        if settings.judge is Decider.RULES:
            return self.rules.judge(case)
        known = unasked(case) or (_agreed(case) if settings.skip_agreed else None)
        if known is not None:
            return known
        is_insertion = case.outcome.step.formation is Formation.INSERTION
        answer = self._ask(
            case,
            "judge",
            Judgement,
            self._deadline(),
            goal_picture=settings.goal_picture and is_insertion,
        )
        said = answer.value
        if said is not None:
            return Verdict(
                success=said.success,
                reason=said.reason,
                votes={
                    name: _VOTE[getattr(said, name)]
                    for name in ("pose_check", "compression_check", "table_i", "picture")
                },
                conflict=said.conflict or None,
                by=self.name,
                exchanges=answer.exchanges,
            )
        if settings.fallback:
            verdict = self.rules.judge(case)
            return replace(verdict, exchanges=answer.exchanges, fallback=answer.problem)
        return Verdict(
            success=False,
            reason=f"the model gave no verdict: {answer.problem}",
            votes={},
            conflict=None,
            by=self.name,
            exchanges=answer.exchanges,
        )

    # --- recovering ------------------------------------------------------------------------------

    def inquire(self, case: Case, verdict: Verdict) -> Probe | None:
        """The probe that the model asks for (protocol `pliant.recovery.Inquirer`)."""
        if self.settings.recover is Decider.RULES or not self.settings.probes:
            return None
        answer = self._ask(case, "probe", Inquiry, self._deadline(), verdict=verdict)
        said = answer.value
        if said is None or said.probe == "none":
            self._inquired = answer.exchanges
            return None
        at = (said.x_mm * 1e-3, said.y_mm * 1e-3) if said.probe == "touch" else None
        return Probe(reason=said.reason, at=at, by=self.name, exchanges=answer.exchanges)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        if self.settings.recover is Decider.RULES:
            return self.rules.recover(case, verdict)
        recovery = self._recovered(case, verdict)
        before, self._inquired = self._inquired, ()
        if recovery is None or not before:
            return recovery
        return replace(recovery, exchanges=before + recovery.exchanges)

    def _recovered(self, case: Case, verdict: Verdict) -> Recovery | None:
        until = self._deadline()
        if self.settings.one_call:
            return self._planned(case, verdict, None, (), until)
        form = analysis_form(case.method)
        answer = self._ask(case, "analyse", form, until, verdict=verdict)
        if answer.value is None:
            return self._instead(case, verdict, None, answer.problem, answer.exchanges)
        analysis = plans.analysis_of(answer.value)
        return self._planned(case, verdict, analysis, answer.exchanges, until)

    def _planned(
        self,
        case: Case,
        verdict: Verdict,
        analysis: FailureAnalysis | None,
        before: tuple[Exchange, ...],
        until: float,
    ) -> Recovery | None:
        """The executable plan; with `analysis` None the same reply holds the analysis."""
        settings = self.settings
        plan = _plan(case, settings)
        reply = with_analysis(plan, analysis_form(case.method)) if analysis is None else plan
        most_m = settings.step_limit_mm * 1e-3
        proposed: Recovery | None = None  # by the last reply that could be read

        def check(said: BaseModel) -> str | None:
            nonlocal proposed
            steps = plans.steps_of(said, case)
            told = plans.analysis_of(said) if isinstance(said, Analysis) else analysis
            assert told is not None, "a reply without an analysis follows one"
            proposed = Recovery(analysis=told, steps=steps, by=self.name)
            reason = plans.in_metres(steps, case) if settings.plan is Plans.ABSOLUTE else None
            if reason is None:
                return plans.refusal(proposed, case, self.limits, most_m)
            proposed = None
            return reason

        answer = self._ask(
            case,
            "plan",
            reply,
            until,
            asked="both" if analysis is None else "plan",
            verdict=verdict,
            analysis=analysis,
            check=check,
        )
        exchanges = before + answer.exchanges
        if answer.value is not None and proposed is not None:
            return replace(proposed, exchanges=exchanges)
        return self._instead(case, verdict, proposed, answer.problem, exchanges)

    def _instead(
        self,
        case: Case,
        verdict: Verdict,
        refused: Recovery | None,
        problem: str,
        exchanges: tuple[Exchange, ...],
    ) -> Recovery | None:
        """The recovery where the model gave no plan that may be done."""
        if not self.settings.fallback:
            stop = FailureAnalysis(
                what=verdict.reason, why=f"no usable plan: {problem}", how="stop", motion={}
            )
            return Recovery(analysis=stop, steps=(), by=self.name, exchanges=exchanges)
        evidence = self.rules.recover(case, verdict)
        if refused is not None:
            most = min(self.settings.clamp_mm, self.settings.step_limit_mm) * 1e-3
            cut = plans.clamped(refused, evidence, case, self.limits, most)
            if cut is not None:
                return replace(cut, exchanges=exchanges)
        if evidence is None:
            return None
        return replace(evidence, exchanges=exchanges, fallback=problem)

    # --- asking ----------------------------------------------------------------------------------

    def _deadline(self) -> float:
        return time.monotonic() + self.settings.deadline_s

    def _ask(
        self,
        case: Case,
        stage: str,
        reply: type[T],
        until: float,
        *,
        asked: str | None = None,
        verdict: Verdict | None = None,
        check: Callable[[T], str | None] = lambda _: None,
        **shown: Any,
    ) -> ModelAnswer[T]:
        """The model's answer to the situation with the verdict so far, and what else is `shown`;
        `asked` is as in `prompt.ASKED`, the stage if None."""
        if self._silent >= _SILENT:
            why = f"not asked: the model was silent {_SILENT} times in a row, last for {self._last}"
            return ModelAnswer(value=None, problem=why)
        left = until - time.monotonic()
        if left <= 0:
            why = f"no time left of the {self.settings.deadline_s:g} s for this decision"
            return ModelAnswer(value=None, problem=why)
        answer = ask(
            self._wire,
            self.settings,
            stage=stage,
            instructions=prompt.instructions(self.settings, case, self.limits),
            content=prompt.situation(
                case,
                self.settings,
                asked=prompt.ASKED[asked or stage],
                verdict=None
                if verdict is None
                else as_told(verdict, case, self.settings, self.name),
                **shown,
            ),
            reply=reply,
            deadline_s=left,
            check=check,
            forms=_forms(case, self.settings),
        )
        if any(exchange.reply for exchange in answer.exchanges):
            self._silent = 0
        elif answer.exchanges:
            self._silent += 1
            self._last = answer.problem
        return answer


def _forms(case: Case, settings: Settings) -> dict[str, type[BaseModel]]:
    """All forms that a trial asks for, by stage, the same in each of its requests."""
    forms: dict[str, type[BaseModel]] = {"judge": Judgement, "probe": Inquiry}
    plan, analysis = _plan(case, settings), analysis_form(case.method)
    if settings.one_call:
        forms["plan"] = with_analysis(plan, analysis)
    else:
        forms |= {"analyse": analysis, "plan": plan}
    return {stage: forms[stage] for stage in settings.stages if stage in forms}


def _plan(case: Case, settings: Settings) -> type[BaseModel]:
    """The form of a plan."""
    if settings.plan is Plans.ABSOLUTE:
        return absolute_plan(case.method)
    return bounded_plan(settings.step_limit_mm, case.method)


def as_told(verdict: Verdict, case: Case, settings: Settings, name: str) -> Verdict:
    """The verdict as the model of this name is told it. The words of another judge hold
    measurements and Table I, which a model that is not told them would learn that way."""
    if verdict.by == name or tells_measurements(settings, case):
        return verdict
    return replace(verdict, reason=f"judged by {verdict.by}", conflict=None)


def unasked(case: Case) -> Verdict | None:
    """The verdict that no model is asked for; None: one is. CF0 and CF1 are taken to succeed where
    the arm got there (Sec. III), and a compression stop is a failure of whatever it ended
    (Sec. V-A)."""
    evidence, stopped = case.evidence, case.outcome.stop is Stop.COMPRESSION
    if not stopped and case.outcome.step.formation in RECOVERABLE:
        return None
    failed = [c for c in evidence.checks if c.vote is False]
    return Verdict(
        success=not stopped and not failed,
        reason="; ".join(f"{c.name}: {c.message}" for c in failed or evidence.checks),
        votes=evidence.votes,
        conflict=None,
        by=_CHECKS,
    )


def _agreed(case: Case) -> Verdict | None:
    """The verdict of checks that all say the same; None: they do not, or one could not be made."""
    votes = case.evidence.votes
    if None in votes.values() or len(set(votes.values())) != 1:
        return None
    success = True in votes.values()
    reason = "; ".join(f"{c.name}: {c.message}" for c in case.evidence.checks)
    return Verdict(success=success, reason=reason, votes=votes, conflict=None, by=_CHECKS)
