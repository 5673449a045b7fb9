"""Whatever dies, an experiment loses no finished trial, repeats none, and ends the same."""

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant import store
from pliant.console import Console
from pliant.errors import InputError
from pliant.experiment import journal, results, tables
from pliant.experiment.cells import Experiment
from pliant.experiment.columns import EXECUTIONS, schema
from pliant.experiment.holdings import may_hold, prepare
from pliant.experiment.one import perform
from pliant.experiment.plan import from_fields
from pliant.experiment.progress import Shown
from pliant.experiment.rows import Rows, lost, rows_of
from pliant.experiment.runner import Finished, run
from pliant.experiment.work import Job, Save
from pliant.report import summary

HERE = Path(__file__).parent
TRIALS = 40  # per cell
KILLS = 6
EVERY_S = 0.02
KILLED = "exit status -9: it was killed, as happens where memory runs out"


# --- what the workers do: no simulation ----------------------------------------------------------


def quick(job: Job) -> Rows:
    """A made-up trial that depends on its seed alone."""
    time.sleep(EVERY_S)
    rows = lost(job.spec, "made_up", f"seed {job.spec.seed}", 0.0)
    executions = [
        {"trial_id": rows.trial_id, "index": i, "formation": "fit", "verdict": True}
        for i in range(job.spec.seed % 3)
    ]
    trial = {**rows.trial, "inserted": job.spec.seed % 4 > 0, "wall_s": random.random()}
    return Rows(trial=trial, executions=executions)


def troubled(job: Job) -> Rows:
    """Seed 2 kills its worker, seed 3 hangs, seed 4 raises, seed 5 dies the first time only."""
    once = job.folder / "died_once"
    if job.spec.seed == 2 or (job.spec.seed == 5 and not once.exists()):
        if job.spec.seed == 5:
            once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if job.spec.seed == 3:
        time.sleep(60)
    if job.spec.seed == 4:
        raise ZeroDivisionError("by a user's reasoner")
    return quick(job)


def refused(job: Job) -> Rows:
    raise InputError("no OpenGL to draw pictures with")


def line_of(code: str) -> int:
    return 1 + next(
        n
        for n, t in enumerate(Path(__file__).read_text(encoding="utf-8").splitlines())
        if code in t
    )


# --- helpers -------------------------------------------------------------------------------------


def experiment(trials: int = 8, **changes: object) -> Experiment:
    names = {"pegs": ["circle"], "conditions": ["none"], "reasoners": ["rules", "none"]}
    return from_fields({**names, "trials": trials, **changes})


def outcomes(folder: Path) -> tuple[pa.Table, list[object]]:
    trials = results.read_trials(folder).drop_columns(["wall_s"])
    return trials, list(results.each_trials_executions(folder))


def drive(folder: str) -> None:
    """The driver that the tests kill: `python -c "from ... import drive; drive(...)"`."""
    run(experiment(TRIALS), Path(folder), workers=2, work=quick)


def driver(folder: Path) -> "subprocess.Popen[bytes]":
    # A process started in the background may have been told to ignore Ctrl-C.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heed}; from test_experiment_runner import drive; drive({str(folder)!r})"
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": f"{HERE}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
        stdout=subprocess.DEVNULL,
    )


def workers_of(process: "subprocess.Popen[bytes]") -> list[int]:
    """Its spawned workers; not the process that watches shared memory."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    pids = children.read_text(encoding="utf-8").split() if children.exists() else []
    return [int(p) for p in pids if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]


def finished(folder: Path) -> int:
    path = folder / journal.FILE
    return sum(1 for _ in journal.scan(path)) if path.exists() else 0


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    assert run(experiment(TRIALS), folder, workers=1, work=quick).complete
    return folder


# --- behaviour -----------------------------------------------------------------------------------


def test_results_stand_in_canonical_order_whoever_was_first(undisturbed: Path) -> None:
    trials, executions = outcomes(undisturbed)
    assert trials["trial_id"].to_pylist() == [s.trial_id for s in experiment(TRIALS).specs()]
    assert len(executions) == sum(seed % 3 > 0 for seed in range(1, TRIALS + 1)) * 2
    assert pq.read_schema(undisturbed / "executions.parquet").equals(schema(EXECUTIONS))


def test_killed_drivers_and_workers_lose_nothing_and_repeat_nothing(
    tmp_path: Path, undisturbed: Path
) -> None:
    chance = random.Random(1)
    process, kills, before = driver(tmp_path), 0, 0
    deadline = time.monotonic() + 90
    while process.poll() is None or process.returncode != 0:
        assert time.monotonic() < deadline
        if process.poll() is not None:
            process = driver(tmp_path)
        time.sleep(chance.uniform(0.02, 0.25))
        now = finished(tmp_path)
        assert now >= before, "a finished trial was lost"
        started, before = now > before, now
        if not started or kills >= KILLS:
            continue
        workers = workers_of(process)
        whom = chance.choice([*workers, process.pid])
        if process.poll() is None:
            os.kill(whom, signal.SIGKILL)
            kills += 1
            if whom == process.pid:
                process.wait()
    assert kills >= 3
    ours, theirs = outcomes(tmp_path), outcomes(undisturbed)
    assert ours[0].equals(theirs[0])
    assert ours[1] == theirs[1]
    assert finished(tmp_path) == 2 * TRIALS


def test_workers_end_when_their_driver_is_killed(tmp_path: Path) -> None:
    process = driver(tmp_path)
    while finished(tmp_path) < 3:
        time.sleep(0.02)
    workers = workers_of(process)
    process.kill()
    process.wait()
    for _ in range(200):
        if not any(Path(f"/proc/{w}").exists() for w in workers):
            break
        time.sleep(0.02)
    assert workers
    assert not any(Path(f"/proc/{w}").exists() for w in workers)


def test_ctrl_c_keeps_what_is_finished_and_the_same_command_goes_on(
    tmp_path: Path, undisturbed: Path
) -> None:
    process = driver(tmp_path)
    while finished(tmp_path) < 5:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    process.wait(timeout=20)
    done = finished(tmp_path)
    assert process.returncode == 0
    assert 5 <= done < 2 * TRIALS
    assert not (tmp_path / results.TRIALS_FILE).exists()
    again = run(experiment(TRIALS), tmp_path, workers=2, work=quick)
    assert (again.resumed, again.complete) == (done, True)
    assert outcomes(tmp_path)[0].equals(outcomes(undisturbed)[0])


def test_deaths_and_time_outs_are_recorded_after_three_tries_and_block_nobody(
    tmp_path: Path,
) -> None:
    one = experiment(6, reasoners=["rules"])
    done = run(one, tmp_path, workers=2, work=troubled, time_limit_s=0.4)
    assert done == Finished(total=6, done=6, resumed=0, faults=done.faults)
    ends = {r["seed"]: (r["end_reason"], r["fault"]) for r in outcomes(tmp_path)[0].to_pylist()}
    assert ends[2] == ("fault:worker", f"the worker process died ({KILLED}), 3 times")
    assert ends[3] == ("fault:timeout", "the trial took longer than 0.4 s, 3 times")
    where = f"{HERE.name}/{Path(__file__).name}:{line_of('raise ZeroDivisionError')}"
    assert ends[4][0] == "fault:error"
    assert ends[4][1].startswith("ZeroDivisionError: by a user's reasoner (")
    assert ends[4][1].endswith(f"{where})")
    assert done.faults == 3
    assert ends[5][0] == ends[1][0] == "fault:made_up"


def faulting(job: Job) -> Rows:
    """Below a folder named "broken" every trial raises; elsewhere odd seeds, until it is mended."""
    odd, mended = job.spec.seed % 2, (job.folder / "mended").exists()
    if not job.only_try and (job.folder.name == "broken" or (odd and not mended)):
        raise ZeroDivisionError(f"seed {job.spec.seed}")
    return quick(job)


def test_first_trials_that_are_all_the_same_fault_end_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    stopped = "first 3 trials were all the same fault: fault:error: ZeroDivisionError: seed"
    with pytest.raises(InputError, match=stopped):
        run(experiment(), folder, workers=1, work=faulting)
    assert [e.fault != "" for e in journal.scan(folder / journal.FILE)] == [True] * 3
    with pytest.raises(InputError, match="first 1 trials"):
        run(experiment(1, reasoners=["rules"]), tmp_path / "one" / "broken", work=faulting)


def test_what_is_advised_about_faults_works_also_with_a_reasoner_of_ones_own(
    tmp_path: Path,
) -> None:
    mine = tmp_path / "mine.py"
    text = "from pliant.reasoners.rules import Rules\n\n\nclass Mine(Rules):\n    pass\n"
    mine.write_text(text, encoding="utf-8")

    def performed(name: str, *, own: bool, again: bool = False) -> None:
        who = [f"{mine}:Mine"] if own else ["rules"]
        run(experiment(2, reasoners=who), tmp_path / name, workers=1, work=faulting, again=again)

    with pytest.raises(InputError, match="; mend the cause, and the same command with --again"):
        performed("rules/broken", own=False)
    with pytest.raises(InputError, match=r"a change to a file of your own .* another folder"):
        performed("mine/broken", own=True)
    mine.write_text(f"{text}# mended\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"the file of reasoner 'mine\.py:Mine' differ"):
        performed("mine/broken", own=True, again=True)
    performed("another", own=True)


def test_a_resumed_run_names_its_faults_and_repeats_them_and_no_others_when_told(
    tmp_path: Path,
) -> None:
    console = Console(record=True, width=200, file=StringIO())
    plan = experiment(3, reasoners=["rules"])

    def again(again: bool = False) -> Finished:
        shown = Shown(plan, console)
        return run(plan, tmp_path, workers=1, work=faulting, watcher=shown, again=again)

    assert again() == Finished(total=3, done=3, resumed=0, faults=2)
    before = (tmp_path / journal.FILE).read_bytes().splitlines()
    assert again() == Finished(total=3, done=3, resumed=3, faults=2)
    assert (tmp_path / journal.FILE).read_bytes().splitlines() == before
    (tmp_path / "mended").touch()
    assert again(again=True) == Finished(total=3, done=3, resumed=1, faults=0)
    after = (tmp_path / journal.FILE).read_bytes().splitlines()
    assert [a == b for a, b in zip(after, before, strict=True)] == [False, True, False]
    trials = outcomes(tmp_path)[0]
    assert trials["trial_id"].to_pylist() == [s.trial_id for s in plan.specs()]
    assert trials["end_reason"].to_pylist() == ["fault:made_up"] * 3
    said = console.export_text()
    assert "3 of 3 trials, 1 inserted, 2 faults" in said
    assert "2 faults among them: --again faults repeats such trials" in said
    assert "fault:error: ZeroDivisionError: seed 1 (" in said


def test_finished_trials_whose_record_was_not_kept_are_counted_when_it_is_asked_for(
    tmp_path: Path,
) -> None:
    plan = experiment(8, reasoners=["rules"])  # seeds 4 and 8 are not inserted
    run(plan, tmp_path, workers=1, work=quick)

    def said(save: Save) -> str:
        console = Console(record=True, width=200, file=StringIO())
        run(plan, tmp_path, workers=1, work=quick, save=save, watcher=Shown(plan, console))
        return console.export_text()

    assert "8 finished trials have no record, which --save all keeps only of" in said(Save.ALL)
    assert "2 finished trials have no record, which --save fail" in said(Save.FAILURES)
    assert "no record" not in said(Save.NONE)
    for spec in plan.specs():
        kept = store.trial_folder(tmp_path, spec.trial_id)
        kept.mkdir(parents=True)
        (kept / store.TRIAL).touch()
    assert "no record" not in said(Save.ALL)


def test_what_the_workers_cannot_do_at_all_is_said_before_the_first_trial(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no trial can be performed here: .* \(exit status 9\)"):
        run(experiment(), tmp_path, workers=1, work=dead)
    assert finished(tmp_path) == 0


def dead(job: Job) -> Rows:
    os._exit(9)


def test_what_every_trial_would_meet_ends_the_run_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no OpenGL"):
        run(experiment(), tmp_path, workers=1, work=refused)


def test_a_script_without_its_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from pathlib import Path\n"
        "from pliant.experiment.plan import from_fields\n"
        "from pliant.experiment.runner import run\n"
        "names = {'pegs': ['circle'], 'conditions': ['none'], 'reasoners': ['rules']}\n"
        f"run(from_fields(names), Path({str(tmp_path / 'out')!r}), workers=2)\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, encoding="utf-8", check=False
    )
    assert done.returncode == 1
    assert "worker processes die as they start" in done.stderr


def test_a_folder_of_another_configuration_is_refused(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    text = """from pliant.reasoners.rules import Rules


class Mine(Rules):
    name = "mine"
"""
    mine.write_text(text, encoding="utf-8")
    folder = tmp_path / "out"
    named = {
        "reasoners": ["rules", f"{mine}:Mine"],
        "conditions": [{"name": "far", "hole_y_mm": [1, 2]}],
    }
    run(experiment(2, **named), folder, workers=1, work=quick)
    far = {"name": "far", "hole_y_mm": [1, 3]}
    with pytest.raises(InputError, match=r"another configuration \(condition 'far' differ\)"):
        run(experiment(2, **{**named, "conditions": [far]}), folder, work=quick)
    with pytest.raises(InputError, match="holds the seeds 1 to 2, and 9 to 10 would leave a gap"):
        run(experiment(2, **named, first_seed=9), folder, work=quick)
    mine.write_text(f"{text}    more = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"the file of reasoner 'mine\.py:Mine' differ"):
        run(experiment(2, **named), folder, work=quick)
    stranger = tmp_path / "notes"
    stranger.mkdir()
    (stranger / "shopping.txt").touch()
    with pytest.raises(InputError, match="holds something else"):
        run(experiment(2), stranger, work=quick)


GROWTH = {
    "more trials": {"trials": 5},
    "earlier seeds": {"trials": 4, "first_seed": 1},
    "another peg": {"pegs": ["square", "circle"]},
    "another reasoner": {"reasoners": ["retry"]},
    "another condition with more trials": {"conditions": ["pose"], "trials": 4},
}


@pytest.mark.parametrize("change", GROWTH.values(), ids=list(GROWTH))
def test_an_experiment_grows_and_repeats_nothing(tmp_path: Path, change: dict[str, Any]) -> None:
    small = experiment(2, first_seed=3)
    run(small, tmp_path, workers=1, work=quick)
    first = results.read_trials(tmp_path).to_pylist()
    larger = experiment(**{"trials": 2, "first_seed": 3, **change})
    new = {spec.trial_id for spec in larger.specs()} - {row["trial_id"] for row in first}
    ended = run(larger, tmp_path, workers=1, work=quick)
    assert (ended.complete, ended.total) == (True, len(larger))
    assert ended.done - ended.resumed == len(new) > 0
    rows = results.read_trials(tmp_path).to_pylist()
    assert [row for row in rows if row["trial_id"] not in new] == first  # also their wall time
    assert {row["trial_id"] for row in rows} == new | {row["trial_id"] for row in first}
    assert summary.read(tmp_path).planned == len(rows)


def test_one_that_asks_for_less_shows_a_part_and_the_rest_stays(tmp_path: Path) -> None:
    run(experiment(4), tmp_path, workers=1, work=quick)
    before = outcomes(tmp_path)
    part = experiment(2, reasoners=["rules"])
    ended = run(part, tmp_path, workers=1, work=quick)
    assert (ended.total, ended.resumed) == (2, 2)
    assert outcomes(tmp_path) == before
    ids = {spec.trial_id for spec in part.specs()}
    (cell,) = tables.build(tmp_path, ids)["cells"]
    assert (cell["reasoner"], cell["n"] + cell["faults"]) == ("rules", 2)


def test_while_it_grows_the_results_are_those_that_there_are(tmp_path: Path) -> None:
    run(experiment(2), tmp_path, workers=1, work=quick)
    prepare(experiment(3), tmp_path, grows=True)  # and is killed
    so_far = summary.read(tmp_path)
    assert (len(so_far.trials), so_far.planned) == (4, 6)
    assert run(experiment(3), tmp_path, workers=1, work=quick).resumed == 4


def test_a_journal_that_cannot_be_right_is_refused_with_what_to_do(tmp_path: Path) -> None:
    run(experiment(2), tmp_path, workers=1, work=quick)
    path = tmp_path / journal.FILE
    good = path.read_bytes()
    first = good.splitlines(keepends=True)[0]
    stray = journal.encoded(quick(job_of(experiment(3), seed=3, folder=tmp_path)))
    for content, message in (
        (good + first, "twice: delete one"),
        (good + stray, "not of this experiment"),
        (good.replace(b"made_up", b"made_ub", 1), "line 1 .* damaged"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            run(experiment(2), tmp_path, workers=1, work=quick)
    path.write_bytes(good[:-5])
    assert run(experiment(2), tmp_path, workers=1, work=quick).resumed == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"workers": 0}, "workers is 0"),
        ({"time_limit_s": 0.0}, "time limit is 0 s"),
        ({"ray": "127.0.0.1:1"}, "Ray is not installed|no Ray cluster answers"),
    ],
)
def test_options_that_cannot_be_are_refused(
    tmp_path: Path, options: dict[str, int], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run(experiment(), tmp_path, work=quick, **options)  # type: ignore[arg-type]


def test_progress_is_shown_with_or_without_a_terminal(tmp_path: Path) -> None:
    for terminal in (False, True):
        console = Console(record=True, force_terminal=terminal, width=100, file=StringIO())
        watcher = Shown(experiment(4), console)
        run(experiment(4), tmp_path / str(terminal), workers=1, work=quick, watcher=watcher)
        assert "8 of 8 trials, 6 inserted" in console.export_text()


def test_two_workers_and_one_process_simulate_the_same_trials(tmp_path: Path) -> None:
    plan = from_fields(
        {"pegs": ["circle"], "conditions": ["all"], "reasoners": ["rules", "none"], "trials": 2}
    )
    assert run(plan, tmp_path, workers=2, save=Save.FAILURES).faults == 0
    from pliant.sim.cell import SimCell  # not above: every made-up worker would wait for MuJoCo

    cell = SimCell()
    alone = [rows_of(perform(spec, cell, plan.teaching())) for spec in plan.specs()]
    simulated, _ = outcomes(tmp_path)
    for ours, theirs in zip(simulated.to_pylist(), alone, strict=True):
        assert {**ours, "wall_s": theirs.trial["wall_s"]} == theirs.trial
    failed = [r.trial_id for r in alone if r.failed]
    assert sorted(p.name for p in (tmp_path / "trials").iterdir()) == sorted(failed)
    for name in failed:
        kept = store.load_trial(tmp_path / "trials" / name)
        assert (kept.trial_id, kept.judged and kept.inserted) == (name, False)
        assert (tmp_path / "trials" / name / "trajectory.npz").is_file()


def test_of_two_runs_that_start_together_one_gets_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, refusals = store.write_run_json, []

    def together(folder: Path, **content: Any) -> None:
        for other in (experiment(first_seed=99), experiment()):
            with pytest.raises(InputError) as refused:
                prepare(other, folder)
            refusals.append(str(refused.value))
        write(folder, **content)

    monkeypatch.setattr(store, "write_run_json", together)
    prepare(experiment(), tmp_path)
    assert all("another experiment is writing to" in said for said in refusals)
    with pytest.raises(InputError, match="would leave a gap"):
        prepare(experiment(first_seed=99), tmp_path)
    with pytest.raises(InputError, match="holds another trial"):
        prepare(experiment(9), tmp_path)
    prepare(experiment(), tmp_path)


def test_a_run_that_was_killed_before_it_began_leaves_a_folder_that_can_be_used(
    tmp_path: Path,
) -> None:
    (tmp_path / journal.FILE).touch()
    assert may_hold(experiment(), tmp_path)
    prepare(experiment(), tmp_path)
    (tmp_path / store.RUN).unlink()
    (tmp_path / journal.FILE).write_text("somebody's\n", encoding="utf-8")
    with pytest.raises(InputError, match="holds something else"):
        prepare(experiment(), tmp_path)


def job_of(plan: Experiment, *, seed: int, folder: Path) -> Job:
    return Job(spec=replace(plan.cells[0], seed=seed), goals=None, folder=folder, save=Save.NONE)
