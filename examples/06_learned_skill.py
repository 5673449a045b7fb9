"""A learned skill, Fit by feel: a linear policy of the wrist's compression, trained on three seeds
in `pliant/Insertion-v0` by the cross-entropy method. It then stands in for Fit in the paper's loop,
on other seeds. Needs `pliant[gym]`."""

from dataclasses import dataclass, replace

import gymnasium
import numpy as np

from pliant.belief import Belief
from pliant.cell import Motion, Robot
from pliant.conditions import condition
from pliant.envelope import Limits
from pliant.envs.insertion import STATE  # this registers the environments
from pliant.formations import Formation, Step
from pliant.methods import Method, Skill
from pliant.methods.planar import Planar
from pliant.pose import Pose
from pliant.reasoners.rules import Rules
from pliant.records import Looking, Outcome
from pliant.sim.cell import SimCell
from pliant.task import Task, load_task
from pliant.teaching import Teaching, shipped
from pliant.trial import Run

TASK, TAUGHT, TRAIN, HELD_OUT = load_task("circle"), shipped(), (1, 2, 3), range(100, 106)
Y, COMPRESSION = STATE.index("y"), STATE.index("compression")


def move(weights: np.ndarray, compression_m: float) -> float:
    """How far along y, as a part of one full step: -1 to 1."""
    return float(np.clip(weights[0] + weights[1] * compression_m * 1e3, -1, 1))


def score(env: gymnasium.Env, weights: np.ndarray, seed: int) -> float:
    """What the trailing corner lacks to be 1 mm past the near rim, and a tenth of the way [mm]."""
    start = (observation := env.reset(seed=seed)[0])[Y]
    for _ in range(100):
        observation, *_, info = env.step([move(weights, observation[COMPRESSION])])
    truth, half = info["truth"], TASK.peg.half_extents[1]
    past = truth["hole_y"] + half - (truth["tip_y"] + half * np.cos(truth["tilt_rad"]))
    return 1e3 * (min(past - 0.001, 0.0) - 0.1 * abs(observation[Y] - start))


def train(rng: np.random.Generator) -> np.ndarray:
    env = gymnasium.make("pliant/Insertion-v0", start="contact", axes=("y",))
    mean, sd = np.zeros(2), np.ones(2)
    for _ in range(3):
        tried = mean + sd * rng.standard_normal((8, 2))
        scores = np.array([np.mean([score(env, w, seed) for seed in TRAIN]) for w in tried])
        best = tried[np.argsort(-scores)[:3]]
        mean, sd = best.mean(axis=0), best.std(axis=0) + 0.05
        print(f"best score {scores.max():.1f} mm, weights {mean.round(2)}")
    return mean


@dataclass(frozen=True)
class ByFeel(Planar):
    """The paper's method, with Fit as learned where it is tried as taught."""

    weights: np.ndarray

    def skill(self, task: Task, teaching: Teaching, limits: Limits) -> Skill:
        papers = super().skill(task, teaching, limits)

        def act(robot: Robot, look: Looking, target: Pose, step: Step, belief: Belief) -> Outcome:
            if step != teaching.goals.step(Formation.FIT):
                return papers(robot, look, target, step, belief)
            aim, part = replace(target, y=robot.observe(cameras=()).pose.y), -1.0
            motions: list[Motion] = []
            while abs(part) > 0.1 and len(motions) < 40:
                part = move(self.weights, robot.observe(cameras=()).compression_m)
                aim = replace(aim, y=aim.y + 0.003 * part)
                motions.append(robot.move_to(aim, speed_m_s=0.02, stop_at_compression_m=0.020))
            robot.settle(0.6)
            return Outcome(step=step, target=aim, motions=tuple(motions), looks=(look(),))

        return act


def trials(method: Method) -> str:
    cell, at_once, executions = SimCell(), 0, 0
    for seed in HELD_OUT:
        robot = cell.prepare(TASK, condition("all").draw(seed))
        run = Run(robot=robot, task=TASK, teaching=TAUGHT, reasoner=Rules(), method=method)
        fits = [e.verdict.success for e in run if e.formation is Formation.FIT]
        at_once += fits[:1] == [True]
        executions += len(run.history)
    return f"Fit at once in {at_once} of {len(HELD_OUT)} trials, {executions} executions in all"


weights = train(np.random.default_rng(0))
print("held-out seeds, Fit as taught: ", trials(Planar()))
print("held-out seeds, Fit as learned:", trials(ByFeel(weights)))
