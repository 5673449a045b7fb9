"""Make the case set of `pliant bench-reasoner` from simulated trials.

    python reproduce/make_cases.py [OUT]        # default: the set that ships

Trials of several reasoners, some of which waver on purpose so that odd states occur, are watched:
each execution gives a case as the reasoner saw it and the truth beside it. Then cases are drawn to
fill a quota per kind, formation and outcome, evenly over pegs and kinds of failure. For each
failure the goals of the right next step are tried in the simulator, from the state as it was.

The same machine makes the same set; another renderer makes other pictures, hence another hash.
"""

import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pliant.belief import Belief, Seen
from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.envelope import Limits
from pliant.experiment.bench.answers import Answer, answer
from pliant.experiment.bench.cases import (
    SHIPPED,
    SHIPPED_HASH,
    BenchCase,
    Cases,
    Key,
    Kind,
    Origin,
    thinned,
    write,
)
from pliant.experiment.one import Spec, composed
from pliant.experiment.success import succeeded
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.levels import INSERTED_DEPTH_M
from pliant.methods.planar import Planar
from pliant.pose import Axis
from pliant.reasoners import reasoner
from pliant.records import Case, Check, Evidence, FailureAnalysis, Look, Recovery, Verdict
from pliant.recovery import Reasoner, admit
from pliant.sim.cell import SimCell, SimRobot
from pliant.teaching import shipped
from pliant.vision.scene import Scene

SEED = 1
PEGS = ("circle", "square", "rectangle_narrow")
MOST_EXECUTIONS = 14  # watched of one trial
MOST_CASES = 4  # taken from one trial, each of another kind or outcome
NEARLY_M = 0.0025  # from the criterion of depth
OLDER_M = 0.003  # a stale picture shows the tip at least this far from where it is
TRIED_M = np.arange(-0.044, 0.0441, 0.004)  # changes of a goal in y
TRIED_Z_M = np.arange(-0.020, 0.0001, 0.002)  # changes of a goal of Insertion
NOT_TOUCHING_M = 0.010  # Contact's goal this much too high

QUOTAS: dict[tuple[Kind, Formation, bool], int] = {
    (Kind.PLAIN, Formation.APPROACH, True): 9,
    (Kind.PLAIN, Formation.CONTACT, True): 9,
    (Kind.PLAIN, Formation.CONTACT, False): 9,
    (Kind.PLAIN, Formation.FIT, True): 27,
    (Kind.PLAIN, Formation.FIT, False): 33,
    (Kind.PLAIN, Formation.ALIGN, True): 27,
    (Kind.PLAIN, Formation.ALIGN, False): 36,
    (Kind.PLAIN, Formation.INSERTION, True): 21,
    (Kind.PLAIN, Formation.INSERTION, False): 17,
    (Kind.CONFLICT, Formation.FIT, False): 15,
    (Kind.CONFLICT, Formation.INSERTION, True): 18,
    (Kind.NEARLY, Formation.INSERTION, True): 18,
    (Kind.NEARLY, Formation.INSERTION, False): 15,
    (Kind.STALE, Formation.FIT, True): 9,
    (Kind.STALE, Formation.FIT, False): 9,
    (Kind.STALE, Formation.ALIGN, True): 9,
    (Kind.STALE, Formation.ALIGN, False): 9,
    (Kind.STALE, Formation.INSERTION, True): 9,
    (Kind.STALE, Formation.INSERTION, False): 9,
    (Kind.MESSAGE, Formation.FIT, True): 12,
    (Kind.MESSAGE, Formation.FIT, False): 12,
    (Kind.MESSAGE, Formation.ALIGN, True): 12,
    (Kind.MESSAGE, Formation.ALIGN, False): 12,
}

FIT_MESSAGES = ("success", "p_gy was too small.", "p_gy was too big.")
ALIGN_MESSAGES = (
    "Align success",
    "peg is tilted to the left.",
    "peg is tilted to the right.",
    "p_ey was too small.",
    "p_ey was too big.",
    "peg is tilted to the left. p_gy was too small.",
    "p_gy was too big. also tilted to the right.",
)


# --- trials ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Waver:
    """How a reasoner is made to waver: of which formations verdicts are turned, and how often, by
    what they were; by how much a goal of Fit or Align is changed; how far above the taught goal
    Insertion stops, low and high [m]."""

    turns: tuple[Formation, ...] = RECOVERABLE
    turn_success: float = 0.0
    turn_failure: float = 0.0
    by_y: tuple[float, float] = (0.0, 0.0)
    above: tuple[float, float] = (0.0, 0.0)
    rises: float = 0.0  # Contact's goal is this much too high from the start [m]


STEADY = Waver()
RASH = Waver(turn_success=0.25, turn_failure=0.4, by_y=(-0.012, 0.012), above=(0.0, 0.010))
FAR = Waver(turn_success=0.4, turn_failure=0.5, by_y=(-0.035, 0.015))
TIMID = Waver(turns=(Formation.INSERTION,), turn_success=0.7, above=(0.0105, 0.018))
HIGH = Waver(rises=NOT_TOUCHING_M)

TRIALS: Sequence[tuple[str, str, Waver, int]] = (
    ("rules", "all", STEADY, 6),
    ("messages", "all", STEADY, 5),
    ("sweep", "pose", STEADY, 4),
    ("retry", "friction", STEADY, 3),
    ("rules", "all", RASH, 8),
    ("messages", "pose", RASH, 8),
    ("rules", "pose", FAR, 8),
    ("sweep", "all", FAR, 4),
    ("rules", "all", TIMID, 12),
    ("none", "friction", HIGH, 3),
    ("none", "all", STEADY, 18),
)
"""Reasoner, condition, how it wavers, and seeds per peg."""


@dataclass(kw_only=True)
class Watched:
    """A reasoner that keeps the last case it was given, and may waver."""

    inner: Reasoner
    waver: Waver
    draw: np.random.Generator
    case: Case | None = None

    @property
    def name(self) -> str:
        return self.inner.name

    def judge(self, case: Case) -> Verdict:
        self.case = case
        verdict = self.inner.judge(case)
        turn = self.waver.turn_success if verdict.success else self.waver.turn_failure
        if case.outcome.step.formation in self.waver.turns and self.draw.random() < turn:
            return replace(verdict, success=not verdict.success)
        return verdict

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        recovery = self.inner.recover(case, verdict)
        if recovery is None:
            return None
        taught = case.teaching.goals.formations[Formation.INSERTION][Axis.Z]
        steps = tuple(self._changed(step, taught) for step in recovery.steps)
        return replace(recovery, steps=steps)

    def _changed(self, step: Step, taught_z: float) -> Step:
        if self.draw.random() < 0.4:
            return step
        if step.formation is Formation.INSERTION:
            low, high = self.waver.above
            return replace(step, goal={Axis.Z: taught_z + float(self.draw.uniform(low, high))})
        low, high = self.waver.by_y
        y = step.goal[Axis.Y] + float(self.draw.uniform(low, high))
        return replace(step, goal={Axis.Y: y})


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """The cell as it was, to go on from: what MuJoCo integrates, and what the robot holds."""

    time_s: float
    physics: tuple[NDArray[np.float64], ...] = field(repr=False)
    held: tuple[Any, ...] = field(repr=False)

    @classmethod
    def of(cls, robot: SimRobot) -> "State":
        return cls(
            time_s=float(robot.data.time),
            physics=tuple(getattr(robot.data, name).copy() for name in _PHYSICS),
            held=tuple(getattr(robot, name) for name in _HELD),
        )

    def restore(self, robot: SimRobot) -> None:
        robot.data.time = self.time_s
        for name, value in zip(_PHYSICS, self.physics, strict=True):
            getattr(robot.data, name)[:] = value
        for name, value in zip(_HELD, self.held, strict=True):
            setattr(robot, name, value)


_PHYSICS = ("qpos", "qvel", "act", "ctrl", "qacc_warmstart")
_HELD = ("_q", "_commanded", "_free_hang", "_tared")  # none is changed in place


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """One execution of a watched trial; `before` is the look after the one before it."""

    origin: Origin
    setup: Setup
    case: Case
    truth: Truth
    answer: Answer
    state: State
    before: Look | None


def watch(cells: Mapping[str, SimCell]) -> Iterator[Found]:
    """Every execution of every trial that has a right answer."""
    for number, (name, drawn, waver, seeds) in enumerate(TRIALS):
        for peg in PEGS:
            for seed in range(1000 * number + 1, 1000 * number + 1 + seeds):
                ran = _executions(cells[peg], peg, drawn, seed, name, waver)
                yield from islice(ran, 2 if waver.rises else MOST_EXECUTIONS)


def _executions(
    cell: SimCell, peg: str, drawn: str, seed: int, name: str, waver: Waver
) -> Iterator[Found]:
    spec, teaching = Spec.named(peg=peg, condition=drawn, seed=seed), shipped()
    setup = spec.condition.draw(seed)
    if waver.rises:
        teaching = replace(teaching, goals=_raised(teaching.goals, waver.rises))
    robot = cell.prepare(spec.task, setup)
    mind = Watched(inner=reasoner(name), waver=waver, draw=np.random.default_rng([SEED, seed]))
    run = composed(spec, robot, setup, teaching, mind)
    before: Look | None = None
    for execution in run:
        assert mind.case is not None, "an execution is judged before it is shown"
        case, truth = thinned(mind.case), cell.truth()
        right = answer(case, truth, setup)
        if right is not None:
            origin = Origin(
                peg=peg, condition=drawn, seed=seed, reasoner=name, index=execution.index
            )
            yield Found(
                origin=origin,
                setup=setup,
                case=case,
                truth=truth,
                answer=right,
                state=State.of(robot),
                before=before,
            )
        before = case.outcome.looks[-1]


def _raised(goals: Goals, by: float) -> Goals:
    z = goals.formations[Formation.CONTACT][Axis.Z] + by
    return goals.updated(Step(formation=Formation.CONTACT, goal={Axis.Z: z}))


# --- kinds -------------------------------------------------------------------------------------


def natural_kind(found: Found) -> Kind:
    """What the case is, as it was met."""
    formation, success = found.case.outcome.step.formation, found.answer.success
    if formation is Formation.INSERTION and abs(found.truth.depth_m - INSERTED_DEPTH_M) <= NEARLY_M:
        return Kind.NEARLY
    votes = found.case.evidence.votes
    seen = [votes.get(name) for name in ("table_i", "metric", "goal_picture")]
    if any(vote is not None and vote != success for vote in seen):
        return Kind.CONFLICT
    if success and formation in RECOVERABLE and False in (votes["pose"], votes["compression"]):
        return Kind.CONFLICT
    return Kind.PLAIN


def stale(found: Found) -> Case | None:
    """The case with the picture of the execution before, where that shows something else."""
    case, before = found.case, found.before
    now = case.outcome.looks[-1]
    if (
        before is None
        or case.outcome.step.formation not in RECOVERABLE
        or not _differ(before.scene, now.scene)
    ):
        return None
    seen = replace(now.observation, views=before.observation.views)
    old = Look(observation=seen, scene=before.scene)
    outcome = replace(case.outcome, looks=(*case.outcome.looks[:-1], old))
    outcomes = [*(e.outcome for e in case.history), outcome]
    belief = Belief()
    for o in outcomes:
        for look in o.looks:
            looked = Seen(step=o.step, pose=look.observation.pose, scene=look.scene)
            belief = Planar().believe(belief, looked, case.teaching)
    return replace(
        case,
        outcome=outcome,
        evidence=Planar().check(case.task, outcome, belief, case.teaching),
        belief=belief,
    )


def _differ(one: Scene, other: Scene) -> bool:
    if one.peg is None or other.peg is None:
        return False
    away = (
        one.peg.tip_y.value - other.peg.tip_y.value,
        one.peg.tip_z.value - other.peg.tip_z.value,
    )
    return bool(np.hypot(*away) >= OLDER_M)


def misworded(found: Found, draw: np.random.Generator) -> Case | None:
    """The case with another of Table I's messages, drawn, and its vote."""
    table = found.case.evidence["table_i"]
    if table is None or table.vote is None:
        return None
    is_fit = found.case.outcome.step.formation is Formation.FIT
    messages = [m for m in (FIT_MESSAGES if is_fit else ALIGN_MESSAGES) if m != table.message]
    message = str(draw.choice(messages))
    wrong = Check(name="table_i", vote=message.endswith("success"), message=message)
    checks = tuple(wrong if c.name == "table_i" else c for c in found.case.evidence.checks)
    return replace(found.case, evidence=Evidence(checks=checks))


def choose(pool: Sequence[Found]) -> list[tuple[Kind, Found, Case]]:
    """Cases to fill the quotas, in an order of which every beginning is as mixed as the whole."""
    draw = np.random.default_rng(SEED)
    taken: dict[tuple[str, int], set[tuple[Kind, bool]]] = defaultdict(set)
    used: set[Origin] = set()
    chosen: list[tuple[Kind, Found, Case]] = []
    for (kind, formation, success), quota in sorted(QUOTAS.items(), key=_scarce_first):
        fitting = [
            f
            for f in pool
            if f.case.outcome.step.formation is formation and f.answer.success is success
        ]
        groups: dict[tuple[object, ...], list[Found]] = defaultdict(list)
        for at in draw.permutation(len(fitting)):
            groups[_group(fitting[at])].append(fitting[at])
        filled = 0
        for found in _in_turn(groups):
            if filled == quota:
                break
            trial = (f"{found.origin.peg} {found.origin.reasoner}", found.origin.seed)
            if (
                found.origin in used
                or (kind, success) in taken[trial]
                or len(taken[trial]) == MOST_CASES
            ):
                continue
            case = _as_kind(kind, found, draw)
            if case is None:
                continue
            used.add(found.origin)
            taken[trial].add((kind, success))
            chosen.append((kind, found, case))
            filled += 1
        if filled < quota:
            print(f"only {filled} of {quota}: {kind} {formation} {success}", flush=True)
    return [chosen[at] for at in draw.permutation(len(chosen))]


def _scarce_first(quota: tuple[tuple[Kind, Formation, bool], int]) -> tuple[bool, bool]:
    kind = quota[0][0]
    return kind is Kind.PLAIN, kind in (Kind.STALE, Kind.MESSAGE)


def _as_kind(kind: Kind, found: Found, draw: np.random.Generator) -> Case | None:
    if kind is Kind.STALE:
        return stale(found)
    if kind is Kind.MESSAGE:
        return misworded(found, draw) if natural_kind(found) is Kind.PLAIN else None
    return found.case if natural_kind(found) is kind else None


def _group(found: Found) -> tuple[object, ...]:
    """Peg and, after a failure, what is right to do, which tells the kinds of failure apart."""
    first = found.answer.steps[:1]
    how = tuple((s.formation, s.retreat) for s in first)
    return found.origin.peg, how, found.case.outcome.stop


def _in_turn(groups: dict[tuple[object, ...], list[Found]]) -> Iterator[Found]:
    queues = [list(groups[key]) for key in sorted(groups, key=str)]
    while any(queues):
        for queue in queues:
            if queue:
                yield queue.pop(0)


# --- the right goals ---------------------------------------------------------------------------


def tried(cell: SimCell, found: Found) -> Answer | None:
    """The answer with its first step's goal among those that reach its formation from here. Where
    none that was tried does, the answer is to refit; None where that does not reach either."""
    if not found.answer.steps:
        return found.answer
    for steps in (found.answer.steps, _refit(found)):
        goals = _reaching(cell, found, steps)
        if goals is not None:
            first, *rest = steps
            axis = OWNED[first.formation][0]
            goal = min(max(first.goal[axis], goals[0]), goals[1])
            right = replace(first, goal={axis: goal})
            return Answer(success=False, steps=(right, *rest), goals_m=goals)
    return None


def _refit(found: Found) -> tuple[Step, ...]:
    """Retreat, and fit as was taught, from where the hole is."""
    taught = found.case.teaching.goals
    y = taught.formations[Formation.FIT][Axis.Y] + found.truth.hole_y
    fit = Step(formation=Formation.FIT, goal={Axis.Y: y}, retreat=True)
    align = Step(formation=Formation.ALIGN, goal={Axis.Y: found.truth.hole_y})
    return fit, align, taught.step(Formation.INSERTION)


def _reaching(cell: SimCell, found: Found, steps: tuple[Step, ...]) -> tuple[float, float] | None:
    """Least and greatest of the unbroken run of goals of the first step, nearest to its own, that
    may be done and reach its formation from here [m]."""
    first, *rest = steps
    axis = OWNED[first.formation][0]
    own, in_force = first.goal[axis], found.case.goals.formations[first.formation][axis]
    changes = TRIED_Z_M if axis is Axis.Z else TRIED_M
    goals = sorted({own, *(in_force + float(change) for change in changes)})
    robot = cell.prepare(found.case.task, found.setup)
    case = found.case
    skill = Planar().skill(case.task, case.teaching, Limits())

    def look(cameras: Sequence[str] = ()) -> Look:
        return case.outcome.looks[-1]

    def reaches(goal: float) -> bool:
        step = replace(first, goal={axis: goal})
        plan = Recovery(analysis=_UNSAID, steps=(step, *rest), by="")
        if admit(plan, found.case, Limits()).refusals:
            return False
        found.state.restore(robot)
        changed = found.case.goals.updated(step)
        target = changed.target(step.formation)
        outcome = skill(robot, look, target, step, Belief())
        return succeeded(found.case.task, outcome, cell.truth())

    runs = [list(run) for does, run in groupby(goals, key=reaches) if does]
    if not runs:
        return None
    nearest = min(runs, key=lambda run: max(run[0] - own, own - run[-1], 0.0))
    return nearest[0], nearest[-1]


_UNSAID = FailureAnalysis(what="", why="", how="", motion={})


# --- the set -----------------------------------------------------------------------------------


def questions() -> Iterator[BenchCase]:
    cells = {peg: SimCell() for peg in PEGS}
    pool = list(watch(cells))
    print(f"{len(pool)} executions watched", flush=True)
    number = 0
    for kind, found, case in choose(pool):
        right = tried(cells[found.origin.peg], found)
        if right is None:
            continue
        number += 1
        key = Key(
            kind=kind,
            formation=case.outcome.step.formation,
            answer=right,
            truth=found.truth,
            origin=found.origin,
        )
        yield BenchCase(name=f"{number:04d}", case=case, key=key)


def main(path: Path) -> None:
    write(path, questions())
    made = Cases(path)
    print(
        f"{len(made)} cases, hash {made.hash} (ships: {SHIPPED_HASH}), {path.stat().st_size} bytes"
    )
    counts = Counter((k.kind, k.formation, k.answer.success) for k in made.keys)
    for (kind, formation, success), n in sorted(counts.items()):
        print(f"  {kind:<9} {formation:<10} {'success' if success else 'failure'} {n}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED)
