"""Real trials on a real Ray cluster, one node of which is killed, end as on one machine.

Its two nodes are on this machine, as `ray start` makes them, at loopback addresses of their
own, and were started in another folder than the driver, which names its files from its own.
"""

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from tempfile import mkdtemp
from typing import Self

import pytest

from pliant.experiment import journal, results
from pliant.experiment.cells import Experiment
from pliant.experiment.plan import from_fields
from pliant.experiment.rows import Row, Rows
from pliant.experiment.runner import run
from pliant.experiment.work import Job, perform_job

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(find_spec("ray") is None, reason="needs Ray: the extra 'ray'"),
]

HERE = Path(__file__).parent
HEAD, OTHER = "127.0.0.2", "127.0.0.3"
UP_S, RUN_S = 40.0, 70.0  # at most
NODE = "PLIANT_TEST_NODE"  # in the environment of a node, and so of its workers


def plan() -> Experiment:
    return from_fields(
        {
            "pegs": ["circle"],
            "conditions": ["all"],
            "reasoners": ["mine.py:Mine", "none"],
            "trials": 30,
        }
    )


def noted(job: Job) -> Rows:
    """Performs a trial, and notes which node did."""
    rows = perform_job(job)
    with (job.folder / os.environ[NODE]).open("a", encoding="utf-8") as file:
        file.write(f"{rows.trial_id}\n")
    return rows


def notes(folder: Path, node: str) -> int:
    path = folder / node
    return len(path.read_text(encoding="utf-8").splitlines()) if path.exists() else 0


def drive(address: str, folder: str) -> None:
    """The driver: a process of its own, because Ray reads its token once in a process."""
    assert run(plan(), Path(folder), ray=address, work=noted).faults == 0


class Process:
    """A process and all it starts, which end with the context."""

    def __init__(
        self, name: str, logs: Path, folder: Path, *command: str, **environment: str
    ) -> None:
        self._log = logs / f"{name}.log"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                command,
                env={**os.environ, **environment},
                stdout=log,
                stderr=log,
                cwd=folder,
                start_new_session=True,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def wait_until(self, true: Callable[[], bool]) -> Self:
        """Until something holds, while the process lives."""
        end = time.monotonic() + UP_S
        while not true():
            assert self._process.poll() is None, f"it ended by itself: {self.said()}"
            assert time.monotonic() < end, f"not after {UP_S:g} s: {self.said()}"
            time.sleep(0.05)
        return self

    def wait(self) -> int:
        return self._process.wait(RUN_S)

    def said(self) -> str:
        return self._log.read_text(encoding="utf-8")


def node(name: str, folder: Path, *options: str, **environment: str) -> Process:
    """A running node of one core."""
    ray = str(Path(sys.executable).with_name("ray"))
    common = ("--num-cpus=1", "--object-store-memory=80000000", "--disable-usage-stats", "--block")
    environment |= {NODE: name}
    started = Process(name, folder, folder, ray, "start", *options, *common, **environment)
    try:
        return started.wait_until(lambda: "Ray runtime started" in started.said())
    except BaseException:
        started.kill()
        raise


@pytest.fixture
def ray_folder() -> Iterator[Path]:
    """Ray's files: sockets, whose paths must be short, and logs."""
    folder = Path(mkdtemp(prefix="ray."))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def test_a_killed_node_loses_nothing_and_changes_nothing(
    tmp_path: Path, ray_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far, near = tmp_path / "far", tmp_path / "near"
    (tmp_path / "mine.py").write_text(
        "from pliant.reasoners.rules import Rules as Mine\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    with socket.create_server((HEAD, 0)) as free:
        port = free.getsockname()[1]
    address = f"{HEAD}:{port}"
    environment = {
        "PYTHONPATH": f"{HERE}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": secrets.token_hex(32),
    }
    head = ["--head", f"--node-ip-address={HEAD}", f"--port={port}"]
    head += [f"--temp-dir={ray_folder}", "--include-dashboard=false"]
    other = [f"--address={address}", f"--node-ip-address={OTHER}"]
    code = f"from test_ray import drive; drive({address!r}, {far.name!r})"
    with (
        node("first", ray_folder, *head, **environment),
        node("second", ray_folder, *other, **environment) as second,
        Process(
            "driver", ray_folder, tmp_path, sys.executable, "-c", code, **environment
        ) as driver,
    ):
        driver.wait_until(lambda: notes(far, "second") >= 2)
        second.kill()
        done = len(list(journal.scan(far / journal.FILE)))
        assert driver.wait() == 0, driver.said()
    ids = [e.trial_id for e in journal.scan(far / journal.FILE)]
    assert done < len(ids), "the node was killed too late to matter"
    assert sorted(ids) == sorted(s.trial_id for s in plan().specs())
    assert notes(far, "first") > 0
    assert run(plan(), near, workers=2).complete
    assert trials(far) == trials(near)
    assert executions(far) == executions(near)


def trials(folder: Path) -> list[Row]:
    rows: list[Row] = results.read_trials(folder).to_pylist()
    return [{k: v for k, v in row.items() if k != "wall_s"} for row in rows]


def executions(folder: Path) -> list[list[Row]]:
    return list(results.each_trials_executions(folder))
