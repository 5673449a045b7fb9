"""Records the states in which real trials look: joint positions, setup, what the arm measures.

The trials are run without drawing: what the method sees is the truth with a little noise, so that a
trial takes a second. The states are drawn later, with other looks each time (`data.py`).
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pliant.cell import Observation, View
from pliant.conditions import NOMINAL, Setup, condition
from pliant.errors import InputError
from pliant.levels import load_level
from pliant.methods.named import method
from pliant.pose import angles_from
from pliant.reasoners.rules import Rules
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import Peg, Task, load_task, on_level, shipped_pegs
from pliant.teaching import shipped
from pliant.trial import Run
from pliant.vision.measure import Colours
from pliant.vision.scene import Across, HoleSeen, Measured, PegSeen, Scene

_SD_M, _SD_RAD = 0.0003, math.radians(0.2)  # of what the method is told
_NOWHERE = ((0.0, 0.0),) * 4
_BETWEEN = 3  # states of a trial's motions for each look
LEVELS = ("L5", "L8", "L0", "L6")
QUANTITIES = tuple(NOMINAL)


def random_peg(random: np.random.Generator) -> Peg:
    """A peg that nobody shipped: a disc, a box or a convex polygon."""
    length = float(random.uniform(0.06, 0.2) if random.uniform() < 0.4 else 0.09)
    kind = random.integers(3)
    if kind == 0:
        return Peg(name="disc", radius=float(random.uniform(0.004, 0.025)), length=length)
    if kind == 1:
        x, y = random.uniform(0.004, 0.03), random.uniform(0.004, 0.025)
        corners = ((-x, -y), (x, -y), (x, y), (-x, y))
        return Peg(name="box", outline=corners, length=length)
    corners_n = int(random.integers(3, 9))
    angles = np.sort((np.arange(corners_n) + random.uniform(-0.25, 0.25, corners_n)) / corners_n)
    points = random.uniform(0.008, 0.024) * np.column_stack(
        [np.cos(math.tau * angles), np.sin(math.tau * angles)]
    )
    points[:, 1] -= (points[:, 1].max() + points[:, 1].min()) / 2
    return Peg(
        name="polygon", outline=tuple((float(a), float(b)) for a, b in points), length=length
    )


def task_of(random: np.random.Generator, level: str, own: bool, pegs: Sequence[str]) -> Task:
    """A task on a level: with a shipped peg, or with one of random shape."""
    while True:
        try:
            if not own:
                task = load_task(str(random.choice(pegs)), level)
            else:
                task = on_level(Task(peg=random_peg(random)), load_level(level))
            SimRobot(task)
            return task
        except (InputError, ValueError):  # a shape that cannot be built: draw another
            continue


class Undrawn:
    """Cameras whose pictures are empty: drawing takes most of a trial's time."""

    def __init__(self, robot: SimRobot) -> None:
        self._cameras = robot.cameras

    def dress(self, setup: Setup) -> None:
        self._cameras.dress(setup)

    def view(self, name: str, data: mujoco.MjData, time_s: float) -> View:
        empty = np.zeros((480, 640, 3), np.uint8)
        return View(camera=self._cameras._calibrations[name], time_s=time_s, image=empty)

    def close(self) -> None:
        self._cameras.close()


class Told:
    """A sight that is told the truth, with a little noise, and keeps the states in which it
    looked."""

    colours: Colours | None = None  # it needs none

    def __init__(self, cell: SimCell, robot: SimRobot, random: np.random.Generator) -> None:
        self._cell, self._robot, self._random = cell, robot, random
        self.states: list[dict[str, Any]] = []

    def __call__(self, observation: Observation) -> Scene:
        robot, task = self._robot, self._robot.task
        self.states.append(state_of(robot, looked=True))
        truth = self._cell.truth()
        rotation = robot.data.xmat[robot.peg_body].reshape(3, 3)
        roll, pitch, _ = angles_from(rotation)
        hole = robot.data.xpos[robot.board_body]
        board = angles_from(robot.data.xmat[robot.board_body].reshape(3, 3))
        tip, half = truth.tip, task.peg.half_extents[1]
        dy, dz = half * math.cos(roll), half * math.sin(roll)
        peg = PegSeen(
            box_px=_NOWHERE,
            center_px=(0.0, 0.0),
            edge_px=(0.0, 0.0),
            tilt_deg=math.degrees(roll),
            tilt=self._about(roll, _SD_RAD),
            tip_y=self._about(tip[1], _SD_M),
            tip_z=self._about(tip[2], _SD_M),
            left_y=tip[1] - dy,
            left_z=tip[2] - dz,
            right_y=tip[1] + dy,
            right_z=tip[2] + dz,
        )
        seen = HoleSeen(
            box_px=_NOWHERE,
            center_px=(0.0, 0.0),
            y=self._about(float(hole[1]), _SD_M),
            surface_z=self._about(float(hole[2]), _SD_M),
        )
        across = Across(
            tip_x=self._about(tip[0], _SD_M),
            pitch=self._about(pitch, _SD_RAD),
            hole_x=self._about(float(hole[0]), _SD_M),
        )
        yaw = self._about(board[2], _SD_RAD) if "oblique" in observation.views else None
        return Scene(
            peg=peg,
            hole=seen,
            time_s=observation.time_s,
            across=across if "front" in observation.views else None,
            board_yaw=yaw,
        )

    def _about(self, value: float, sd: float) -> Measured:
        return Measured(value=value + sd * float(self._random.standard_normal()), sd=sd)


def state_of(robot: SimRobot, *, looked: bool) -> dict[str, Any]:
    return {
        "qpos": robot.data.qpos.astype(np.float32),
        "time_s": robot.clock(),
        "compression_m": robot.compression(),
        "looked": looked,
    }


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A trial's states: the task, the setup, and row by row time, joint positions and
    compression."""

    task: Task
    setup: Setup
    time_s: np.ndarray
    qpos: np.ndarray
    compression_m: np.ndarray
    looked: np.ndarray


def record(task: Task, level: str, seed: int, random: np.random.Generator) -> Recorded:
    cell = SimCell()
    drawn = load_level(level).on(condition("all")).draw(seed)
    setup = replace(drawn, looks=0.0, occluder=0.0, stale=0.0)
    robot = cell.prepare(task, setup)
    robot.cameras = Undrawn(robot)  # type: ignore[assignment]
    told = Told(cell, robot, random)
    states = told.states
    every = int(random.integers(40, 80))
    count = [0]

    def between() -> None:
        count[0] += 1
        if count[0] % every == 0:
            states.append(state_of(robot, looked=False))

    robot.watch(between)
    run = Run(
        robot=robot,
        task=task,
        teaching=shipped().for_task(task),
        reasoner=Rules(),
        method=method(load_level(level).method),
        sight=told,
    )
    for _ in run:
        pass
    moved = [s for s in states if not s["looked"]]
    looked = [s for s in states if s["looked"]]
    keep = random.permutation(len(moved))[: max(4, len(looked) // _BETWEEN)]
    chosen = sorted(looked[:60] + [moved[k] for k in keep], key=lambda s: s["time_s"])
    return Recorded(
        task=task,
        setup=setup,
        **{
            name: np.array([s[name] for s in chosen])
            for name in ("time_s", "qpos", "compression_m", "looked")
        },
    )


def save(path: Path, trials: list[Recorded]) -> None:
    arrays: dict[str, Any] = {}
    for n, trial in enumerate(trials):
        peg = trial.task.peg
        arrays[f"{n}/outline"] = np.array(peg.outline, np.float64).reshape(-1, 2)
        arrays[f"{n}/peg"] = np.array(
            [peg.radius or 0.0, peg.length, trial.task.hole.clearance, trial.task.depth]
        )
        drawn = asdict(trial.setup)
        arrays[f"{n}/setup"] = np.array([drawn["seed"], *(drawn[q] for q in QUANTITIES)])
        for name in ("time_s", "qpos", "compression_m", "looked"):
            arrays[f"{n}/{name}"] = getattr(trial, name)
    with path.with_suffix(".part").open("wb") as file:
        np.savez_compressed(file, **arrays)
    path.with_suffix(".part").replace(path)


def load(path: Path) -> list[Recorded]:
    trials = []
    with np.load(path) as arrays:
        names = sorted({int(name.split("/")[0]) for name in arrays.files})
        for n in names:
            radius, length, clearance, depth = arrays[f"{n}/peg"].tolist()
            outline = tuple((float(a), float(b)) for a, b in arrays[f"{n}/outline"])
            peg = Peg(name="recorded", radius=radius or None, outline=outline, length=length)
            task = Task(peg=peg, depth=depth)
            task = replace(task, hole=replace(task.hole, clearance=clearance))
            seed, *values = arrays[f"{n}/setup"].tolist()
            setup = Setup(seed=int(seed), **dict(zip(QUANTITIES, values, strict=True)))
            rows = {
                name: arrays[f"{n}/{name}"]
                for name in ("time_s", "qpos", "compression_m", "looked")
            }
            trials.append(Recorded(task=task, setup=setup, **rows))
    return trials


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--first-seed", type=int, default=300_000)
    parser.add_argument("--trials", type=int, default=240)
    parser.add_argument("--levels", nargs="+", default=list(LEVELS))
    parser.add_argument("--pegs", nargs="+", help="these, and none of random shape")
    given = parser.parse_args()
    trials: list[Recorded] = []
    for n in range(given.trials):
        seed = given.first_seed + n
        random = np.random.default_rng([seed, 1])
        level = given.levels[n % len(given.levels)]
        task = task_of(
            random, level, own=not given.pegs and n // 4 % 2 == 1, pegs=given.pegs or shipped_pegs()
        )
        trials.append(record(task, level, seed, random))
        print(n, level, task.peg.name, len(trials[-1].time_s), flush=True)
        if n % 10 == 9 or n == given.trials - 1:
            save(given.out, trials)


if __name__ == "__main__":
    main()
