"""This checkout beside another one, piece by piece and turn by turn: pictures, looks, trials.

    python benchmarks/paired.py ../other           # a checkout of pliant with its own .venv

Both run in processes of their own and are asked in turn, so that whatever else the machine does
meets both. A time is processor time of one process on one core; a trial's is with its pictures.
Prints the medians of both and of the ratio in each turn, that with its quartiles, and every trial
whose outcome differs.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core, as in an experiment

import cv2

import pliant.sim  # noqa: F401, chooses the OpenGL back end
from pliant.conditions import CONDITIONS, condition
from pliant.experiment.one import Spec, perform
from pliant.levels import load_level
from pliant.sim.cell import SimCell
from pliant.task import load_task, shipped_pegs
from pliant.teaching import shipped
from pliant.vision.edges import measure_edges
from pliant.vision.learned import measure_learned
from pliant.vision.measure import measure

SEEDS = 690_000
LOOKS: dict[str, tuple[str, Callable[..., Any]]] = {
    "colour": ("L0", measure),
    "edges": ("L5", measure_edges),
    "learned": ("L5", measure_learned),
}


class Worker:
    """Does what it is asked, and says how long it took."""

    def __init__(self) -> None:
        cv2.setNumThreads(1)
        self._cell = SimCell()

    def answer(self, *, kind: str, level: str, **asked: Any) -> dict[str, Any]:
        if kind == "trial":
            spec = Spec.named(level=level, **asked)
            began = time.process_time()
            trial = perform(spec, self._cell, shipped())
            spent = time.process_time() - began
            outcome = [trial.end_reason, trial.truths[-1].inserted if trial.truths else False]
            return {"s": spent, "outcome": outcome}
        task, drawn = load_task("circle", level), load_level(level).on(condition("all"))
        robot = self._cell.prepare(task, drawn.draw(asked["seed"]))
        if kind == "picture":
            robot.cameras.image(asked["camera"], robot.data)
            began = time.process_time()
            robot.cameras.image(asked["camera"], robot.data)
            return {"s": time.process_time() - began}
        seen = robot.observe()
        view, way = seen.views["side"], LOOKS[asked["way"]][1]
        known = () if asked["way"] == "colour" else (seen.pose,)
        way(view, task, *known)
        began = time.process_time()
        way(view, task, *known)
        return {"s": time.process_time() - began}


def questions(trials: int, turns: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """What is asked: a name for its line, and how to ask."""
    for level in ("L0", "L8"):
        for camera in ("side", "front", "oblique"):
            for seed in range(turns):
                yield (
                    f"picture {level} {camera}",
                    {"kind": "picture", "level": level, "camera": camera, "seed": SEEDS + seed},
                )
    for way, (level, _) in LOOKS.items():
        for seed in range(turns):
            yield f"look {way}", {"kind": "look", "level": level, "way": way, "seed": SEEDS + seed}
    for peg in shipped_pegs():
        if peg in load_level("L0").pegs or peg.startswith("rectangle"):
            for name in CONDITIONS:
                for seed in range(3):
                    asked = {"peg": peg, "condition": name, "seed": SEEDS + seed}
                    yield "trial L0", {"kind": "trial", "level": "L0", **asked}
    for level in ("L5", "L8"):
        pegs = load_level(level).pegs
        for n in range(trials):
            asked = {"peg": pegs[n % len(pegs)], "condition": "all", "seed": SEEDS + n}
            yield f"trial {level}", {"kind": "trial", "level": level, **asked}


def serve() -> None:
    worker = Worker()
    for line in sys.stdin:
        print(json.dumps(worker.answer(**json.loads(line))), flush=True)


def ask(process: "subprocess.Popen[str]", question: dict[str, Any]) -> dict[str, Any]:
    assert process.stdin is not None
    assert process.stdout is not None
    print(json.dumps(question), file=process.stdin, flush=True)
    answered: dict[str, Any] = json.loads(process.stdout.readline())
    return answered


def main(other: Path, each: int, only: str, turns: int) -> None:
    times: dict[str, list[tuple[float, float]]] = {}
    with ExitStack() as stack:
        sides = [
            stack.enter_context(
                subprocess.Popen(
                    [python, __file__, "--serve"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    encoding="utf-8",
                )
            )
            for python in (other.resolve() / ".venv/bin/python", sys.executable)
        ]
        inserted = [0, 0]
        asked = [(n, q) for n, q in questions(each, turns) if n.startswith(only)]
        for n, (name, question) in enumerate(asked):
            order = (0, 1) if n % 2 else (1, 0)
            answers = {side: ask(sides[side], question) for side in order}
            times.setdefault(name, []).append((answers[0]["s"], answers[1]["s"]))
            if question["kind"] == "trial":
                inserted = [k + answers[side]["outcome"][1] for side, k in enumerate(inserted)]
                if answers[0].get("outcome") != answers[1].get("outcome"):
                    print("differs:", question, answers[0]["outcome"], answers[1]["outcome"])
        for process in sides:
            assert process.stdin is not None
            process.stdin.close()
    for name, pairs in times.items():
        before, after = (statistics.median(side) for side in zip(*pairs, strict=True))
        ratios = sorted(b / a for b, a in pairs)
        low, _, high = statistics.quantiles(ratios, n=4) if len(ratios) > 1 else ratios * 3
        print(
            f"{name} (n = {len(pairs)}): {1e3 * before:.1f} ms, here {1e3 * after:.1f} ms:"
            f" {statistics.median(ratios):.2f} x (quartiles {low:.2f} to {high:.2f})"
        )
    trials = sum(len(pairs) for name, pairs in times.items() if name.startswith("trial"))
    print(f"inserted: {inserted[0]} of {trials}, here {inserted[1]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, nargs="?")
    parser.add_argument("--serve", action="store_true")
    parser.add_argument("--trials", type=int, default=20, help="of L5 and of L8")
    parser.add_argument("--turns", type=int, default=12, help="of each picture and look")
    parser.add_argument("--only", default="", help="what begins with that, such as 'picture L8'")
    given = parser.parse_args()
    if given.serve:
        serve()
    elif given.other is None:
        parser.error("which other checkout?")
    else:
        main(given.other, given.trials, given.only, given.turns)
