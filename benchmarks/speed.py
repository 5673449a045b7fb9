"""How fast a simulated trial is, and where its time goes: `make bench`, for docs/speed.md.

Everything is processor time of one process on one core, medians. A trial is the rules' under `all`;
its parts are the physics (`mj_step`), drawing (with the noise of random looks), looks (what a
picture is measured for), decisions (the reasoner), and the rest: inverse kinematics, the wrist's
watch, checks, records.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core, as in an experiment

import pliant.sim  # noqa: F401, chooses the OpenGL back end

# isort: split
import cv2
import mujoco

from pliant.belief import Belief
from pliant.cell import Observation
from pliant.conditions import condition
from pliant.experiment.faults import Heeded
from pliant.experiment.misread import Misread
from pliant.experiment.one import Spec, perform
from pliant.formations import Formation
from pliant.levels import load_level
from pliant.methods.planar.skills import PlanarSkills
from pliant.records import Look
from pliant.sim.cell import SimCell, SimRobot
from pliant.sim.render import Cameras
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.edges import measure_edges
from pliant.vision.learned import measure_learned
from pliant.vision.measure import measure
from pliant.vision.outline import board_outline
from pliant.vision.scene import Scene

LEVELS = ("L0", "L5", "L8")
BEGIN, END = "<!-- costs -->\n", "<!-- /costs -->"


@dataclass(kw_only=True)
class Clock:
    """Adds up the time spent inside a function that it wraps."""

    seconds: float = 0.0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds += time.process_time() - began

        return timed


def skills_only(robot: SimRobot) -> None:
    """The five skills with the taught goals; looks take no picture."""
    goals = shipped().goals

    def look(cameras: Sequence[str] = ()) -> Look:
        return Look(observation=robot.observe(cameras=()), scene=Scene(peg=None, hole=None))

    for formation in Formation:
        PlanarSkills(taught=goals)(
            robot,
            look,
            goals.target(formation),
            goals.step(formation),
            Belief(),
        )


def bare_rate(robot: SimRobot, step: Callable[..., None] = mujoco.mj_step) -> float:
    """Steps/s of the robot's model with nothing around them."""
    began = time.perf_counter()
    step(robot.model, robot.data, 10_000)
    return 10_000 / (time.perf_counter() - began)


def median_ms(body: Callable[[], object], times: int) -> float:
    """The processor time of a call [ms], after two that warm up."""
    spent = []
    for _ in range(times + 2):
        began = time.process_time()
        body()
        spent.append(1e3 * (time.process_time() - began))
    return statistics.median(spent[2:])


def prepared(cell: SimCell, level: str, seed: int = 1) -> SimRobot:
    return cell.prepare(
        load_task("circle", level), load_level(level).on(condition("all")).draw(seed)
    )


def pieces(times: int) -> Iterator[str]:
    """The lines of the first table."""
    cell = SimCell()
    robot = prepared(cell, "L0")
    rates = [bare_rate(robot) for _ in range(times)]
    yield f"| step of physics (2 ms), circle | {1e6 / statistics.median(rates):.1f} µs |"
    skills = median_ms(lambda: skills_only(prepared(cell, "L0")), times)
    yield f"| the five skills without pictures | {skills:.0f} ms |"
    for level, looks in (("L0", "nominal looks"), ("L8", "random looks")):
        robot = prepared(cell, level)
        for camera in ("side", "front", "oblique", "wide"):
            spent = median_ms(partial(robot.cameras.view, camera, robot.data, 0.0), times)
            yield f"| picture, {looks}, {camera} camera | {spent:.1f} ms |"
    seen = prepared(cell, "L0").observe()
    spent = median_ms(lambda: measure(seen.views["side"], load_task("circle")), times)
    yield f"| one picture measured by colour | {spent:.1f} ms |"
    robot = prepared(cell, "L8")
    yield from shapes(robot.observe(("side", "oblique")), robot, times)


def shapes(seen: Observation, robot: SimRobot, times: int) -> Iterator[str]:
    side, task, pose = seen.views["side"], robot.task, seen.pose
    for words, body in (
        ("by edges", lambda: measure_edges(side, task, pose, pressed=0.0)),
        ("by the learned sight", lambda: measure_learned(side, task, pose, pressed=0.0)),
        ("for the board's outline", lambda: board_outline(seen.views["oblique"])),
    ):
        yield f"| one picture measured {words} | {median_ms(body, times):.1f} ms |"


def trials(count: int) -> Iterator[str]:
    """The lines of the second table."""
    parts = {
        "physics": [(mujoco, "mj_step")],
        "drawing": [(Cameras, "view")],
        "looks": [(Misread, "__call__")],
        "decisions": [(Heeded, "judge"), (Heeded, "recover")],
    }
    clocks = {name: Clock() for name in parts}
    for name, functions in parts.items():
        for owner, function in functions:
            setattr(owner, function, clocks[name].around(getattr(owner, function)))
    cell = SimCell()
    for level in LEVELS:
        rows: list[dict[str, float]] = []
        for seed in range(count + 1):
            spec = Spec.named(level=level, seed=seed)
            for clock in clocks.values():
                clock.seconds = 0.0
            began = time.process_time()
            trial = perform(spec, cell, shipped())
            spent = time.process_time() - began
            row = {name: clock.seconds for name, clock in clocks.items()}
            row |= {"rest": spent - sum(row.values()), "all": spent, "simulated": trial.simulated_s}
            rows += [row] if seed else []  # the first one warms up
        total = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
        shares = [
            statistics.median(row[name] / row["all"] for row in rows) for name in (*parts, "rest")
        ]
        shown = " | ".join(f"{100 * share:.0f} %" for share in shares)
        yield f"| {level} | {total['simulated']:.1f} s | {total['all']:.2f} s | {shown} |"


def processor() -> str:
    """The processor's name, where Linux tells it."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")


def main(times: int, count: int, page: Path | None) -> None:
    cv2.setNumThreads(1)
    lines = [
        f"One core of a shared x86 machine ({processor()}), drawing by software"
        f" ({os.environ['MUJOCO_GL']}); medians of {times}.",
        "",
        "| what | processor time |",
        "|---|---|",
        *pieces(times),
        "",
        f"Trials of the circle under `all` with the rules, medians of {count}:",
        "",
        "| level | simulated | processor time | physics | drawing | looks | decisions | rest |",
        "|---|---|---|---|---|---|---|---|",
        *trials(count),
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if page is not None:
        before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        page.write_text(before + BEGIN + text + END + after, encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--trials", type=int, default=12, help="of each level")
    parser.add_argument("--page", type=Path, help="put the tables into this page")
    given = parser.parse_args()
    main(given.times, given.trials, given.page)
