"""The VLM with the guided skills: what it is told, and that it inserts or stops."""

import re
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import pytest
from pydantic_ai.messages import BinaryContent, ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo
from vlm_cases import asked, asking
from voices import NOTHING_WRONG, reply

from pliant.belief import Belief
from pliant.conditions import condition
from pliant.envelope import Limits
from pliant.experiment.one import Spec, perform
from pliant.formations import OWNED, RECOVERABLE, Formation
from pliant.levels import load_level
from pliant.methods.guided import Guided
from pliant.methods.guided.skills import SHIFTED, SHIFTS
from pliant.methods.named import method
from pliant.methods.planar import Planar
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.replies import change_field, motion_field
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case, End, Execution, Recovery, Trial, Verdict
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

TOLD = Settings(model="scripted", deadline_s=20)
VOICES = Path(__file__).with_name("voices.py")
SAID = {
    **NOTHING_WRONG,
    "what_happened": "it stuck 4 mm deep",
    "why": "something is in the hole",
    "how_to_recover": "a person must look into the hole",
    **dict.fromkeys(map(motion_field, SHIFTS), 0),
}


def trial(level: str, peg: str, seed: int, reasoner: str) -> Trial:
    rung = load_level(level)
    spec = Spec(
        task=load_task(peg, level),
        level=level,
        condition=rung.on(condition("all")),
        seed=seed,
        reasoner=reasoner,
        method=rung.method,
    )
    return perform(spec, SimCell(), shipped())


def own(execution: Execution) -> bool:
    """The model's, and as it said them."""
    plan = execution.recovery
    return not execution.verdict.fallback and (
        plan is None or not (plan.fallback or plan.clamped is not None)
    )


def case_of(done: Trial, index: int) -> Case:
    execution = done.executions[index]
    return Case(
        task=done.task,
        teaching=shipped(),
        goals=done.goals,
        history=done.executions[:index],
        outcome=execution.outcome,
        evidence=execution.evidence,
        belief=execution.belief,
        method=method(done.method),
    )


@cache
def failed() -> Case:
    """A guided skill that failed, after others, on a board that lies anywhere."""
    done = trial("L3", "square", 9001, "rules")
    return case_of(done, next(e.index for e in done.executions if not e.verdict.success))


def words(case: Case, settings: Settings = TOLD) -> str:
    content = prompt.situation(case, settings, asked="", verdict=Rules().judge(case))
    return "\n".join(item for item in content if isinstance(item, str))


# --- told ----------------------------------------------------------------------------------------


def test_a_model_is_told_the_belief_and_what_each_camera_measured() -> None:
    told = words(failed())
    number = r"-?\d+\.\d ± \d+\.\d"
    for line in (
        rf"hole: x_mm {number}\n",
        rf"hole: y_mm {number}\n",
        rf"board: z_mm {number}\n",
        rf"board: yaw_deg {number}\n",
        rf"peg's angle in the grasp: roll_deg {number}\n",
        rf"upright: pitch_deg {number}",
        rf"side camera, peg: tip_y_mm {number}",
        rf"front camera: tip_x_mm {number}, pitch_deg {number}, hole_x_mm {number}",
        r"\d+ motions; compression at rest: -?\d+\.\d mm",
        r"terminal pose: x_mm .*, yaw_deg -?\d+\.\d\n",
        r"\| fit \| y_mm -?\d+\.\d \| y_mm 0\.0 \|",
        r"metric_check: ",
    ):
        assert re.search(line, told), (line, told)


def test_what_is_believed_is_near_the_truth_that_is_never_told() -> None:
    done = trial("L3", "square", 9001, "none")
    told = words(case_of(done, 1))
    believed = re.search(r"hole: x_mm (\S+)", told)
    assert believed is not None
    assert float(believed[1]) == pytest.approx(done.drawn["hole_x"] * 1e3, abs=1.0)
    assert not any(secret in told for secret in ("truth", "drawn", "friction"))


def test_a_reading_that_is_not_believed_and_one_that_is_missing_are_said() -> None:
    case = failed()
    hole = case.outcome.scene.hole
    assert hole is not None
    far = replace(case.belief, hole_y=replace(hole.y, value=hole.y.value + 0.01))
    assert "not believed: hole y_mm" in words(replace(case, belief=far))
    assert "not believed" not in words(replace(case, belief=Belief(hole_y=hole.y)))
    assert "board: yaw_deg not seen yet" in words(replace(case, belief=Belief()))
    last = case.outcome.looks[-1]
    blind = replace(last, scene=replace(last.scene, peg=None, across=None, problems=("no peg",)))
    looks = (*case.outcome.looks[:-1], blind)
    told = words(replace(case, outcome=replace(case.outcome, looks=looks)))
    assert "not measured: no peg" in told
    assert "front camera: no picture" in told


def test_the_front_picture_is_shown_beside_the_side_one() -> None:
    content = prompt.situation(failed(), TOLD, asked="")
    assert sum(isinstance(item, BinaryContent) for item in content) == 2
    content = prompt.situation(failed(), replace(TOLD, picture=False), asked="")
    assert not any(isinstance(item, BinaryContent) for item in content)


def test_the_belief_can_be_withheld() -> None:
    told = words(failed(), replace(TOLD, belief=False))
    for withheld in ("## Believed", "side camera", "metric_check"):
        assert withheld not in told


@pytest.mark.parametrize("plan", Plans)
def test_the_instructions_say_what_a_goal_means_and_when_to_stop(plan: Plans) -> None:
    settings = replace(TOLD, plan=plan, step_limit_mm=25.0)
    guided = prompt.instructions(settings, failed(), Limits())
    assert "Only a goal's shift from the taught goal matters" in guided
    assert "how far from what is believed to aim, for this execution only" in guided
    assert re.search(r"(±|at most )5[ ,:]", guided)
    assert "no motion can help and a person must come" in guided
    assert "25 mm" in guided or "±25" in guided
    assert "$" not in guided
    papers = prompt.instructions(settings, replace(failed(), method=Planar()), Limits())
    assert not any(word in papers for word in ("shift", "yaw", "pitch"))


# --- done ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("level", "peg", "seed", "voice"),
    [
        ("L6", "rectangle_narrow", 9135, "SpeaksForRules"),
        ("L6", "circle", 9133, "AbsoluteRules"),
    ],
)
def test_a_model_that_says_what_the_rules_would_inserts_after_failures(
    level: str, peg: str, seed: int, voice: str
) -> None:
    done = trial(level, peg, seed, f"{VOICES}:{voice}")
    assert done.inserted
    assert done.judged
    assert any(e.recovery is not None and e.recovery.steps for e in done.executions)
    assert all(own(e) for e in done.executions)


@dataclass
class SaysStop:
    """Keeps the rules' verdicts, and a model says stop after the first failed Insertion."""

    plan: Plans
    name: str = "says stop"
    rules: Rules = field(default_factory=Rules)

    def judge(self, case: Case) -> Verdict:
        return self.rules.judge(case)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        if case.outcome.step.formation is not Formation.INSERTION:
            return self.rules.recover(case, verdict)
        return asking(self.answer, plan=self.plan).recover(case, verdict)

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        if "plan" not in asked(messages):
            return reply(info, SAID)
        if self.plan is Plans.ABSOLUTE:
            return reply(info, {"steps": []})
        none = {f: {*OWNED[f], *SHIFTED[f]} for f in RECOVERABLE}
        changes = {change_field(f, axis): 0 for f, axes in none.items() for axis in axes}
        return reply(info, {"resume_from": "stop", "retreat_first": False, **changes})


@cache
def stopped() -> Run:
    """A trial with a plug in the hole, which the model ends."""
    task, taught = load_task("square", "blocked_hole"), shipped()
    setup = load_level("blocked_hole").on(condition("all")).draw(101)
    run = Run(
        robot=SimCell().prepare(task, setup),
        task=task,
        teaching=taught.for_task(task),
        reasoner=SaysStop(Plans.BOUNDED),
        method=Guided(),
    )
    assert list(run)
    return run


def test_a_stop_ends_the_trial_and_its_reason_is_kept() -> None:
    last = stopped().history[-1]
    assert stopped().end_reason == End.STOPPED
    assert last.recovery is not None
    assert last.recovery.by == "vlm"
    assert not last.recovery.fallback
    assert last.recovery.analysis.why == SAID["why"]


def test_a_stop_is_the_same_in_the_other_form_of_plan() -> None:
    run = stopped()
    last = run.history[-1]
    case = Case(
        task=run.task,
        teaching=run.teaching,
        goals=run.teaching.goals,
        history=tuple(run.history[:-1]),
        outcome=last.outcome,
        evidence=last.evidence,
        belief=last.belief,
        method=Guided(),
    )
    recovery = SaysStop(Plans.ABSOLUTE).recover(case, last.verdict)
    assert recovery is not None
    assert (recovery.steps, recovery.by, recovery.fallback) == ((), "vlm", "")
