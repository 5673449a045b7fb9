"""Records decisions: trials of reasoners that waver, what a model would be told after each
execution, and the reply that the truth gives.

    python record.py decisions --trials 4000 --first-seed 100000 --processes 2

Sources are withheld, wrong, stale or in conflict at random, so that the text alone never suffices.
Pictures are not kept: of each look the state is, from which `draw.py` draws it, as it was and under
other looks. Every file holds ten trials and is written whole; what is there is not made again.
"""

import argparse
import gzip
import json
import math
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_ai.messages import BinaryContent
from wording import ASKED, reworded, unseen

sys.path.insert(0, str(Path(__file__).parents[2] / "reproduce"))
from make_cases import (
    ALIGN_MESSAGES,
    FAR,
    FIT_MESSAGES,
    RASH,
    STEADY,
    TIMID,
    Watched,
)
from make_stop_cases import GUIDED_WAYS, Wavering

from pliant.conditions import Condition, condition
from pliant.experiment.one import Spec, composed
from pliant.export.chat import Conversation, conversations
from pliant.export.labels import Label
from pliant.formations import Formation
from pliant.levels import INSERT, STOP, load_level, shipped_levels
from pliant.pose import angles_from
from pliant.reasoners import reasoner
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Check, Evidence, Execution, Trial
from pliant.recovery import Reasoner
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import load_task
from pliant.teaching import shipped

A_FILE = 10  # trials
MOST = {"planar": 14, "guided": 12}  # executions of a trial that are recorded
HELD_KIND, HELD_PEG = "overshot", "square"  # failures that are not trained on
PLANAR_PEGS = ("circle", "square", "rectangle_narrow") * 3 + ("hexagon", "triangle", "d_shape")
PLANAR = (
    ("rules", "all", STEADY),
    ("messages", "all", STEADY),
    ("retry", "friction", STEADY),
    ("rules", "all", RASH),
    ("rules", "all", RASH),
    ("rules", "friction", RASH),
    ("messages", "pose", RASH),
    ("rules", "pose", FAR),
    ("sweep", "all", FAR),
    ("rules", "all", TIMID),
    ("none", "all", STEADY),
)
GUIDED = ("L1", "L2", *("L3", "L4", "L6", "L6+", "L7") * 4, "L5", "L5+", "L8")  # edges cost most
STOPS = tuple(n for n, v in shipped_levels().items() if v.is_scenario and v.right == STOP)
OTHERS = tuple(n for n, v in shipped_levels().items() if v.is_scenario and v.right != STOP)
UNSEEN = ("dead_sensor",)  # ends a trial before a reasoner is asked


@dataclass(frozen=True, kw_only=True)
class Job:
    """A trial that is recorded: its number decides all that is drawn for it."""

    seed: int
    guided: bool

    def draw(self) -> np.random.Generator:
        return np.random.default_rng([self.seed, 18])


def record(job: Job) -> dict[str, Any] | None:
    """One trial: its setup, its looks, its decisions."""
    draw = job.draw()
    spec, mind, scenario = _planned(job, draw)
    setup = spec.condition.draw(spec.seed)
    robot = _cell().prepare(spec.task, setup)
    teaching = shipped().for_task(spec.task)
    run = composed(spec, robot, setup, teaching, mind)
    truths, looks = [], []
    with closing(iter(run)) as executions:
        for execution in executions:
            truths.append(_cell().truth())
            looks.append(_look(robot, execution))
            if len(run.history) >= MOST["guided" if job.guided else "planar"]:
                break
    trial = spec.trial(
        goals=teaching.goals,
        executions=tuple(run.history),
        end_reason=run.end_reason or "cut",
        fault=run.fault,
        model=None,
        simulated_s=run.clock_s,
        wall_s=0.0,
        truths=tuple(truths),
        limits=run.limits,
    )
    right = load_level(scenario).right if scenario else INSERT
    went_in = any(t.inserted for t in truths)
    if right == STOP and went_in:
        return None  # nobody can say what was right
    decisions = list(_decisions(trial, right, draw))
    if not decisions:
        return None
    return {
        "seed": job.seed,
        "level": spec.level,
        "scenario": scenario,
        "peg": spec.task.peg.name,
        "method": spec.method,
        "drawn": asdict(setup),
        "looks": looks,
        "decisions": decisions,
    }


def _planned(job: Job, draw: np.random.Generator) -> tuple[Spec, Reasoner, str | None]:
    """The trial, who decides in it, and the scenario that it has."""
    strange = draw.uniform()
    wrong = tuple(n for n in STOPS if n not in UNSEEN)
    scenario: str | None = None
    if strange < (0.30 if job.guided else 0.10):
        scenario = str(draw.choice(wrong))
    elif strange < (0.38 if job.guided else 0.13):
        scenario = str(draw.choice(OTHERS))
    level = str(draw.choice(GUIDED)) if job.guided else "L0"
    pegs = load_level(level).pegs if job.guided else PLANAR_PEGS
    if scenario is not None:
        able = load_level(scenario).pegs
        pegs = tuple(p for p in pegs if p in able) or tuple(pegs)
    peg = str(draw.choice(pegs))
    mind: Reasoner
    if job.guided:
        drawn = load_level(level).on(condition("all"))
        way = GUIDED_WAYS[int(draw.integers(2))] if draw.uniform() < 0.8 else (0.15, 0.0, 0.0)
        mind, name = Wavering(draw=np.random.default_rng([job.seed, 1]), way=way), "rules"
    else:
        name, ranges, waver = PLANAR[int(draw.integers(len(PLANAR)))]
        drawn = load_level(level).on(condition(ranges))
        mind = Watched(inner=reasoner(name), waver=waver, draw=np.random.default_rng([job.seed, 1]))
    if scenario is not None:
        drawn = Condition(name=scenario, ranges={**drawn.ranges, **load_level(scenario).ranges})
    spec = Spec(
        task=load_task(peg, level),
        level=level,
        condition=drawn,
        seed=job.seed,
        reasoner=name,
        method=load_level(level).method,
    )
    return spec, mind, scenario


def _look(robot: SimRobot, execution: Execution) -> dict[str, Any]:
    """The state in which an execution's last look was taken, and what is true then."""
    observation = execution.outcome.looks[-1].observation
    tip = robot.data.site_xpos[robot.tip_site]
    hole = robot.data.xpos[robot.board_body]
    roll, pitch, _ = angles_from(robot.data.xmat[robot.peg_body].reshape(3, 3))
    _, _, yaw = angles_from(robot.data.xmat[robot.board_body].reshape(3, 3))
    return {
        "time_s": robot.clock(),
        "taken_s": {n: v.time_s for n, v in observation.views.items()},
        "qpos": [round(float(q), 6) for q in robot.data.qpos],
        "tip": [round(float(v), 6) for v in tip],
        "hole": [round(float(v), 6) for v in hole],
        "roll": round(roll, 6),
        "pitch": round(pitch, 6),
        "yaw": round(yaw, 6),
    }


# --- decisions ---------------------------------------------------------------------------------


def _decisions(trial: Trial, right: str, draw: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Each execution is asked about twice, told differently; the second time its plans are of the
    other form."""
    first = bool(draw.integers(2))
    for again in range(2):
        settings = _settings(trial, draw, absolute=first if again == 0 else not first)
        tool = settings.plan is Plans.ABSOLUTE if draw.uniform() < 0.85 else bool(draw.integers(2))
        told = replace(
            trial,
            executions=tuple(_untrue(e, draw) for e in trial.executions),
        )
        shown = [_shown(n, trial, draw) for n in range(len(trial.executions))]
        for label, said in conversations(told, settings):
            if again and said.stage == "judge" and label.success and draw.uniform() < 0.5:
                continue
            yield from _decision(trial, label, said, right, shown, tool, draw)


def _settings(trial: Trial, draw: np.random.Generator, *, absolute: bool) -> Settings:
    paper = draw.uniform() < (0.7 if absolute else 0.1)
    return Settings(
        plan=Plans.ABSOLUTE if absolute else Plans.BOUNDED,
        brief=True,
        picture_px=16,  # what is drawn later stands in their places
        history=0 if paper else int(draw.choice([0, 1, 3, 3, 3])),
        measurements=not paper and draw.uniform() < 0.35,
        belief=not paper and draw.uniform() < 0.75,
        step_limit_mm=1000.0 if paper else 40.0,
    )


def _untrue(execution: Execution, draw: np.random.Generator) -> Execution:
    """The execution with sources left out, or with votes and words that are wrong."""
    kept: list[Check] = []
    for check in execution.evidence.checks:
        u, changed = draw.uniform(), check
        if check.name == "table_i":
            if u < 0.15:
                continue
            if u < 0.27 and check.vote is not None:
                changed = _misworded(check, execution.formation, draw)
        elif check.name == "pose":
            if u < 0.12:
                continue
            if u < 0.18 and check.vote is not None:
                changed = _misread(check, execution, draw)
        elif check.name in ("metric", "plausible") and u < 0.12:
            continue
        elif check.name == "metric" and u < 0.18 and check.vote is not None:
            changed = replace(check, vote=not check.vote)
        kept.append(changed)
    return replace(execution, evidence=Evidence(checks=tuple(kept)))


def _misworded(check: Check, formation: Formation, draw: np.random.Generator) -> Check:
    of = FIT_MESSAGES if formation is Formation.FIT else ALIGN_MESSAGES
    message = str(draw.choice([m for m in of if m != check.message]))
    return replace(check, vote=message.endswith("success"), message=message)


def _misread(check: Check, execution: Execution, draw: np.random.Generator) -> Check:
    """The pose check with the other vote."""
    if not check.vote:
        return replace(check, vote=True, message="reached")
    axis = "z" if execution.formation is Formation.INSERTION else "y"
    off = draw.uniform(1.1, 6.0) * (1 if draw.uniform() < 0.5 else -1)
    return replace(check, vote=False, message=f"off by {axis} {off:+.1f} mm")


def _shown(n: int, trial: Trial, draw: np.random.Generator) -> tuple[str, int]:
    """Which picture is shown of an execution: its own, the one before it, or none that shows
    anything."""
    u = draw.uniform()
    if u < 0.04:
        return "black", n
    if u < 0.10 and n > 0 and _differ(trial, n):
        return "stale", n - 1
    return "look", n


def _differ(trial: Trial, n: int) -> bool:
    one, other = (trial.truths[k] for k in (n - 1, n))
    return math.dist(one.tip, other.tip) >= 0.003 or abs(one.tilt_rad - other.tilt_rad) > 0.05


def _decision(
    trial: Trial,
    label: Label,
    said: Conversation,
    right: str,
    shown: Sequence[tuple[str, int]],
    tool: bool,
    draw: np.random.Generator,
) -> Iterator[dict[str, Any]]:
    index = label.execution.index
    reply = said.reply.model_dump(mode="json")
    if said.stage != "judge" and right != INSERT:
        if right != STOP:
            return  # either would do
        if not _could_tell(trial, index):
            return
        reply = _stopped(reply, said.stage)
    how, look = shown[index]
    if said.stage == "judge" and how != "look":
        reply["picture"] = "not available"
        if how == "stale":
            reply["conflict"] = "the picture is older than the pose"
    is_told = any(str(item).startswith("Tip: ") or "\nTip: " in str(item) for item in said.user)
    blind = how != "look" and not is_told
    if blind:
        reply = {k: unseen(v) if isinstance(v, str) else v for k, v in reply.items()}
    user: list[str] = []
    pictures: list[list[Any]] = []
    phrasing = 0
    for item in said.user:
        if isinstance(item, BinaryContent):
            before = user[-1]
            if before.startswith("Goal, "):
                pictures.append(["goal", trial.task.peg.name])
            else:
                camera = "front" if before == "Front:" else "side"
                pictures.append(["black"] if how == "black" else ["look", look, camera])
            user.append("<image>")
        elif str(item).startswith("Asked: "):
            phrasing = int(draw.integers(len(ASKED[said.stage]))) if draw.uniform() < 0.4 else 0
            words = ASKED[said.stage][phrasing]
            user.append(f"Asked: {words}")
        else:
            user.append(unseen(str(item)) if blind else str(item))
    held = [
        *(["phrase"] if phrasing == len(ASKED[said.stage]) - 1 else []),
        *(["combination"] if label.kind == HELD_KIND and trial.task.peg.name == HELD_PEG else []),
    ]
    yield {
        "stage": said.stage,
        "kind": said.kind,
        "formation": str(label.execution.formation),
        "execution": index,
        "success": label.success,
        "shown": how,
        "tool": tool,
        "system": said.system,
        "user": user,
        "pictures": pictures,
        "reply": json.dumps(reworded(reply, draw), ensure_ascii=False, separators=(",", ":")),
        "plain": json.dumps(reply, ensure_ascii=False, separators=(",", ":")),
        "held": held,
    }


def _could_tell(trial: Trial, index: int) -> bool:
    """Whether something else went wrong before, without which nobody knows that a failure cannot
    be mended."""
    before = trial.executions[:index]
    return any(not e.verdict.success or e.outcome.scene.peg is None for e in before)


def _stopped(reply: dict[str, Any], stage: str) -> dict[str, Any]:
    """The reply where no motion can help."""
    if stage == "analyse":
        numbers = {k: 0 for k in reply if k.endswith(("_mm", "_deg"))}
        return {
            **reply,
            **numbers,
            "why": "Something here is not as the task says",
            "wrong_goal": "none",
            "how_to_recover": "stop, and call a person: no motion can help",
        }
    if "steps" in reply:
        return {**reply, "steps": []}
    numbers = {k: 0 for k in reply if k.endswith(("_mm", "_deg"))}
    return {**reply, **numbers, "resume_from": "stop", "retreat_first": False}


# --- files -------------------------------------------------------------------------------------


@cache
def _cell() -> SimCell:
    return SimCell()


def write(path: Path, jobs: Sequence[Job]) -> int:
    """Record some trials into a file; returns how many decisions it holds."""
    found = [trial for trial in map(record, jobs) if trial is not None]
    part = path.with_suffix(".part")
    with gzip.open(part, "wt", encoding="utf-8") as file:
        for trial in found:
            file.write(json.dumps(trial, ensure_ascii=False) + "\n")
    part.replace(path)
    return sum(len(trial["decisions"]) for trial in found)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--first-seed", type=int, default=100_000)
    parser.add_argument("--trials", type=int, default=4000)
    parser.add_argument("--guided", type=float, default=0.17, help="share with the guided skills")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("LP_NUM_THREADS", "0")
    every = max(1, round(1 / given.guided)) if given.guided else 0
    plan: dict[Path, list[Job]] = {}
    for n in range(given.trials):
        job = Job(seed=given.first_seed + n, guided=bool(every) and n % every == 0)
        first = n // A_FILE * A_FILE
        plan.setdefault(given.out / f"{given.first_seed + first}.jsonl.gz", []).append(job)
    missing = {path: jobs for path, jobs in plan.items() if not path.exists()}
    total = 0
    with ProcessPoolExecutor(given.processes) as workers:
        waiting = {workers.submit(write, path, jobs): path for path, jobs in missing.items()}
        for done in as_completed(waiting):
            total += done.result()
            print(waiting[done].name, done.result(), total, flush=True)


if __name__ == "__main__":
    main()
