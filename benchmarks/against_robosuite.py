"""Pliant's trials beside robosuite's UR5e: `make bench-peers`.

Robosuite gets an environment of its own in .cache/robosuite, made at the first use. Every
repetition measures, one after the other: the bare `mj_step` of pliant's model; the five skills
without pictures; a whole trial (circle, `all`, the rules); and robosuite's Lift with a UR5e for as
many simulated seconds as that trial, without a camera and with one. Each engine runs in one process
on one core, with the same OpenGL.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import speed  # before whatever imports MuJoCo: it chooses the OpenGL

from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

HERE = Path(__file__).parent
REQUIREMENTS = HERE / "robosuite-requirements.txt"
UV = HERE.parent / ".tools" / "bin" / "uv"
HOME = HERE.parent / ".cache" / "robosuite"
PYTHON = HOME / "bin" / "python"
MOST_S = 150.0  # no new repetition begins later

BARE = "`mj_step` alone, pliant's model"
SKILLS = "pliant, five skills, no picture"
TRIAL = "pliant, whole trial, a 640x480 picture a check"
STEPS = "robosuite, no camera"
PICTURES = "robosuite, a 640x480 picture a control step"


def environment() -> None:
    """Make robosuite's environment where it is not as its requirements say."""
    stamp = HOME / "requirements.txt"
    if stamp.exists() and stamp.read_bytes() == REQUIREMENTS.read_bytes():
        return
    install = (UV, "pip", "install", "--no-deps", "--python", PYTHON, "-r", REQUIREMENTS)
    for command in ((UV, "venv", "--clear", "--python", sys.executable, HOME), install):
        try:
            cache = {"UV_CACHE_DIR": str(HERE.parent / ".cache" / "uv"), **os.environ}
            subprocess.run(command, check=True, capture_output=True, encoding="utf-8", env=cache)
        except FileNotFoundError:
            sys.exit(f"{UV} does not exist: run 'make setup' first")
        except subprocess.CalledProcessError as error:
            said = " ".join(error.stderr.split())
            sys.exit(f"robosuite's environment {HOME} cannot be made: {said}")
    stamp.write_bytes(REQUIREMENTS.read_bytes())


@dataclass(kw_only=True)
class Robosuite:
    """Robosuite's process."""

    process: "subprocess.Popen[str]"
    about: dict[str, Any]

    def wall(self, seconds: float, cameras: int) -> float:
        """Wall time [s] of so much simulated time."""
        assert self.process.stdin is not None
        print(seconds, cameras, file=self.process.stdin, flush=True)
        return float(_answer(self.process))


@contextmanager
def robosuite() -> Iterator[Robosuite]:
    """It ends with the context."""
    with (HOME / "steps.log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            [PYTHON, HERE / "robosuite_steps.py"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            encoding="utf-8",
        )
    try:
        yield Robosuite(process=process, about=_answer(process))
    finally:
        process.kill()
        process.wait()


def _answer(process: "subprocess.Popen[str]") -> Any:
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        said = (HOME / "steps.log").read_text(encoding="utf-8").strip().splitlines()
        sys.exit(f"robosuite failed: {said[-1] if said else 'it said nothing'}")
    return json.loads(line)


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """Simulated seconds per second of each, and the trial's times [s]."""

    rates: dict[str, float]
    simulated: float
    wall: float


def whole(cell: SimCell, seed: int) -> float:
    """A trial; how long it was [simulated s]."""
    spec = Spec(task=load_task("circle"), condition=condition("all"), seed=seed, reasoner="rules")
    return perform(spec, cell, shipped()).simulated_s


def repeated(cell: SimCell, peer: Robosuite, seed: int) -> Repetition:
    task, drawn = load_task("circle"), condition("all")
    robot = cell.prepare(task, drawn.draw(seed))
    rates = {BARE: speed.bare_rate(robot) * robot.model.opt.timestep}
    began = time.perf_counter()
    robot = cell.prepare(task, drawn.draw(seed))
    speed.skills_only(robot)
    rates[SKILLS] = robot.clock() / (time.perf_counter() - began)
    began = time.perf_counter()
    simulated = whole(cell, seed)
    wall = time.perf_counter() - began
    rates[TRIAL] = simulated / wall
    rates[STEPS] = simulated / peer.wall(simulated, 0)
    rates[PICTURES] = simulated / peer.wall(simulated, 1)
    return Repetition(rates=rates, simulated=simulated, wall=wall)


def report(seen: list[Repetition], about: dict[str, Any], timestep: float) -> None:
    """A Markdown table of medians, least and most in parentheses."""

    def spread(values: list[float]) -> str:
        return f"{statistics.median(values):.3g} ({min(values):.3g} – {max(values):.3g})"

    print(
        f"| simulated seconds per second | median of {len(seen)} | × {STEPS}"
        " | × robosuite, with pictures |"
    )
    print("|---|---|---|---|")
    for name in (BARE, SKILLS, TRIAL, STEPS, PICTURES):
        ratios = ([r.rates[name] / r.rates[peer] for r in seen] for peer in (STEPS, PICTURES))
        columns = [[r.rates[name] for r in seen], *ratios]
        print(f"| {name} | {' | '.join(map(spread, columns))} |")
    print(
        f"\nPliant: {statistics.median(1 / r.wall for r in seen):.2f} trials/s in one process; a"
        f" trial simulates {spread([r.simulated for r in seen])} s. Robosuite simulates as long;"
        " its resets are not counted, pliant's are. Robosuite draws a picture at every control"
        " step (20 a simulated second), pliant at every check: where it looks, not all the time."
        f"\n\nPliant: MuJoCo {version('mujoco')}, steps of {1e3 * timestep:g} ms; robosuite"
        f" {about['robosuite']}: MuJoCo {about['mujoco']}, steps of {1e3 * about['step_s']:g} ms;"
        f" both: OpenGL by {os.environ.get('MUJOCO_GL', 'the system')}"
    )


def main(repetitions: int) -> None:
    environment()
    load, cell, seen = os.getloadavg()[0], SimCell(), []
    whole(cell, 0)  # the first one compiles and warms up
    with robosuite() as peer:
        began = time.monotonic()
        for seed in range(1, repetitions + 1):
            if time.monotonic() - began > MOST_S:
                print(f"Stopped after {seed - 1} repetitions: they took {MOST_S:g} s.\n")
                break
            seen.append(repeated(cell, peer, seed))
    timestep = cell.prepare(load_task("circle"), condition("all").draw(0)).model.opt.timestep
    report(seen, peer.about, timestep)
    cores = len(os.sched_getaffinity(0))
    print(f"{cores} cores, load {load:.1f} before, {os.getloadavg()[0]:.1f} after")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=7)
    main(parser.parse_args().repetitions)
