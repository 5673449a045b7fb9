"""Cases for the tests of the VLM: of a simulated trial, and hand-made ones it does not meet."""

import re
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo, FunctionModel
from stand_ins import case_after, cell_for, executed, outcome_of, scene_of

from pliant.belief import Belief
from pliant.cell import Stop
from pliant.conditions import condition
from pliant.formations import RECOVERABLE, Formation
from pliant.methods.planar import Planar
from pliant.methods.planar.checks import check
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.reasoner import Vlm
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Case, Recovery, Verdict
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

Answer = Callable[
    [list[ModelMessage], AgentInfo], ModelResponse | Coroutine[Any, Any, ModelResponse]
]


@dataclass(frozen=True)
class _Watching(Rules):
    """The rules, and all that they were asked."""

    judged: list[Case] = field(default_factory=list)
    recovered: list[tuple[Case, Verdict]] = field(default_factory=list)

    @property
    def put(self) -> list[Case]:
        """The cases whose verdict a model is asked for."""
        return [c for c in self.judged if c.outcome.step.formation in RECOVERABLE]

    def judge(self, case: Case) -> Verdict:
        self.judged.append(case)
        return super().judge(case)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        self.recovered.append((case, verdict))
        return super().recover(case, verdict)


@cache
def simulated() -> _Watching:
    """What the rules are asked in a trial with two failures."""
    watching, task = _Watching(), load_task("circle")
    taught = shipped().for_task(task)
    list(
        Run(
            robot=cell_for("circle").prepare(task, condition("all").draw(1)),
            task=task,
            teaching=taught,
            reasoner=watching,
            method=Planar(),
        )
    )
    return watching


@cache
def wedged() -> Case:
    """Insertion ended by the compression limit, after one that ended the same way."""
    scene = scene_of(tip_z=-0.004, tilt_deg=6.0, half=0.01, center_px=330.0)
    case = checked(outcome_of(Formation.INSERTION, stop=Stop.COMPRESSION, scene=scene))
    return replace(case, history=(executed(case),))


@cache
def shallow() -> Case:
    """Insertion that ran its way and is not deep enough, after one that ended the same way."""
    scene = scene_of(tip_z=-0.004, tilt_deg=6.0, half=0.01, center_px=330.0)
    case = checked(outcome_of(Formation.INSERTION, scene=scene))
    return replace(case, history=(executed(case),))


def checked(outcome: Any) -> Case:
    """The case after an outcome, with the checks made."""
    case = case_after(outcome)
    evidence = check(case.task, outcome, case.teaching.scenes)
    return replace(case, evidence=evidence, belief=Belief())


def blind() -> Case:
    """Fit with a picture that shows nothing."""
    return checked(outcome_of(Formation.FIT))


def failures() -> list[tuple[Case, Verdict]]:
    """Failed executions of every kind that is at hand, as the rules judge them."""
    made = [wedged(), blind()]
    return [*simulated().recovered, *((case, Rules().judge(case)) for case in made)]


def asked(messages: object) -> str:
    """What a request asks for, such as "judge this execution"."""
    return re.findall(r"Asked of you now: ([^.]+)\.", str(messages))[-1]


def asking(answer: Answer, **settings: Any) -> Vlm:
    """A VLM whose model is a function."""
    chosen = Settings(**{"model": "scripted", "deadline_s": 20.0, **settings})
    return Vlm(settings=chosen, asked=FunctionModel(answer, model_name="scripted"))
