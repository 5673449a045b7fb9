"""A short profile of trials: `python benchmarks/profiled.py --level L8`, for docs/speed.md."""

import argparse
import cProfile
import io
import os
import pstats
import time
from pathlib import Path

os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core, as in an experiment

import cv2

import pliant.sim  # noqa: F401, chooses the OpenGL back end
from pliant.experiment.one import Spec, perform
from pliant.sim.cell import SimCell
from pliant.teaching import shipped


def main(level: str, trials: int, lines: int) -> None:
    cv2.setNumThreads(1)
    cell = SimCell()
    specs = [Spec.named(level=level, seed=seed) for seed in range(trials + 1)]
    perform(specs[0], cell, shipped())  # warms up
    profile = cProfile.Profile(time.process_time)
    for spec in specs[1:]:
        profile.runcall(perform, spec, cell, shipped())
    found = pstats.Stats(profile, stream=io.StringIO()).strip_dirs().sort_stats("tottime")
    whole = sum(own for _, _, own, _, _ in found.stats.values())  # type: ignore[attr-defined]
    print(f"{level}, {trials} trials: {whole / trials:.2f} s each while profiled")
    for place in found.fcn_list[:lines]:  # type: ignore[attr-defined]
        _, calls, own, within, _ = found.stats[place]  # type: ignore[attr-defined]
        file, _, name = place
        where = f"{Path(file).stem}.{name}" if file not in ("~", "") else name
        print(
            f"{100 * own / whole:5.1f} % {100 * within / whole:5.1f} % within"
            f" {calls / trials:7.0f} calls  {where}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--level", default="L0")
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--lines", type=int, default=14)
    given = parser.parse_args()
    main(given.level, given.trials, given.lines)
