"""A learned reasoner: it repeats the recorded recovery whose case was most alike.

The recoveries are the rules', recorded in `pliant/Recovery-v0`; the learned reasoner then plans in
their place on other seeds. The judge stays the rules'. Needs `pliant[gym]`.
"""

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from pliant.conditions import condition
from pliant.envs.decision import as_action, as_recovery, numbers  # this registers the environments
from pliant.methods.planar import Planar
from pliant.reasoners.rules import Rules
from pliant.records import Case, Recovery, Verdict
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

EPISODES, HELD_OUT = 12, range(100, 106)


def record() -> tuple[np.ndarray, np.ndarray]:
    """Cases (n, fields) and the rules' answers to them (n, 5)."""
    env = gymnasium.make("pliant/Recovery-v0")
    recovering: Any = env.unwrapped
    cases, answers = [], []
    for episode in range(EPISODES):
        observation, _ = env.reset(seed=1 if episode == 0 else None)
        done = False
        while not done:
            question = recovering.question
            recovery = Rules().recover(question.case, question.verdict)
            assert recovery is not None
            cases.append(observation)
            answers.append(as_action(recovery, question.case))
            observation, _, terminated, truncated, _ = env.step(answers[-1])
            done = terminated or truncated
    return np.array(cases), np.array(answers)


@dataclass(frozen=True, kw_only=True)
class Nearest(Rules):
    """Answers as the most similar recorded case was answered."""

    name: str = "nearest"
    cases: np.ndarray
    answers: np.ndarray

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        spread = self.cases.std(axis=0)
        away = (self.cases - numbers(case, verdict)) / np.where(spread > 1e-6, spread, 1.0)
        nearest = np.argmin(np.linalg.norm(away, axis=1))
        return as_recovery(self.answers[nearest], case, verdict, self.name)


def score(reasoner: Rules) -> str:
    """Trials on the held-out seeds, in the paper's loop."""
    task, taught, cell = load_task("circle"), shipped(), SimCell()
    inserted, recoveries, executions = 0, 0, 0
    for seed in HELD_OUT:
        robot = cell.prepare(task, condition("all").draw(seed))
        run = Run(robot=robot, task=task, teaching=taught, reasoner=reasoner, method=Planar())
        recoveries += sum(execution.recovery is not None for execution in run)
        executions += len(run.history)
        inserted += bool(cell.truth().inserted)
    return f"inserted {inserted}/{len(HELD_OUT)}, {recoveries} recoveries, {executions} executions"


cases, answers = record()
print(f"{len(cases)} recoveries recorded in {EPISODES} trials")
print("held-out seeds, rules:  ", score(Rules()))
print("held-out seeds, nearest:", score(Nearest(cases=cases, answers=answers)))
