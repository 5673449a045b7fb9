"""How an experiment scales: trials/s with one and two local workers, and the resume of a long one.

Both worker counts perform the same trials, a few seeds of every cell of Table II, in turns. Their
rates are given for the whole call and from the first finished trial on, without the start of
processes. Then a journal of that many lines as the trials wrote is resumed: the time until all its
lines are known, and until the first new trial is finished; and the peak memory of that process.
"""

import argparse
import os
import shutil
import statistics
import sys
import time
import zlib
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import cycle
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from pliant.experiment import journal
from pliant.experiment.cells import Experiment
from pliant.experiment.plan import from_fields, load
from pliant.experiment.progress import Silent
from pliant.experiment.rows import Rows, lost
from pliant.experiment.runner import run
from pliant.experiment.work import Job

TABLE_2 = Path(__file__).parents[1] / "reproduce" / "table2.yaml"
TABLE_2_TRIALS = 480  # as many as the paper's
MOST_S = 100.0  # no new pair of runs begins later


class Watch(Silent):
    """Notes when trials were finished [s]."""

    def __init__(self) -> None:
        self.ends: list[float] = []

    def finished(self, cell: int, inserted: bool | None, fault: str = "") -> None:
        self.ends.append(time.perf_counter())


class Stops(Silent):
    """Notes when the journal was read [s], and interrupts at the first new trial."""

    def __init__(self) -> None:
        self.read = self.first = 0.0

    def say(self, text: str) -> None:
        self.read = self.read or time.perf_counter()

    def finished(self, cell: int, inserted: bool | None, fault: str = "") -> None:
        self.first = time.perf_counter()
        raise KeyboardInterrupt


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Trials/s of a whole call, and from its first finished trial on."""

    whole: float
    steady: float


def rate(plan: Experiment, folder: Path, workers: int) -> Rate:
    watch = Watch()
    began = time.perf_counter()
    run(plan, folder, workers=workers, watcher=watch)
    ended = time.perf_counter()
    first, last = watch.ends[0], watch.ends[-1]
    return Rate(whole=len(plan) / (ended - began), steady=(len(plan) - 1) / (last - first))


def scaling(plan: Experiment, folder: Path, pairs: int) -> None:
    """Runs of one and two workers in turns, in folders of their own."""
    rates: dict[int, list[Rate]] = {1: [], 2: []}
    began = time.monotonic()
    for pair in range(pairs):
        if time.monotonic() - began > MOST_S:
            print(f"Stopped after {pair} pairs: they took {MOST_S:g} s.\n")
            break
        for workers, seen in rates.items():
            seen.append(rate(plan, folder / f"{pair}-{workers}", workers))
    print(f"{len(plan)} trials of Table II's cells, medians of {len(rates[1])} pairs:\n")
    print(
        "| | 1 worker, trials/s | 2 workers, trials/s | ratio (least – most) |\n|---|---|---|---|"
    )
    for name in ("whole", "steady"):
        one, two = ([getattr(r, name) for r in rates[n]] for n in (1, 2))
        ratios = [b / a for a, b in zip(one, two, strict=True)]
        print(
            f"| {'whole call' if name == 'whole' else 'from the first finished trial'}"
            f" | {statistics.median(one):.2f} | {statistics.median(two):.2f}"
            f" | {statistics.median(ratios):.2f} ({min(ratios):.2f} – {max(ratios):.2f}) |"
        )
    seconds = TABLE_2_TRIALS / statistics.median(r.steady for r in rates[2])
    print(f"\nTable II's {TABLE_2_TRIALS} trials at that rate of 2 workers: {seconds:.0f} s")


# --- a long journal ------------------------------------------------------------------------------


def long_experiment(lines: int) -> Experiment:
    """Two cells of `lines` trials: one is in the journal, the other is to be done."""
    return from_fields(
        {
            "pegs": ["circle"],
            "conditions": ["all"],
            "reasoners": ["rules", "none"],
            "trials": lines,
        }
    )


def write_long(path: Path, templates: list[bytes], lines: int) -> None:
    """Lines like `templates`, under the names of the first cell's trials."""
    bodies = [(t[: t.rindex(b',"crc":')], t.split(b'"', 4)[3]) for t in templates]
    with path.open("wb", buffering=1 << 20) as file:
        for spec, (body, name) in zip(long_experiment(lines).specs(), cycle(bodies), strict=False):
            if spec.reasoner != "rules":
                return
            renamed = body.replace(name, spec.trial_id.encode())
            file.write(b'%b,"crc":%d}\n' % (renamed, zlib.crc32(renamed)))


def nothing(job: Job) -> Rows:
    """A trial without simulation."""
    return lost(job.spec, "made_up", "", wall_s=0.0)


def peak_mb() -> float:
    """The most memory this process has held [MB]."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def resume(folder: Path, lines: int) -> tuple[float, float, float, float]:
    """Resume in a process of its own: seconds until the journal is read and until the first new
    trial is finished; peak memory before and after [MB]."""
    stops, before = Stops(), peak_mb()
    began = time.perf_counter()
    done = run(long_experiment(lines), folder, workers=1, watcher=stops, work=nothing)
    assert done.resumed == lines
    return stops.read - began, stops.first - began, before, peak_mb()


def resuming(folder: Path, templates: list[bytes], lines: int) -> None:
    folder.mkdir()
    path = folder / journal.FILE
    need = lines * statistics.mean(map(len, templates))
    free = shutil.disk_usage(folder).free
    if free < 1.2 * need:
        print(f"\nNot resumed: {need / 1e9:.1f} GB are needed in {folder}, {free / 1e9:.1f} free.")
        return
    run(long_experiment(lines), folder, workers=1, watcher=Stops(), work=nothing)  # run.json
    write_long(path, templates, lines)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as own:
        read, first, before, peak = own.submit(resume, folder, lines).result()
    print(
        f"\nA journal of {lines:,} lines ({path.stat().st_size / 1e9:.2f} GB, just written) is read"
        f" in {read:.1f} s; the first new trial is finished after {first:.1f} s; peak memory"
        f" {peak:.0f} MB, {before:.0f} MB before"
    )


def main(trials: int, pairs: int, lines: int) -> None:
    cores = len(os.sched_getaffinity(0))
    print(f"{cores} cores, load {os.getloadavg()[0]:.1f}, Python {sys.version.split()[0]}\n")
    cache = Path(__file__).parents[1] / ".cache"
    cache.mkdir(exist_ok=True)
    with TemporaryDirectory(prefix="workers.", dir=cache) as name:
        folder = Path(name)
        scaling(load(TABLE_2, {"trials": trials}), folder, pairs)
        templates = (folder / "0-1" / journal.FILE).read_bytes().splitlines(keepends=True)
        if lines:
            resuming(folder / "long", templates, lines)
    print(f"\nLoad at the end: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=2, help="seeds of each of the 16 cells")
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--lines", type=int, default=1_000_000, help="0: no long journal")
    options = parser.parse_args()
    main(options.trials, options.pairs, options.lines)
