"""On a real Ray cluster of two nodes, one of which is killed, results are those of one machine."""

import importlib.util
import os
import secrets
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from test_experiment_runner import HERE, experiment, finished, outcomes, quick, troubled

from pliant.errors import InputError
from pliant.experiment.runner import run

pytestmark = pytest.mark.system
TRIALS = 60  # per cell


@pytest.fixture(scope="module", autouse=True)
def environment() -> Iterator[None]:
    """What nodes inherit. Ray reads its token once, as it is first imported."""
    if importlib.util.find_spec("ray") is None:
        pytest.skip("the extra 'ray' is not installed")
    path = f"{HERE}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", path)
        patch.setenv("RAY_AUTH_MODE", "token")
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(16))
        yield


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A head and a second node, each of one core."""
    made = importlib.import_module("ray.cluster_utils").Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1}
    )
    made.second = made.add_node(num_cpus=1)
    yield made
    made.shutdown()


@pytest.mark.filterwarnings("default")  # Ray's own
def test_a_node_that_dies_mid_run_loses_nothing(cluster: Any, tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    run(experiment(TRIALS), here, workers=2, work=quick)
    killed_at: list[int] = []

    def kill_second_node() -> None:
        while finished(there) < 10:
            time.sleep(0.05)
        killed_at.append(finished(there))
        cluster.remove_node(cluster.second, allow_graceful=False)

    killer = Thread(target=kill_second_node)
    killer.start()
    done = run(experiment(TRIALS), there, ray=cluster.address, work=quick)
    killer.join()
    assert done.complete
    assert killed_at[0] < 2 * TRIALS
    ours, theirs = outcomes(there), outcomes(here)
    assert ours[0].equals(theirs[0])
    assert ours[1] == theirs[1]


@pytest.mark.filterwarnings("default")
def test_deaths_and_time_outs_on_a_cluster_are_recorded(cluster: Any, tmp_path: Path) -> None:
    one = experiment(6, reasoners=["rules"])
    assert run(one, tmp_path, ray=cluster.address, work=troubled, time_limit_s=2.0).complete
    ends = {r["seed"]: r["end_reason"] for r in outcomes(tmp_path)[0].to_pylist()}
    assert [ends[s] for s in (2, 3, 4)] == ["fault:worker", "fault:worker", "fault:error"]
    assert ends[5] == ends[1] == "fault:made_up"


def test_a_cluster_that_does_not_answer_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no Ray cluster answers at '127\.0\.0\.1:1'"):
        run(experiment(2), tmp_path, ray="127.0.0.1:1", work=quick)
