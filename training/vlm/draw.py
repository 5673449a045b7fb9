"""Draws the pictures of recorded decisions: each look as it was, and dressed anew.

    python draw.py decisions pictures --processes 16

Writes `pictures-K.raw` (n, 3, 288, 384) of bytes and `index-K.json`, which names each one's trial,
look, camera and variant (0: as it was) with what is true in it and where that is seen, for each
process K.
"""

import argparse
import gzip
import json
import math
import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np

from pliant.cell import Camera
from pliant.conditions import Setup
from pliant.pose import rotation_matrix
from pliant.sim.cell import SimRobot
from pliant.sim.setup import apply
from pliant.task import load_task

WIDTH, HEIGHT = 384, 288
VARIANTS = 2  # pictures of a look: as it was, and dressed
DRESSED = 700_000 - 1  # seeds of looks go down from here to 650000: no others are used
CHUNK = 512  # pictures that are written at a time
UP_THE_PEG = 0.040  # [m] where its second point is


def trials(files: Sequence[Path]) -> Iterator[dict[str, Any]]:
    for path in files:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            yield from map(json.loads, file)


def drawn(
    robot: SimRobot, trial: dict[str, Any], look: dict[str, Any], setup: Setup, camera: str
) -> tuple[np.ndarray, Camera]:
    """The picture of a camera in a look's state (288, 384, 3), and the camera."""
    mujoco.mj_resetData(robot.model, robot.data)
    apply(robot.model, setup, look["time_s"])
    robot.data.qpos[:] = look["qpos"]
    mujoco.mj_forward(robot.model, robot.data)
    robot.cameras.dress(setup)
    view = robot.cameras.view(camera, robot.data, look["time_s"])
    return cv2.resize(view.image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), view.camera


def geometry(look: dict[str, Any], camera: str) -> list[float]:
    """What is true in a camera's picture [mm, deg]: how far the tip is from the hole, its depth,
    the peg's lean, where tip and hole are, and the board's height or, from the front, its turn."""
    tip, hole = 1e3 * np.array(look["tip"]), 1e3 * np.array(look["hole"])
    across, lean = (1, "roll") if camera == "side" else (0, "pitch")
    last = hole[2] if camera == "side" else math.degrees(look["yaw"])
    where = [tip[across] - hole[across], hole[2] - tip[2], math.degrees(look[lean])]
    return [float(v) for v in (*where, tip[across], hole[across], last)]


def points(look: dict[str, Any], camera: Camera) -> list[list[float]]:
    """Where a camera sees the middle of the peg's bottom face, a point of its axis above it, and
    the middle of the hole (column, row) [px]."""
    tip, hole = np.array(look["tip"]), np.array(look["hole"])
    up = rotation_matrix(look["roll"], look["pitch"], 0.0)[:, 2]
    return [
        [round(v, 2) for v in camera.project(point)] for point in (tip, tip + UP_THE_PEG * up, hole)
    ]


def draw(part: int, files: Sequence[Path], out: Path, until: float) -> None:
    """Draw all pictures of some files, until the time is up."""
    os.environ.setdefault("LP_NUM_THREADS", "0")
    robots: dict[tuple[str, str], SimRobot] = {}
    index: list[dict[str, Any]] = []
    waiting: list[np.ndarray] = []
    with (out / f"pictures-{part}.raw").open("wb") as file:
        for trial in trials(files):
            key = (trial["peg"], trial["level"])
            if key not in robots:
                for old in list(robots)[: max(0, len(robots) - 5)]:
                    robots.pop(old).cameras.close()
                robots[key] = SimRobot(load_task(*key))
            robot = robots[key]
            used = {
                (p[1], p[2]) for d in trial["decisions"] for p in d["pictures"] if p[0] == "look"
            }
            own = Setup(**trial["drawn"])
            for n, camera in sorted(used):
                look = trial["looks"][n]
                for variant in range(VARIANTS):
                    seed = DRESSED - (trial["seed"] * 131 + n * 7 + variant) % 50_000
                    setup = (
                        own
                        if variant == 0
                        else replace(own, seed=seed, looks=1.0, occluder=float(seed % 5 == 0))
                    )
                    image, taken = drawn(robot, trial, look, setup, camera)
                    waiting.append(image.transpose(2, 0, 1))
                    index.append({
                        "seed": trial["seed"], "look": n, "camera": camera, "variant": variant,
                        "true": geometry(look, camera), "points": points(look, taken),
                        "peg": own.peg_missing <= 0.5,
                    })  # fmt: skip
            if len(waiting) >= CHUNK:
                file.write(np.ascontiguousarray(np.stack(waiting)).tobytes())
                waiting.clear()
            if time.time() > until:
                break
        if waiting:
            file.write(np.ascontiguousarray(np.stack(waiting)).tobytes())
    (out / f"index-{part}.json").write_text(json.dumps(index), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("decisions", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--files", type=int, default=10**9, help="the first so many only")
    parser.add_argument("--seconds", type=float, default=1e9, help="then what is drawn must do")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    files = sorted(given.decisions.glob("*.jsonl.gz"))[: given.files]
    until = time.time() + given.seconds
    context = multiprocessing.get_context("spawn")
    parts = [files[k :: given.processes] for k in range(given.processes)]
    jobs = [
        context.Process(target=draw, args=(k, part, given.out, until))
        for k, part in enumerate(parts)
        if part
    ]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join()
    bad = [job.exitcode for job in jobs if job.exitcode]
    if bad:
        raise SystemExit(f"{len(bad)} of {len(jobs)} processes failed")


if __name__ == "__main__":
    main()
