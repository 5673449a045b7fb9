"""The memory of one worker over many trials, peg after peg: for docs/speed.md.

It performs trials as a worker does, in this process, and prints what the process holds after some
of them: the resident memory of the system's own account.
"""

import argparse
from pathlib import Path

from pliant.experiment.one import Spec
from pliant.experiment.work import Job, Save, perform_job

PEGS = ("circle", "square", "rectangle")


def resident_mb() -> float:
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def main(level: str, trials: int) -> None:
    print(f"| trials of {level} | peg | memory [MB] |\n|---|---|---|")
    shown = {1, 10, 100, *(trials * part // 5 for part in range(1, 6))}
    for number in range(1, trials + 1):
        peg = PEGS[(number - 1) * len(PEGS) // trials]
        spec = Spec.named(peg=peg, level=level, seed=number)
        perform_job(Job(spec=spec, goals=None, folder=Path("unused"), save=Save.NONE))
        if number in shown:
            print(f"| {number} | {peg} | {resident_mb():.0f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--level", default="L0")
    parser.add_argument("--trials", type=int, default=1000)
    options = parser.parse_args()
    main(options.level, options.trials)
