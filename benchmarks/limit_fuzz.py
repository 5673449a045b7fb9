"""Hostile plans, wrong beliefs and lying sensors: how far is the wrist really pressed?

    python benchmarks/limit_fuzz.py --trials 100                  # each method, simulated
    python benchmarks/limit_fuzz.py --trials 20 --emulated        # each sensor, the UR5e's driver

A trial has a reasoner that judges and plans at random, within admission and far beyond it; a sensor
that is honest or not; where it is honest, a board that may be read elsewhere, and in half of the
trials something in the way. It prints the most that the wrist was truly
loaded, by kind of sensor.
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pliant.cell import Motion, Observation, Robot, Workcell
from pliant.conditions import Setup
from pliant.emulator.client import Admin, started
from pliant.envelope import Guarded, Limits
from pliant.formations import RECOVERABLE, Formation, Step
from pliant.methods.named import METHODS, method
from pliant.pose import Axis, Pose
from pliant.records import Case, FailureAnalysis, Recovery, Verdict
from pliant.recovery import admit
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Patience, Run
from pliant.vision.measure import Colours
from pliant.vision.scene import Scene
from pliant.vision.sight import ByColour, Sight

HOST = "127.0.0.191"
SENSORS = ("honest", "dead", "trembling", "frozen", "scaled", "noisy")
EMULATED = ("honest", "noisy", "scaled", "turned")  # told a wrong stiffness, a wrong sign
EXECUTIONS = 14  # of a trial, at most
DRAFTS = 6  # of a plan, before one is given that admission refuses


@dataclass
class Hostile:
    """A reasoner (protocol `pliant.recovery.Reasoner`) that says anything."""

    random: np.random.Generator
    limits: Limits = field(default_factory=Limits)
    name: str = "hostile"
    plans: int = field(default=0)

    def judge(self, case: Case) -> Verdict:
        success = bool(self.random.uniform() < 0.3)
        if case.outcome.step.formation is Formation.INSERTION:
            success = False
        return Verdict(success=success, reason="any", votes={}, conflict=None, by=self.name)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        if self.random.uniform() < 0.1:
            return None
        for _ in range(DRAFTS):  # a trial ends with a plan that is refused
            plan = self._plan(case)
            if admit(plan, case, self.limits).steps:
                break
        return plan

    def _plan(self, case: Case) -> Recovery:
        self.plans += 1
        first = int(self.random.integers(len(RECOVERABLE)))
        steps = tuple(self._step(f, case) for f in RECOVERABLE[first:])
        analysis = FailureAnalysis(what="any", why="any", how="any", motion={})
        return Recovery(analysis=analysis, steps=steps, by=self.name)

    def _step(self, formation: Formation, case: Case) -> Step:
        near = case.goals.formations[formation]
        goal = {a: v + float(self.random.uniform(-0.04, 0.02)) for a, v in near.items()}
        if self.random.uniform() < 0.05:
            goal = {Axis.Z: float(self.random.uniform(-1.0, 1.0))}
        return Step(formation=formation, goal=goal, retreat=bool(self.random.uniform() < 0.4))


class Ended(NamedTuple):
    """One trial: the most that its wrist was truly loaded [m], how it ended, how many plans the
    reasoner tried."""

    load_m: float
    reason: str
    plans: int


@dataclass
class Lying:
    """A sight that reads the board's surface and the hole elsewhere [m]."""

    sight: Sight
    surface: float
    along: float

    @property
    def colours(self) -> Colours | None:
        return self.sight.colours

    def __call__(self, observation: Observation) -> Scene:
        scene = self.sight(observation)
        hole = scene.hole
        if hole is None:
            return scene
        y = replace(hole.y, value=hole.y.value + self.along)
        z = replace(hole.surface_z, value=hole.surface_z.value + self.surface)
        return replace(scene, hole=replace(hole, y=y, surface_z=z))


def drawn(seed: int, sensor: str, random: np.random.Generator) -> Setup:
    """What is actual: with an honest sensor something in the way in half of the trials."""
    setup = Setup(
        seed=seed,
        hole_y=float(random.uniform(-0.02, 0.02)),
        grasp_roll=float(random.uniform(-0.09, 0.09)),
        compression_dead=float(sensor in ("dead", "trembling")),
        compression_noise={"noisy": 0.001, "trembling": 0.0003}.get(sensor, 0.0),
    )
    if random.uniform() < 0.5 and sensor in ("honest", "noisy"):
        return replace(setup, bar_height=float(random.uniform(0.002, 0.02)))
    return setup


@contextmanager
def spoiled(robot: SimRobot, sensor: str, random: np.random.Generator) -> Iterator[None]:
    """The robot's sensor reads too little, or nothing new from a moment on."""
    felt = robot._sensor.felt  # no cell has a call for what no cell should do
    scale = float(random.uniform(0.2, 0.95)) if sensor == "scaled" else 1.0
    freezes_s = float(random.uniform(1.0, 20.0)) if sensor == "frozen" else np.inf
    zero = felt(float(robot.data.qpos[robot._slide]))
    last = zero

    def wrong(slide: float) -> float:
        nonlocal last
        if robot.clock() < freezes_s:
            last = zero + scale * (felt(slide) - zero)
        return last

    robot._sensor.felt = wrong  # type: ignore[method-assign]
    yield


def loaded(robot: SimRobot) -> list[float]:
    """The most that its wrist is loaded from now on [m], in a list of one."""
    most, hangs = [0.0], float(robot.data.qpos[robot._slide])

    def look() -> None:
        most[0] = max(most[0], abs(float(robot.data.qpos[robot._slide]) - hangs))

    robot.watch(look)
    return most


def run(robot: Robot, name: str, mind: Hostile, sight: Sight, executions: int = EXECUTIONS) -> Run:
    task, taught, limits = load_task("circle"), shipped(), Limits()
    done = Run(
        robot=robot,
        task=task,
        teaching=taught.for_task(task),
        reasoner=mind,
        method=method(name),
        limits=limits,
        patience=Patience(failures=executions, executions=executions),
        sight=sight,
    )
    for execution in done:
        for motion in execution.outcome.motions:
            assert limits.outside({a: motion.commanded[a] for a in Axis}) is None
    return done


def simulated(
    trials: int, first_seed: int = 1, executions: int = EXECUTIONS
) -> dict[tuple[str, str], list[Ended]]:
    """The trials by method and sensor."""
    cell, found = SimCell(), defaultdict(list)
    task = load_task("circle")
    for number, name in enumerate(METHODS):
        for seed in range(first_seed, first_seed + trials):
            random = np.random.default_rng([seed, number])
            sensor = SENSORS[seed % len(SENSORS)]
            robot = cell.prepare(task, drawn(seed, sensor, random))
            lies = random.uniform() < 0.3
            by = random.uniform(-0.02, 0.02, 2) if lies and sensor == "honest" else np.zeros(2)
            sight = Lying(ByColour(task), float(by[0]), float(by[1]))
            mind = Hostile(random)
            most = loaded(robot)
            with spoiled(robot, sensor, random):
                done = run(robot, name, mind, sight, executions)
            found[name, sensor].append(Ended(most[0], done.end_reason, mind.plans))
            print(name, seed, sensor, f"{1e3 * most[0]:.1f} mm", done.end_reason, flush=True)
    return dict(found)


class _Watched(Guarded):
    """An emulated robot whose true load [m] is noted after every motion, the fault's included."""

    def __init__(self, robot: Robot, admin: Admin) -> None:
        super().__init__(robot, Limits())
        self._admin, self.most = admin, 0.0

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        try:
            return super().move_to(
                pose, speed_m_s=speed_m_s, stop_at_compression_m=stop_at_compression_m
            )
        finally:
            self.most = max(self.most, abs(self._admin.truth().compression_m))


def emulated(
    trials: int, sensor: str, first_seed: int = 1, executions: int = EXECUTIONS
) -> list[Ended]:
    """The trials of one sensor; the method is the planar one, since the guided
    one wants a second camera."""
    from pliant.ur5e.cell import UrCell
    from pliant.ur5e.emulated import configuration_of

    task, found = load_task("circle"), []
    noise = ("--force-noise", "1.0" if sensor == "noisy" else "0.0")
    with started("--host", HOST, "--mode", "lockstep", *noise) as admin:
        for seed in range(first_seed, first_seed + trials):
            random = np.random.default_rng([seed, len(METHODS)])
            told = configuration_of(HOST)
            scale = float(random.uniform(0.2, 0.95)) if sensor == "scaled" else 1.0
            stiffness = told.wrist.stiffness_n_mm / scale
            sign = -told.wrist.sign if sensor == "turned" else told.wrist.sign
            wrist = told.wrist.model_copy(update={"stiffness_n_mm": stiffness, "sign": sign})
            setup = Setup(seed=seed, hole_y=float(random.uniform(-0.02, 0.02)))
            mind = Hostile(random)
            with UrCell(told.model_copy(update={"wrist": wrist})) as cell:
                real: Workcell = cell
                done = _Watched(real.prepare(task, setup), admin)
                ended = run(done, "planar", mind, ByColour(task), executions).end_reason
            found.append(Ended(done.most, ended, mind.plans))
            print(sensor, seed, ended, f"{1e3 * done.most:.1f} mm", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--emulated", action="store_true")
    options = parser.parse_args()
    found = {}
    if options.emulated:
        for sensor in EMULATED:
            found["planar", sensor] = emulated(options.trials, sensor, options.first_seed)
    else:
        found = simulated(options.trials, options.first_seed)
    for (name, sensor), trials in sorted(found.items()):
        worst = 1e3 * max(trial.load_m for trial in trials)
        plans = sum(trial.plans for trial in trials)
        ends = ", ".join(f"{n} {end}" for end, n in Counter(t.reason for t in trials).most_common())
        print(
            f"{name:<7} {sensor:<10} n {len(trials):3d}  {plans:4d} plans"
            f"  at most {worst:4.1f} mm  {ends}"
        )


if __name__ == "__main__":
    main()
