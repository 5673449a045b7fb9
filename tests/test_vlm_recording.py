"""`pliant run` with a VLM, recorded and replayed; a shipped recording of a whole trial replays.

`python tests/test_vlm_recording.py` records it anew, as must be when a prompt or a schema changes.
Its trial is told nothing that was measured in a picture, so that its words are the same wherever it
is replayed: the robot's poses differ between machines far below the tenth of a millimetre told.
"""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from loopback import Handler, Loopback, completion, loopback
from test_cli import pliant
from vlm_cases import asked
from voices import NOTHING_WRONG, SpeaksForRules

from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.formations import RECOVERABLE
from pliant.methods.planar import Planar
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.tape import Recorder
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.trial import Run

SHIPPED = Path(__file__).parent / "recordings" / "circle-all-6.jsonl"
SEED = 6
TOLD = Settings(model="scripted", deadline_s=60, picture=False, table_i=False, history=3)
OPTIONS = ("--no-picture", "--no-table-i", "--history", "3")


def record() -> None:
    """A trial in which Fit fails twice, by a model that speaks for the rules."""
    task = load_task("circle")
    taught = shipped().for_task(task)
    run = Run(
        robot=SimCell().prepare(task, condition("all").draw(SEED)),
        task=task,
        teaching=taught,
        reasoner=SpeaksForRules(settings=TOLD, tape=Recorder(SHIPPED)),
        method=Planar(),
    )
    print([f"{e.formation} {e.verdict.success}" for e in run], run.end_reason)


def test_the_shipped_recording_replays_as_a_whole_trial() -> None:
    assert SHIPPED.stat().st_size < 400_000
    task = load_task("circle")
    spec = Spec(task=task, condition=condition("all"), seed=SEED, reasoner="vlm", vlm=TOLD)
    trial = perform(spec, SimCell(), shipped(), replay=SHIPPED)
    assert trial.end_reason == "inserted"
    assert trial.inserted
    assert [e.verdict.success for e in trial.executions] == [True, True, False, False] + [True] * 3
    for execution in trial.executions:
        by = "vlm" if execution.formation in RECOVERABLE else "checks"
        assert (execution.verdict.by, execution.verdict.fallback) == (by, "")
        if execution.recovery is not None:
            assert (execution.recovery.by, execution.recovery.fallback) == ("vlm", "")


# --- the command ---------------------------------------------------------------------------------


def heeds_the_checks(server: Loopback, handler: Handler) -> None:
    """A model that goes by the words it is told: it succeeded where every check says so; else once
    more, a little further, which it says only when asked again; then stop."""
    said = json.dumps(handler.received.body)
    last = said.partition("## Executed last")[2]
    votes = dict(re.findall(r"(pose_check|compression_check|table_i|metric check): (\w+)", last))
    vote = {"success": "success", "failure": "failure"}
    fields: dict[str, Any] = {
        **NOTHING_WRONG,
        "what_happened": "it did not go in",
        "why": "the goal was too short",
        "how_to_recover": "further to the left",
        "wrong_goal": "fit",
        "fit_y_change_mm": -6,
    }
    if asked(said).startswith("judge"):
        fields = {
            "pose_check": vote.get(votes["pose_check"], "not available"),
            "compression_check": vote.get(votes["compression_check"], "not available"),
            "table_i": vote.get(votes.get("table_i", ""), "not available"),
            "picture": vote.get(votes.get("metric check", ""), "not available"),
            "conflict": "",
            "reason": "as the checks say",
            "success": "failure" not in votes.values(),
        }
    elif "plan" in asked(said):
        again = "cannot be done" in said
        fields = {"resume_from": "fit", "retreat_first": False}
        fields |= {"fit_y_change_mm": -6 if again else 90}
        fields |= {"align_y_change_mm": 0, "insertion_z_change_mm": 0}
        if said.count("| failure |") > 0:
            fields["resume_from"] = "stop"
    handler.send(completion(handler.received.body, json.dumps(fields)))


def test_a_run_is_recorded_and_replays_to_the_same_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = "sk-pliant-0123456789"
    monkeypatch.setenv("PLIANT_VLM_KEY", key)
    tape = tmp_path / "tape.jsonl"
    words = ("run", "--reasoner", "vlm", "--seed", "4", "--measurements", "--no-video", "--json")
    with loopback(heeds_the_checks) as server:
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", server.base_url)
        asked = ("--model", "small", "--base-url", server.base_url, "--record", tape)
        first = pliant(*words, *asked, "--out", tmp_path / "first")
    assert first.returncode in (0, 1), first.stderr
    requests = [json.dumps(received.body) for received in server.received]
    assert any("image_url" in request for request in requests)
    assert any("cannot be done" in request for request in requests)
    recorded = json.loads(first.stdout)
    # Nobody listens at the address any more.
    asked = ("--model", "small", "--base-url", server.base_url, "--replay", tape)
    again = pliant(*words, *asked, "--out", tmp_path / "again")
    assert again.returncode == first.returncode, again.stderr
    replayed = json.loads(again.stdout)
    wall = {name for name in recorded if name.endswith("wall_s")}
    for name in sorted(recorded.keys() - wall):
        assert replayed[name] == recorded[name], name
    for path in tmp_path.rglob("*"):
        if path.is_file():
            assert key.encode() not in path.read_bytes(), path
    other = pliant(*words, *asked, "--temperature", "0.5", "--out", tmp_path / "other")
    assert other.returncode == 2
    assert "sampling" in other.stderr
    assert "Traceback" not in other.stderr


def test_the_shipped_recording_replays_from_the_command_line_without_a_model(
    tmp_path: Path,
) -> None:
    words = ("run", "--reasoner", "vlm", "--seed", str(SEED), *OPTIONS, "--no-video")
    done = pliant(*words, "--replay", SHIPPED, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stdout + done.stderr
    broken = tmp_path / "broken.jsonl"
    shutil.copy(SHIPPED, broken)
    broken.write_bytes(broken.read_bytes().replace(b'"success', b'"sucess', 1))
    refused = pliant(*words, "--replay", broken, "--out", tmp_path / "refused")
    assert refused.returncode == 2
    assert re.search(r"line \d+, is broken", refused.stderr)


if __name__ == "__main__":
    record()
