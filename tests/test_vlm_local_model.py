"""`pliant run` against a real server with a real model that is too weak for the work: whatever it
says, every motion stays inside the envelope, the trial ends, and the record says who decided."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from local_model import NAME

from pliant.envelope import Limits
from pliant.pose import Axis
from pliant.records import Exchange, Trial
from pliant.store import load_trial

pytestmark = pytest.mark.system
pytest_plugins = ["local_model"]

ASKED = 6  # requests; then the rules go on: a request takes up to a minute on a busy machine
OPTIONS = ["--seed", "1", "--no-video", "--json", "--reply-tokens", "120", "--deadline-s", "120"]
OPTIONS += [
    "--max-requests",
    str(ASKED),
    "--history",
    "2",
    "--reasoner",
    "vlm",
    "--output",
    "native",
]


def run(out: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).with_name("pliant")), "run", "--out", str(out)]
    return subprocess.run([*command, *OPTIONS, *options], capture_output=True, encoding="utf-8")


def trial_in(out: Path) -> Trial:
    (folder,) = (out / "trials").iterdir()
    return load_trial(folder)


def exchanges(trial: Trial) -> list[Exchange]:
    asked = [e.verdict.exchanges for e in trial.executions]
    asked += [e.recovery.exchanges for e in trial.executions if e.recovery is not None]
    return [exchange for group in asked for exchange in group]


@pytest.fixture(scope="module")
def ran(local_model_url: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("local")
    talk = str(out / "talk.jsonl")
    ended = run(out / "run", "--base-url", local_model_url, "--model", NAME, "--record", talk)
    assert ended.returncode in (0, 1), ended.stderr
    row = json.loads(ended.stdout)
    assert row["model"] == NAME
    return out


def test_the_model_is_shown_pictures_and_its_words_are_kept(ran: Path) -> None:
    asked = exchanges(trial_in(ran / "run"))
    heard = [exchange for exchange in asked if exchange.reply]
    assert len(asked) == ASKED
    assert heard
    assert all(exchange.input_tokens > 500 for exchange in heard)
    assert any(exchange.pictures for exchange in heard)


def test_the_trial_ends_inside_the_envelope_and_says_where_the_rules_stepped_in(ran: Path) -> None:
    trial = trial_in(ran / "run")
    assert trial.end_reason
    assert not trial.end_reason.startswith("fault:")
    limits = Limits()
    for execution in trial.executions:
        for motion in execution.outcome.motions:
            assert limits.outside({axis: motion.commanded[axis] for axis in Axis}) is None
    decided = [e.verdict for e in trial.executions]
    assert any(verdict.fallback for verdict in decided)


def test_the_recorded_trial_replays_without_the_server(ran: Path, tmp_path: Path) -> None:
    ended = run(tmp_path / "again", "--replay", str(ran / "talk.jsonl"))
    assert ended.returncode in (0, 1), ended.stderr
    first, again = trial_in(ran / "run"), trial_in(tmp_path / "again")
    assert [e.verdict.reason for e in again.executions] == [
        e.verdict.reason for e in first.executions
    ]
    assert again.truths == first.truths
