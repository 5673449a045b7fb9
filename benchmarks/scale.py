"""How far one experiment scales: trials/s on Ray with more and more workers, what the driver alone
can keep, and how much a trial takes to send and to store. For docs/speed.md.

Every rate is of trials that are finished, so on the disk. "Nothing" is a trial without simulation:
what is left is the driver's own work, scheduling, checks, one line and its fsync, which is the most
that any number of cores can be kept busy with. Needs the extra `ray`.
"""

import argparse
import os
import pickle
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from workers import Watch, nothing

from pliant.experiment import journal
from pliant.experiment.cells import Experiment
from pliant.experiment.engine import Work
from pliant.experiment.plan import from_fields
from pliant.experiment.runner import run
from pliant.experiment.work import Job, Save, perform_job

WORKERS = (1, 2, 4)
LEVELS = ("L0", "L8")


def planned(trials: int, level: str = "L0") -> Experiment:
    fields = {"pegs": ["circle"], "conditions": ["all"], "reasoners": ["rules"], "level": level}
    return from_fields({**fields, "trials": trials, "first_seed": 1})


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A Ray cluster on this machine that counts so many cores; its address."""
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": workers})
    try:
        yield made.address
    finally:
        made.shutdown()


def steady(trials: int, folder: Path, work: Work, *, address: str | None, workers: int) -> float:
    """Trials/s after the first tenth, when all workers have started."""
    watch = Watch()
    count = None if address else workers
    run(planned(trials), folder, ray=address, workers=count, watcher=watch, work=work)
    ends = watch.ends[trials // 10 :]
    return (len(ends) - 1) / (ends[-1] - ends[0])


def rates(folder: Path, trials: int, empty: int, repeats: int) -> None:
    print("| workers | engine | trials of L0, trials/s | nothing, trials/s |\n|---|---|---|---|")
    for engine in ("processes", "Ray"):
        for workers in WORKERS:
            seen: dict[Work, list[float]] = {perform_job: [], nothing: []}
            for turn in range(repeats):
                for work, count in ((perform_job, trials), (nothing, empty)):
                    where = folder / f"{engine}-{workers}-{turn}-{work.__name__}"
                    if engine == "Ray":
                        with cluster(workers) as address:
                            rate = steady(count, where, work, address=address, workers=workers)
                    else:
                        rate = steady(count, where, work, address=None, workers=workers)
                    seen[work].append(rate)
            real, none = (statistics.median(seen[work]) for work in (perform_job, nothing))
            print(f"| {workers} | {engine} | {real:.2f} | {none:.0f} |", flush=True)


def sizes(folder: Path, levels: Sequence[str], trials: int) -> None:
    print("\n| level | job [kB] | journal line [kB] | whole record [MB] |\n|---|---|---|---|")
    for level in levels:
        plan, where = planned(trials, level), folder / f"sizes-{level}"
        run(plan, where, workers=2, save=Save.ALL)
        lines = (where / journal.FILE).read_bytes().splitlines()
        records = [
            sum(f.stat().st_size for f in trial.rglob("*") if f.is_file())
            for trial in (where / "trials").iterdir()
        ]
        job = Job(spec=next(plan.specs()), goals=None, folder=where, save=Save.ALL)
        print(
            f"| {level} | {len(pickle.dumps(job)) / 1e3:.1f}"
            f" | {statistics.median(map(len, lines)) / 1e3:.1f}"
            f" | {statistics.median(records) / 1e6:.1f} |"
        )


def fsyncs(folder: Path, count: int = 200) -> None:
    """How long a line of 8 kB takes to be on this disk."""
    took, line = [], b"x" * 8000
    with (folder / "line").open("ab", buffering=0) as file:
        for _ in range(count):
            began = time.perf_counter()
            file.write(line)
            os.fsync(file.fileno())
            took.append(time.perf_counter() - began)
    print(f"\nA line of 8 kB is on the disk after {statistics.median(took) * 1e3:.2f} ms (median)")


def main(trials: int, empty: int, repeats: int) -> None:
    cores = len(os.sched_getaffinity(0))
    print(f"{cores} cores, load {os.getloadavg()[0]:.1f}, Python {sys.version.split()[0]}\n")
    # Processes that Ray starts find this module's own functions by their names.
    os.environ["PYTHONPATH"] = str(Path(__file__).parent)
    with TemporaryDirectory(prefix="scale.", dir=Path(__file__).parents[1] / ".cache") as name:
        rates(Path(name), trials, empty, repeats)
        sizes(Path(name), LEVELS, 6)
        fsyncs(Path(name))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=40, help="of L0, at each number of workers")
    parser.add_argument("--empty", type=int, default=2000, help="trials without simulation")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    main(options.trials, options.empty, options.repeats)
