"""How fast a simulated trial is, and where its time goes: `make bench`.

Three figures from one run, medians over trials of the circle under `all`:
the bare `mj_step` rate of the same model; a trial's skills without pictures; whole trials with the
rules and a 640x480 picture per check. "Other" is everything that is neither physics nor rendering:
inverse kinematics, measuring, checking, reasoning, records.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core, as in an experiment

import pliant.sim  # noqa: F401, chooses the OpenGL back end

# isort: split
import mujoco

from pliant.belief import Belief
from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.methods.planar.skills import PlanarSkills
from pliant.records import Look
from pliant.sim import render
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.scene import Scene


@dataclass(kw_only=True)
class Clock:
    """Adds up the time spent inside a function that it wraps."""

    seconds: float = 0.0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **kwargs: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds += time.perf_counter() - began

        return timed


@dataclass(frozen=True, kw_only=True)
class Row:
    """One trial's times [s]."""

    simulated: float
    wall: float
    physics: float
    rendering: float

    @property
    def other(self) -> float:
        return self.wall - self.physics - self.rendering


def skills_only(robot: SimRobot) -> None:
    """The five skills with the taught goals; looks take no picture."""
    goals = shipped().goals
    for formation in Formation:
        PlanarSkills(taught=goals)(
            robot,
            lambda: Look(observation=robot.observe(cameras=()), scene=Scene(peg=None, hole=None)),
            goals.target(formation),
            goals.step(formation),
            Belief(),
        )


def bare_rate(robot: SimRobot, step: Callable[..., None] = mujoco.mj_step) -> float:
    """Steps/s of the robot's model with nothing around them."""
    began = time.perf_counter()
    step(robot.model, robot.data, 10_000)
    return 10_000 / (time.perf_counter() - began)


def main(trials: int) -> None:
    task, drawn, cell = load_task("circle"), condition("all"), SimCell()
    physics, rendering = Clock(), Clock()
    bare = mujoco.mj_step
    mujoco.mj_step = physics.around(bare)
    render.Cameras.image = rendering.around(render.Cameras.image)  # type: ignore[method-assign]

    def measured(body: Callable[[int], float]) -> list[Row]:
        rows = []
        for seed in range(trials + 1):
            physics.seconds = rendering.seconds = 0.0
            began = time.perf_counter()
            simulated = body(seed)
            row = Row(
                simulated=simulated,
                wall=time.perf_counter() - began,
                physics=physics.seconds,
                rendering=rendering.seconds,
            )
            rows += [row] if seed else []  # the first one warms up
        return rows

    def without_pictures(seed: int) -> float:
        robot = cell.prepare(task, drawn.draw(seed))
        skills_only(robot)
        return robot.clock()

    def whole(seed: int) -> float:
        spec = Spec(task=task, condition=drawn, seed=seed, reasoner="rules")
        return perform(spec, cell, shipped()).simulated_s

    robot = cell.prepare(task, drawn.draw(0))
    rate = statistics.median(bare_rate(robot, bare) for _ in range(5))
    step = robot.model.opt.timestep
    print(f"bare mj_step: {rate:,.0f} steps/s, {rate * step:.0f} x real time")
    for name, body in (("five skills, no pictures", without_pictures), ("whole trial", whole)):
        report(name, measured(body))


def report(name: str, rows: list[Row]) -> None:
    def median(value: Callable[[Row], float]) -> float:
        return statistics.median(map(value, rows))

    print(
        f"{name} (n = {len(rows)}): {median(lambda r: r.simulated / r.wall):.0f} x real time;"
        f" {median(lambda r: r.simulated):.1f} s simulated in {median(lambda r: r.wall):.3f} s:"
        f" physics {median(lambda r: r.physics):.3f},"
        f" rendering {median(lambda r: r.rendering):.3f}, other {median(lambda r: r.other):.3f}"
        f" ({100 * median(lambda r: r.other / r.physics):.0f} % of physics)"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=20)
    main(parser.parse_args().trials)
