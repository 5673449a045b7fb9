"""Add to a case set the cases that ask whether to stop or to go on: SET is written anew.

    python reproduce/make_stop_cases.py [SET] [--kept FOLDER] [--workers N]

Trials come in pairs: on the same level, with the same peg, skills, reasoner and way of wavering,
one in which the peg can be put in, and one in which something is not as the task says. Going on is
right where the trial did end with the peg in; stopping where the scenario says so and it did not.
Of the failed executions of both sorts cases are chosen that match in skills, level, formation and
length of history, so that nothing but the evidence tells them apart. Executions that succeeded are
added of both sorts. All other cases that SET holds stay as they are, and the order is a hash's.

Each trial's cases are kept in FOLDER (default .cache/stop_cases) as soon as it has ended; a run
that was cut off goes on from there. The same machine makes the same set.
"""

import argparse
import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from make_cases import FAR, RASH, Watched

from pliant import pictures
from pliant.cell import Trace, View
from pliant.conditions import Condition, condition
from pliant.experiment.bench.answers import Answer
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
from pliant.files import write_bytes
from pliant.formations import OWNED, RECOVERABLE, Formation
from pliant.levels import STOP, load_level, shipped_levels
from pliant.pose import Axis
from pliant.reasoners import reasoner
from pliant.reasoners.rules import Rules
from pliant.records import Case, End, Outcome, Recovery, Verdict
from pliant.recovery import Reasoner
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

SEED = 1
FIRST_SEED = 51001
MOST_EXECUTIONS = 12  # of a guided trial
MOST_PLANAR = 20
WAVERS_UNTIL = 5  # executions of a guided trial
GUIDED_WAYS = ((0.35, 0.010, 0.0), (0.7, 0.020, 0.008))
"""Of wavering: the share of good verdicts that are turned, and the most by which a goal of Fit or
Align is shifted along y and x [m]."""
OF_A_TRIAL = 2  # failures that are taken of one trial, at most; and a success
QUALITY = 80  # of the pictures that the guided skills took, as a camera sends them

GUIDED_LEVELS = tuple(n for n, v in shipped_levels().items() if not v.may_be_wrong and n != "L0")
STOPS = tuple(n for n, v in shipped_levels().items() if v.is_scenario and v.right == STOP)
FAILS_SELDOM = ("L3", "L5", "L5+", "L6", "L6+", "L8")  # where a reasoner must waver more
NEAR_MISSES = ("bar_beside", "lying_camera", "blind")
PLANAR = (("rules", RASH), ("messages", FAR), ("sweep", FAR), ("retry", RASH))
PEGS = ("circle", "square", "rectangle_narrow")


@dataclass(frozen=True, kw_only=True)
class Job:
    """A trial that is watched: on a level, and strange in the way of a scenario or in none."""

    level: str
    peg: str
    seed: int
    scenario: str | None = None
    reasoner: str = "rules"
    way: int = 0  # of wavering: of GUIDED_WAYS, or of PLANAR

    @property
    def name(self) -> str:
        words = (self.level, self.peg, self.scenario or "as_it_is", self.reasoner, str(self.seed))
        return "-".join(words).replace("+", "_")

    @property
    def condition(self) -> Condition:
        """What the level draws and, besides, the scenario."""
        drawn = load_level(self.level).on(condition("all"))
        if self.scenario is None:
            return drawn
        ranges = {**drawn.ranges, **load_level(self.scenario).ranges}
        return Condition(name=self.scenario, ranges=ranges)


def jobs() -> Iterator[Job]:
    """On every level of the guided skills each place of its pegs twice or more: as it is, strange,
    and, in turn, with a near miss. Then the paper's skills in the scenarios."""
    number = 0
    for level in GUIDED_LEVELS:
        pegs = load_level(level).pegs
        for turn in range(3):
            peg = pegs[(turn + number) % len(pegs)] if len(pegs) > 3 else pegs[turn]
            seed = FIRST_SEED + 10 * number
            yield Job(level=level, peg=peg, seed=seed)
            yield Job(level=level, peg=peg, seed=seed + 1, scenario=_strange(number, peg))
            if turn == number // 3 % 3:
                near = NEAR_MISSES[number // 3 % len(NEAR_MISSES)]
                yield Job(level=level, peg=peg, seed=seed + 2, scenario=near)
            number += 1
    for level in FAILS_SELDOM:
        number = GUIDED_LEVELS.index(level)
        pegs = load_level(level).pegs
        for turn in range(2):
            peg, seed = pegs[(number + turn) % len(pegs)], FIRST_SEED + 500 + 10 * number + turn
            yield Job(level=level, peg=peg, seed=seed, way=1)
        yield Job(level=level, peg=peg, seed=seed + 5, scenario=_strange(number, peg), way=1)
    for number, level in enumerate(GUIDED_LEVELS):  # failures that can be mended are rare
        pegs = load_level(level).pegs
        for turn in range(3):
            peg, seed = pegs[(number + turn) % len(pegs)], FIRST_SEED + 2000 + 10 * number + turn
            yield Job(level=level, peg=peg, seed=seed, way=1)
        yield Job(level=level, peg=peg, seed=seed + 5, scenario=_strange(number + 2, peg), way=1)
    for scenario in STOPS:
        for peg in load_level(scenario).pegs:
            for way, (name, _) in enumerate(PLANAR):
                seed = FIRST_SEED + 1000 + 10 * STOPS.index(scenario) + way
                yield Job(level="L0", peg=peg, seed=seed, scenario=scenario, reasoner=name, way=way)


def _strange(number: int, peg: str) -> str:
    """The scenario whose turn it is, of those that are strange with this peg: a round one that is
    turned in the grasp is as it was."""
    others = [s for s in STOPS if peg in load_level(s).pegs or peg not in PEGS]
    return others[number % len(others)]


# --- one trial ---------------------------------------------------------------------------------


@dataclass(kw_only=True)
class Wavering:
    """The rules with the guided skills, which waver at first: a good verdict is turned now and
    then, and a goal of Fit or Align shifted. They go by no sign that something is wrong, so that a
    trial goes on where it is. It keeps the last case."""

    draw: np.random.Generator
    way: tuple[float, float, float]
    case: Case | None = None
    name: str = "rules"

    def judge(self, case: Case) -> Verdict:
        self.case = case
        verdict = Rules().judge(_unsuspecting(case))
        turned = self.draw.random() < self.way[0] and self._wavers(case)
        if verdict.success and turned and case.outcome.step.formation in RECOVERABLE:
            return replace(verdict, success=False)
        return verdict

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        recovery = Rules().recover(_unsuspecting(case), verdict)
        by_y, by_x = (float(self.draw.uniform(-m, m)) if m else 0.0 for m in self.way[1:])
        if recovery is None or not recovery.steps or not self._wavers(case):
            return recovery
        first, *rest = recovery.steps
        if OWNED[first.formation][0] is not Axis.Y:
            return recovery
        goal = {**first.goal, Axis.Y: first.goal[Axis.Y] + by_y}
        moved = replace(first, goal={**goal, Axis.X: by_x} if by_x else goal)
        return replace(recovery, steps=(moved, *rest))

    @staticmethod
    def _wavers(case: Case) -> bool:
        return len(case.history) < WAVERS_UNTIL


def _unsuspecting(case: Case) -> Case:
    """The case without its signs, and the check that is made of them."""
    checks = tuple(c for c in case.evidence.checks if c.name != "plausible")
    return replace(case, diagnosis=None, evidence=replace(case.evidence, checks=checks))


def watch(job: Job) -> list[BenchCase]:
    """The cases of one trial, with their keys."""
    level, task = load_level(job.level), load_task(job.peg, job.level)
    spec = Spec(
        task=task,
        level=job.level,
        condition=job.condition,
        seed=job.seed,
        reasoner=job.reasoner,
        method=level.method,
    )
    setup, cell = job.condition.draw(job.seed), _cell()
    draw = np.random.default_rng([SEED, job.seed])
    is_guided, is_strange = job.level != "L0", job.scenario in STOPS
    mind: Wavering | Watched
    if is_guided:
        mind = Wavering(draw=draw, way=GUIDED_WAYS[job.way])
    else:
        mind = Watched(inner=reasoner(job.reasoner), waver=PLANAR[job.way][1], draw=draw)
    judge: Reasoner = mind
    run = composed(spec, cell.prepare(task, setup), setup, shipped().for_task(task), judge)
    kind = Kind.STRANGE if is_strange else Kind.SOUND
    found: list[BenchCase] = []
    with closing(iter(run)) as executions:
        for execution in executions:
            case, truth = mind.case, cell.truth()
            assert case is not None, "an execution is judged before it is shown"
            success = succeeded(case.task, case.outcome, truth)
            if success or execution.formation in RECOVERABLE:
                key = Key(
                    kind=kind,
                    formation=execution.formation,
                    answer=_answer(success, is_strange),
                    truth=truth,
                    origin=Origin(
                        peg=job.peg,
                        level=job.level,
                        condition=job.condition.name,
                        seed=job.seed,
                        reasoner=job.reasoner,
                        index=execution.index,
                    ),
                )
                kept = _compact(case) if is_guided else thinned(case)
                found.append(BenchCase(name="", case=kept, key=key))
            if len(run.history) >= (MOST_EXECUTIONS if is_guided else MOST_PLANAR):
                break
    went_in = [q.key.truth.inserted is True for q in found]
    ended_in = run.end_reason == End.INSERTED and went_in[-1:] == [True]
    known = not any(went_in) if is_strange else ended_in
    return found if known else []  # else nobody can say what was right


def _answer(success: bool, is_strange: bool) -> Answer:
    return Answer(
        success=success, stop=is_strange and not success, go_on=not (is_strange or success)
    )


def _compact(case: Case) -> Case:
    """A guided skill is a row of motions and looks: of each execution the last look is kept, and no
    trace; of an earlier one the motions that tell how it was stopped, and how hard it pressed."""
    history = tuple(
        replace(e, outcome=_essence(_last_look(e.outcome, keep_pictures=False)))
        for e in case.history
    )
    return replace(case, history=history, outcome=_last_look(case.outcome, keep_pictures=True))


def _last_look(outcome: Outcome, *, keep_pictures: bool) -> Outcome:
    none = Trace(time_s=np.zeros(0), pose=np.zeros((0, 6)), compression_m=np.zeros(0))
    motions = tuple(replace(motion, trace=none) for motion in outcome.motions)
    look = outcome.looks[-1]
    views = look.observation.views if keep_pictures else {}
    sent = {name: _sent(view) for name, view in views.items()}
    look = replace(look, observation=replace(look.observation, views=sent))
    return replace(outcome, looks=(look,), motions=motions)


def _essence(outcome: Outcome) -> Outcome:
    if not outcome.motions:
        return outcome
    early = [m for m in outcome.motions if m.stop.is_early][-1:]
    hardest = max(outcome.motions, key=lambda m: m.peak_compression_m)
    kept = [m for m in outcome.motions if m is hardest or m in early or m is outcome.motions[-1]]
    return replace(outcome, motions=tuple(kept))


def _sent(view: View) -> View:
    """The picture as a camera that compresses sends it; what was measured was measured before."""
    encoded = pictures.encoded(view.image, "webp", [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    image = pictures.decoded(encoded)
    _ENCODED[pictures.name_of(image)] = encoded
    return replace(view, image=image)


_ENCODED: dict[str, bytes] = {}  # pictures as they were sent, by their names


@cache
def _cell() -> SimCell:
    return SimCell()


def perform(job: Job, folder: Path) -> str:
    """Watch a trial, unless its cases are there; returns what came of it."""
    path, none = folder / f"{job.name}.zip", folder / f"{job.name}.none"
    if path.exists() or none.exists():
        return "there"
    found = watch(job)
    if not found:
        write_bytes(none, b"")
        return "none"
    write(path, found, encoded=_ENCODED)
    _ENCODED.clear()
    return str(Counter(_sort(q.key) for q in found))


# --- the choice --------------------------------------------------------------------------------


def _sort(key: Key) -> str:
    return "success" if key.answer.success else "stop" if key.answer.stop else "go on"


def choose(pool: Sequence[BenchCase], old: Sequence[BenchCase]) -> list[BenchCase]:
    """Failures in pairs, one where it is right to stop and one where it is right to go on, alike in
    level, formation and history as far as the pool has such; and a success a trial. With the
    paper's skills going on is right in `old` ones."""
    draw = np.random.default_rng(SEED)
    order = [pool[n] for n in draw.permutation(len(pool))]
    order = [q for q in order if q.key.answer.success or _could_tell(q.case)]
    chosen = _paired(
        [q for q in order if q.case.method.follows_belief and _sort(q.key) == "stop"],
        [q for q in order if _sort(q.key) == "go on"],
    )
    planar = _paired(
        [q for q in order if not q.case.method.follows_belief and _sort(q.key) == "stop"],
        [q for q in old if q.key.answer.steps],
    )
    chosen += planar[: 2 * PLANAR_STOPS : 2]
    trials: set[tuple[str, int]] = set()
    wanted: Counter[Formation] = Counter()
    for q in sorted(
        (q for q in order if q.case.method.follows_belief and _sort(q.key) == "success"),
        key=lambda q: (q.key.formation not in RECOVERABLE, q.key.origin.level),
    ):
        trial = (q.key.origin.level, q.key.origin.seed)
        if trial not in trials and wanted[q.key.formation] < 12:
            trials.add(trial)
            wanted[q.key.formation] += 1
            chosen.append(q)
    return chosen


def _could_tell(case: Case) -> bool:
    """Nobody knows that a failure cannot be mended before something else went wrong."""
    return any(not e.verdict.success or e.outcome.scene.peg is None for e in case.history)


def _paired(stops: list[BenchCase], goes_on: list[BenchCase]) -> list[BenchCase]:
    """Pairs from the most alike on: each case once, and few of the same trial."""
    ranked = sorted(
        ((_unlike(a, b), i, j) for i, a in enumerate(stops) for j, b in enumerate(goes_on)),
    )
    used: set[tuple[int, int]] = set()
    of_trial: Counter[Origin] = Counter()
    chosen: list[BenchCase] = []
    for unlike, i, j in ranked:
        pair = (stops[i], goes_on[j])
        places = [replace(q.key.origin, index=0) for q in pair]
        if unlike > MOST_UNLIKE or (0, i) in used or (1, j) in used:
            continue
        if any(of_trial[place] >= OF_A_TRIAL for place in places):
            continue
        used |= {(0, i), (1, j)}
        of_trial.update(places)
        chosen += pair
    return chosen


MOST_UNLIKE = 4.0
PLANAR_STOPS = 72


def _unlike(a: BenchCase, b: BenchCase) -> float:
    same_level = a.key.origin.level == b.key.origin.level
    same_hole = a.case.task.hole == b.case.task.hole and a.case.task.depth == b.case.task.depth
    apart = abs(len(a.case.history) - len(b.case.history))
    failed = abs(_failures(a.case) - _failures(b.case))
    return (
        3.0 * (a.key.formation is not b.key.formation)
        + (0.0 if same_level else 1.0 if same_hole else 2.0)
        + 0.5 * apart
        + 1.0 * failed
        + 0.25 * (a.key.origin.peg != b.key.origin.peg)
    )


def _failures(case: Case) -> int:
    return sum(not e.verdict.success for e in case.history)


def _place(question: BenchCase) -> str:
    """Where in the set a case stands: a hash tells nothing."""
    text = f"{SEED} {question.key.kind} {question.key.origin}"
    return hashlib.sha256(text.encode()).hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("set", nargs="?", type=Path, default=SHIPPED)
    parser.add_argument("--kept", type=Path, default=Path(".cache/stop_cases"))
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core a worker
    planned = list(jobs())
    with ProcessPoolExecutor(given.workers) as workers:
        waiting = {workers.submit(perform, job, given.kept): job for job in planned}
        for done in as_completed(waiting):
            print(waiting[done].name, done.result(), flush=True)
    pool = []
    for job in planned:
        path = given.kept / f"{job.name}.zip"
        if path.exists():
            cases = Cases(path)
            pool += list(cases)
            _ENCODED.update(cases.pictures())
    old = [q for q in Cases(given.set) if q.key.kind not in (Kind.STRANGE, Kind.SOUND)]
    chosen = choose(pool, old)
    write(given.set, sorted([*old, *chosen], key=_place), encoded=_ENCODED)
    made = Cases(given.set)
    size = given.set.stat().st_size
    print(f"{len(made)} cases, hash {made.hash} (ships: {SHIPPED_HASH}), {size} bytes")
    for sort, n in sorted(Counter((q.case.method.name, _sort(q.key)) for q in chosen).items()):
        print(f"  {' '.join(sort):<20} {n}")


if __name__ == "__main__":
    main()
