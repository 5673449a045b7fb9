"""Add the cases in which it is right to stop to a case set: SET is written anew, with them last.

    python reproduce/make_strange_cases.py [SET]        # default: the set that ships

The rules are watched in the scenarios whose right end is to stop. One failed execution of Fit,
Align or Insertion is taken of each trial, with a failure or a picture without a peg before it,
from which a reasoner could know. A guided skill is a row of motions and looks: of each execution
the last look is kept, and no trace. The cases that the set already holds stay as they are; older
ones of this kind are replaced.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pliant.cell import Trace
from pliant.experiment.bench.answers import Answer, succeeded
from pliant.experiment.bench.cases import (
    SHIPPED,
    SHIPPED_HASH,
    Cases,
    Key,
    Kind,
    Origin,
    Question,
    thinned,
    write,
)
from pliant.experiment.one import Spec, composed
from pliant.formations import RECOVERABLE
from pliant.levels import STOP, Level, shipped_levels
from pliant.reasoners.rules import Rules
from pliant.records import Case, Outcome, Verdict
from pliant.sim.cell import SimCell
from pliant.teaching import shipped
from pliant.trial import Patience

FIRST_SEED = 31001
SEEDS = 2  # for each peg of a scenario
LATEST = 4  # failures before the one that is taken, at most


@dataclass(frozen=True)
class _Watched(Rules):
    """The rules, and the cases that they judged."""

    judged: list[Case] = field(default_factory=list)

    def judge(self, case: Case) -> Verdict:
        self.judged.append(case)
        return super().judge(case)


def strange(level: Level, peg: str, seed: int) -> Question | None:
    """A case of one trial; None where it holds none."""
    mind, cell = _Watched(), SimCell()
    spec = Spec.named(peg=peg, level=level.name, seed=seed)
    setup = spec.condition.draw(seed)
    robot, taught = cell.prepare(spec.task, setup), shipped().for_task(spec.task)
    run = composed(spec, robot, setup, taught, mind, patience=Patience(executions=9))
    found: list[Question] = []
    is_told = False
    for execution in run:
        case, truth = mind.judged[-1], cell.truth()
        failed = execution.formation in RECOVERABLE and not succeeded(case, truth)
        if failed and is_told:
            origin = Origin(
                peg=peg,
                condition=level.name,
                seed=seed,
                reasoner=mind.name,
                index=execution.index,
            )
            key = Key(
                kind=Kind.STRANGE,
                formation=execution.formation,
                answer=Answer(success=False, stop=True),
                truth=truth,
                origin=origin,
            )
            found.append(Question(name="", case=_compact(thinned(case)), key=key))
        is_told |= not execution.verdict.success or case.outcome.scene.peg is None
    return found[seed % min(len(found), LATEST)] if found else None


def _compact(case: Case) -> Case:
    history = tuple(replace(e, outcome=_last_look(e.outcome)) for e in case.history)
    return replace(case, history=history, outcome=_last_look(case.outcome))


def _last_look(outcome: Outcome) -> Outcome:
    none = Trace(time_s=np.zeros(0), pose=np.zeros((0, 6)), compression_m=np.zeros(0))
    motions = tuple(replace(motion, trace=none) for motion in outcome.motions)
    return replace(outcome, looks=outcome.looks[-1:], motions=motions)


def stops() -> Iterator[Question]:
    for level in shipped_levels().values():
        if not (level.is_scenario and level.right == STOP):
            continue
        for peg in level.pegs:
            for seed in range(FIRST_SEED, FIRST_SEED + SEEDS):
                question = strange(level, peg, seed)
                print(level.name, peg, seed, question and question.key.formation, flush=True)
                if question is not None:
                    yield question


def main(path: Path) -> None:
    kept = [q for q in Cases(path) if q.key.kind is not Kind.STRANGE]
    write(path, [*kept, *stops()])
    made = Cases(path)
    size = path.stat().st_size
    print(f"{len(made)} cases, hash {made.hash} (ships: {SHIPPED_HASH}), {size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED)
