"""Measures pictures that were never trained on, by edges, by the network and by both, against
truth.

Each camera is calibrated for all of them by a picture of the hanging peg with the same looks, which
both together measure and whose tip is known within 0.2 mm: what the arm knows worse than that in a
trial comes on top, for every sight alike. What the other camera tells is taken from truth, with its
noise.

    python evaluate.py states.npz figures.json --pictures 2000
"""

import argparse
import json
import math
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import states
from data import Picture, Scenes

from pliant.cell import View
from pliant.vision.edges import Aside, measure_edges
from pliant.vision.fused import joined, measure_fused
from pliant.vision.learned import measure_learned
from pliant.vision.offset import UNKNOWN, Offset, offset_between
from pliant.vision.scene import Measured, Scene

FIRST, LAST = 600_000, 649_999  # seeds of looks, never trained on
LEVELS = ("L0", "L5", "L5+", "L8")  # of the states' trials, in turn
WAYS = ("edges", "learned", "fused")
_ARM_SD = 0.0002  # [m]
_NEAR_M, _NEAR_RAD = 0.001, math.radians(1.0)


def aside_of(picture: Picture, random: np.random.Generator) -> Aside:
    noise = random.standard_normal(4) * (0.0005, 0.005, 0.0005, math.radians(0.3))
    return Aside(
        tip_x=picture.peg.x + noise[0],
        lean=picture.peg.lean + noise[1],
        board_x=picture.block.x + noise[2],
        board_yaw=picture.block.yaw + noise[3],
    )


def measured(way: Any, picture: Picture, aside: Aside, offset: Offset) -> Scene:
    view = View(camera=picture.camera, time_s=0.0, image=picture.image)
    task, pose, pressed = picture.task, picture.pose, picture.pressed
    return way(view, task, pose, aside=aside, offset=offset, pressed=pressed)


def errors(hanging: Picture, picture: Picture, seed: int) -> dict[str, dict[str, Any]]:
    """One picture's errors and standard deviations by every way, with the offset that a hanging
    peg gave."""
    random = np.random.default_rng([seed, 5])
    offset = UNKNOWN
    raw = measured(measure_fused, hanging, aside_of(hanging, random), UNKNOWN)
    if raw.peg is not None:
        y, z = (
            Measured(value=true + _ARM_SD * random.standard_normal(), sd=_ARM_SD)
            for true in (hanging.peg.y, hanging.peg.z)
        )
        offset = offset_between((y, z), raw.peg)
    aside = aside_of(picture, random)
    times = [time.perf_counter()]
    edges = measured(measure_edges, picture, aside, offset)
    times.append(time.perf_counter())
    learned = measured(measure_learned, picture, aside, offset)
    times.append(time.perf_counter())
    view = View(camera=picture.camera, time_s=0.0, image=picture.image)
    both = joined(edges, learned, view, picture.task, picture.pose, aside=aside, offset=offset)
    spent = (times[1] - times[0], times[2] - times[1], times[2] - times[0])
    return {
        way: {"ms": 1e3 * seconds, **_off(scene, picture)}
        for way, scene, seconds in zip(WAYS, (edges, learned, both), spent, strict=True)
    }


def _off(scene: Scene, picture: Picture) -> dict[str, Any]:
    peg, hole = picture.peg, picture.block
    found: dict[str, Any] = {"doubts": scene.doubts}
    if scene.peg is not None:
        for name, value, true in (
            ("tip y", scene.peg.tip_y, peg.y),
            ("tip z", scene.peg.tip_z, peg.z),
            ("tilt", scene.peg.tilt, peg.tilt),
        ):
            found[name] = (value.value - true, value.sd)
    if scene.hole is not None:
        found["hole y"] = (scene.hole.y.value - hole.y, scene.hole.y.sd)
        found["surface"] = (scene.hole.surface_z.value - hole.z, scene.hole.surface_z.sd)
    return found


def figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    both = [r for r in rows if "tip y" in r and "hole y" in r]
    near = [
        math.hypot(r["tip y"][0], r["tip z"][0]) <= _NEAR_M and abs(r["tilt"][0]) <= _NEAR_RAD
        for r in rows
        if "tip y" in r
    ]
    told: dict[str, Any] = {
        "pictures": len(rows),
        "found %": 100 * len(both) / len(rows),
        "peg found %": 100 * len(near) / len(rows),
        "within 1 mm and 1 deg % of all": 100 * sum(near) / len(rows),
        "tilt within 1 deg %": 100
        * float(np.mean([abs(r["tilt"][0]) <= _NEAR_RAD for r in rows if "tilt" in r])),
        "ms median": float(np.median([r["ms"] for r in rows])),
        "in doubt %": 100 * sum(bool(r["doubts"]) for r in rows) / len(rows),
    }
    for name in ("tip y", "tip z", "tilt", "hole y", "surface"):
        some = np.array([r[name] for r in rows if name in r])
        if not len(some):
            continue
        unit = 180 / math.pi if name == "tilt" else 1e3
        off = np.abs(some[:, 0])
        told[f"{name} median"] = float(np.median(off)) * unit
        told[f"{name} 95 %"] = float(np.quantile(off, 0.95)) * unit
        told[f"{name} holds %"] = 100 * float(np.mean(off <= 1.96 * some[:, 1]))
        told[f"{name} sd median"] = float(np.median(some[:, 1])) * unit
    return {k: round(v, 3) for k, v in told.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("states", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pictures", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="of the seeds of looks, from 600000")
    given = parser.parse_args()
    trials = states.load(given.states)
    scenes = Scenes(trials)
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    each = math.ceil(given.pictures / len(trials))
    began = time.monotonic()
    for n in range(len(trials)):
        level = LEVELS[n % len(LEVELS)]
        scenes.take(n)
        looked = np.flatnonzero(scenes.trial.looked)
        for k in range(each):
            seed = FIRST + given.first + n * each + k
            random = np.random.default_rng([seed, 4])
            name = "side" if random.uniform() < 0.6 else "front"
            row = int(random.integers(len(scenes.trial.time_s)))
            dressed = {"looks": level != "L0", "occluder": level == "L5+"}
            hanging = scenes.picture(int(looked[0]), name, seed, **dressed)
            picture = scenes.picture(row, name, seed, **dressed)
            for way, row_of in errors(hanging, picture, seed).items():
                row_of |= {"seed": seed, "trial": n, "row": row, "camera": name}
                for group in (level, f"{level} {name}", "all"):
                    found[f"{group} {way}"].append(row_of)
        told = {group: figures(rows) for group, rows in sorted(found.items())}
        given.out.write_text(json.dumps(told, indent=1), encoding="utf-8")
        with given.out.with_suffix(".rows.json").open("w", encoding="utf-8") as file:
            json.dump({g: r for g, r in found.items() if g.startswith("all")}, file)
        print(n, level, f"{time.monotonic() - began:.0f} s", flush=True)
    for way in WAYS:
        print(way, json.dumps(told[f"all {way}"], indent=1))


if __name__ == "__main__":
    main()
