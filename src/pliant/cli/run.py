"""`pliant run`: one insertion, shown as it happens, stored as an experiment of one trial."""

import json as json_format
import math
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import chain, count
from mmap import mmap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.text import Text

from pliant import store
from pliant.cell import Truth
from pliant.cli import rehearse
from pliant.cli.cells import attended, where_trials_are
from pliant.cli.model import UNDECIDED, ModelOptions
from pliant.cli.ranges import Ranges
from pliant.cli.steps import counted
from pliant.console import Lasting, say
from pliant.errors import InputError, PliantError, described
from pliant.experiment import faults, holdings, journal, plan, results
from pliant.experiment.cells import WHOLE, Experiment
from pliant.experiment.measures import is_undecided, model_share
from pliant.experiment.one import Spec, perform, whole
from pliant.experiment.rows import decided, exchanges, rows_of
from pliant.experiment.work import attempt
from pliant.paths import located, shown
from pliant.pose import describe
from pliant.reasoners import vlm
from pliant.records import Execution, Trial
from pliant.repeats import of_which, repeats

if TYPE_CHECKING:
    from pliant.sim.cell import SimCell, Trajectory

_SPARE = 1 << 28  # [bytes] that must be left: a copy has fewer threads
_TRY_S = 120  # of a trial's first picture, however slow the machine
_LOUD = "bold #b35900"
_SUCCESS, _FAILURE = "#117733", "#882255"  # the paper's green and purple


def run(
    *,
    peg: str = "circle",
    condition: str = "all",
    seed: int = 1,
    reasoner: str = "rules",
    level: str = "L0",
    method: str | None = None,
    goals: Path | None = None,
    cell: str = "sim",
    out: Path | None = None,
    video: bool = True,
    json: bool = False,
    live: bool = False,
    dry_run: bool = False,
    air: bool = False,
    ranges: Annotated[Ranges, tyro.conf.arg(name="")] = Ranges(),  # noqa: B008
    model: Annotated[ModelOptions, tyro.conf.arg(name="")] = ModelOptions(),  # noqa: B008
) -> int:
    """Run one insertion and write its result folder.

    Args:
        peg: circle, square, rectangle, or the path of a peg file (.yaml).
        condition: none, friction, pose or all: what is drawn at random.
        seed: decides every drawn quantity.
        reasoner: rules, messages, sweep, retry, none, oracle, vlm or file.py:Class.
        level: L0 (the paper's grid) to L9, or a scenario such as wrong_peg.
        method: planar, guided, guided-ease (no ease), file.py:Class; default the level's.
        goals: a taught goals file in place of the cell's or the shipped one.
        cell: sim, a cell's file (.yaml) or file.py:Class; a real one asks you.
        out: the result folder; default runs/ and the trial's name.
        video: then draw the trial as an MP4; simulated cell only.
        json: print one line of JSON, the columns of trials.parquet, and no more.
        live: watch in MuJoCo's viewer; needs a screen, and the simulated cell.
        dry_run: only print every motion that the trial could command.
        air: only run the nominal plan above the board: is the way free?
        ranges: ranges in place of the condition's own.
        model: the model behind the reasoner vlm.
    """
    whole("--seed", seed, *WHOLE["first_seed"])
    if dry_run and air:
        raise InputError("--dry-run and --air are two ways to rehearse: leave one of them out")
    out, model = None if out is None else located(out), model.placed()
    fields = {
        "pegs": peg,
        "conditions": [ranges.applied_to(condition)],
        "reasoners": reasoner,
        "level": level,
        "method": method,
        "trials": 1,
        "first_seed": seed,
        "goals": None if goals is None else str(goals),
        "vlm": model.given,
    }
    planned = plan.from_fields(fields, unnamed=model.unnamed)
    experiment = replace(planned, where=where_trials_are(cell))
    is_simulated = experiment.where.is_simulated
    if live and not is_simulated:
        raise InputError("--live shows the simulated cell: leave it out, or --cell")
    model.check(experiment)
    spec = next(experiment.specs())
    if spec.vlm is not None:  # refuses a missing key or a broken recording before it begins
        vlm(spec.vlm, replay=model.replay)
    teaching = experiment.teaching()
    if dry_run:
        return rehearse.dry_run(experiment.where, spec.task, teaching)
    if air:
        return rehearse.air_run(experiment.where, spec.task, teaching)
    from pliant.report import trial as report

    folder = out or _free_folder(experiment, located("runs") / spec.trial_id)
    teller = _Teller(Lasting(stderr=json, highlight=False, soft_wrap=True))
    if spec.vlm is not None:
        model.refuse_silent(spec.vlm, teller.say)
    trajectory = None
    page = store.trial_folder(folder, spec.trial_id)
    if is_simulated:
        replaced = _replaced(page, video=video)
        trial, trajectory = _simulated(experiment, spec, folder, teller, model, replaced, live=live)
    else:
        trial = _attended(experiment, spec, folder, teller, model)
    video = video and trajectory is not None
    with counted("drawing the video") as steps:
        report.write(page, trial, teaching, trajectory=trajectory, video=video, progress=steps.tell)
    teller.end(trial, page / report.PAGE)
    if json:
        say(json_format.dumps(rows_of(trial).trial))
    teller.console.check()
    if faults.is_unmeasured(trial.end_reason):
        return 2
    if is_undecided(model_share([rows_of(trial).trial])):
        return UNDECIDED
    return 0 if _is_done(trial) else 1


def _free_folder(experiment: Experiment, folder: Path) -> Path:
    """The folder, or the first of its numbered sisters that holds no other configuration: what was
    run before the goals, the code or a reasoner's file changed is kept."""
    sisters = (folder.with_name(f"{folder.name}.{n}") for n in count(2))
    return next(f for f in chain([folder], sisters) if holdings.may_hold(experiment, f))


def _replaced(page: Path, *, video: bool) -> str:
    """A sentence on what this trial's folder holds already and the run makes again; "" where it
    holds no page."""
    from pliant.report.trial import PAGE, VIDEO

    if not (page / PAGE).is_file():
        return ""
    if not (page / VIDEO).is_file():
        return f"made again: replaces the page in '{shown(page)}'"
    if video:
        return f"made again: replaces the page and the video in '{shown(page)}'"
    return f"made again: replaces the page in '{shown(page)}' and removes its video (--no-video)"


def _simulated(
    experiment: Experiment,
    spec: Spec,
    folder: Path,
    teller: "_Teller",
    model: ModelOptions,
    replaced: str,
    *,
    live: bool,
) -> "tuple[Trial, Trajectory]":
    from pliant.sim.cell import SimCell

    if _is_memory_limited():
        _try_apart(spec)
    cell = SimCell()
    attempt(cell, spec)
    if live:
        _watch(cell)
    with _opened(experiment, folder) as book:
        if replaced:
            teller.say(replaced)
        teller.begin(spec)
        trial = perform(
            spec,
            cell,
            experiment.teaching(),
            on_execution=teller.tell,
            record=model.record,
            replay=model.replay,
        )
        _store(folder, book, trial)
    return trial, cell.trajectory()


def _attended(
    experiment: Experiment, spec: Spec, folder: Path, teller: "_Teller", model: ModelOptions
) -> Trial:
    """Run the trial in a real or an emulated cell, where no two trials are the same."""
    with attended(experiment, one_trial=True) as engine, _opened(experiment, folder) as book:
        if any(not entry.fault for entry in journal.scan(book.path)):
            raise InputError(f"'{folder}' holds this trial already: choose another folder (--out)")
        store.set_apart(folder, spec.trial_id)
        teller.begin(spec)
        try:
            trial = engine.perform(
                spec,
                folder,
                record=model.record,
                replay=model.replay,
                on_execution=teller.tell,
            )
        except PliantError:
            raise
        except Exception as error:  # a user's cell may raise anything
            if experiment.where.own is None:
                raise
            raise InputError(f"cell '{experiment.where.own}' failed: {described(error)}") from error
        assert trial is not None, "a single trial cannot be left for later"
        _store(folder, book, trial)
    return trial


def _is_done(trial: Trial) -> bool:
    return trial.judged if trial.inserted is None else trial.inserted


@contextmanager
def _opened(experiment: Experiment, folder: Path) -> Iterator[journal.Journal]:
    """The run's folder and journal as a context, made and tried before anything moves."""
    holdings.prepare(experiment, folder)
    with journal.Journal(folder / journal.FILE) as book:
        yield book


def _store(folder: Path, book: journal.Journal, trial: Trial) -> None:
    """Write the journal and Parquet files of an experiment of one trial; simulating it again
    changes nothing but the wall time, so the first line stays, unless nothing was measured then."""
    rows = rows_of(trial)
    before = {entry.trial_id: entry.fault for entry in journal.scan(book.path)}
    if trial.trial_id not in before:
        book.append(rows)
    elif before[trial.trial_id]:
        book.replace(rows)
    results.write_rows(folder, [rows])


def _is_memory_limited() -> bool:
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def _try_apart(spec: Spec) -> None:
    """Let a copy of this process try what the trial needs: OpenGL crashes where memory is short.

    Raises:
        InputError: the copy died of it.
    """
    from pliant.sim.cell import SimCell

    copy = os.fork()
    if copy == 0:
        signal.alarm(_TRY_S)
        with suppress(BaseException):
            _ = mmap(-1, _SPARE)
            attempt(SimCell(), spec)
            os._exit(0)
        os._exit(1)
    _, status = os.waitpid(copy, 0)
    if status != 0:
        raise InputError(
            "nothing can be simulated or drawn in so little memory (exit status"
            f" {os.waitstatus_to_exitcode(status)} of a process that tried): raise the limit"
            " (ulimit -v)"
        )


def _watch(cell: "SimCell") -> None:
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise InputError("--live needs a screen, and DISPLAY is not set: run without --live")
    cell.show()


@dataclass(frozen=True)
class _Teller:
    """Tell what happens in a trial, a line per skill, and what was thought about a failure."""

    console: Lasting
    told: list[Execution] = field(default_factory=list)

    def say(self, text: str) -> None:
        self.console.print(Text(text))

    def begin(self, spec: Spec) -> None:
        self.say(
            f"{spec.task.peg.name} peg, condition {spec.condition.name}, seed {spec.seed},"
            f" {spec.reasoner_name}"
        )

    def tell(self, execution: Execution, truth: Truth) -> None:
        outcome, verdict = execution.outcome, execution.verdict
        mark, colour = ("success", _SUCCESS) if verdict.success else ("failure", _FAILURE)
        how = " after a retreat" if outcome.step.retreat else ""
        line = Text(f"{execution.index + 1:3d} ")
        line.append(f"{outcome.step.formation:<9}", style=f"bold {colour}")
        line.append(f" to {describe(outcome.step.goal)}{how}: {outcome.stop}, ")
        line.append(mark, style=f"bold {colour}")
        line.append(f" ({verdict.reason})")
        if verdict.conflict:
            line.append(f"; {verdict.conflict}")
        self.told.append(execution)
        if (repeat := repeats(self.told)[-1]) is not None:
            line.append(f"; {repeat}")
        self.console.print(line)
        self._instead("judged", verdict.fallback)
        for probed in execution.probes:
            self.say(f"      probe {probed}")
        if execution.recovery is not None:
            if silent := execution.recovery.no_answer_about_probes:
                self._loud(f"      no usable answer, when asked whether it needs a probe: {silent}")
            self._instead("planned", execution.recovery.fallback)
            if execution.recovery.clamped is not None:
                self._loud("      the model's plan was cut down to what may be done")
            analysis = execution.recovery.analysis
            self.say(f"      what  {analysis.what}")
            self.say(f"      why   {analysis.why}")
            self.say(f"      how   {analysis.how}")
        if execution.admission is not None:
            for refusal in execution.admission.refusals:
                self.say(f"      refused  {refusal}")

    def _instead(self, did: str, why: str) -> None:
        """Say that the rules decided, where they did."""
        if why:
            self._loud(f"      the rules {did} in the model's place: {why}")

    def _loud(self, text: str) -> None:
        self.console.print(Text(text, style=_LOUD))

    def end(self, trial: Trial, page: Path) -> None:
        judged = f"judged {'yes' if trial.judged else 'no'}"
        if trial.inserted is None:
            by = "as judged; there is no ground truth"
            inserted = trial.judged
        elif math.isfinite(depth := trial.truths[-1].depth_m):
            by = f"ground truth: {depth * 1e3:.1f} mm deep; {judged}"
            inserted = trial.inserted
        else:
            by = f"as labelled; {judged}"
            inserted = trial.inserted
        notes = Counter(x.note for e in trial.executions for x in exchanges(e) if x.note)
        for note, times in notes.items():
            self.say(f"{times} of the requests to the model: {note}")
        during = f" during {trial.aborted.step.formation}" if trial.aborted is not None else ""
        fault = f"{during} ({trial.fault})" if trial.fault else ""
        moves = sum(len(e.motions) for e in trial.executions)
        moves += 0 if trial.aborted is None else len(trial.aborted.motions)
        if faults.is_unmeasured(trial.end_reason):
            line = Text("no result", style="bold")
            by = f"{trial.end_reason}{during}: {trial.fault}"
        else:
            line = Text("inserted" if inserted else "not inserted", style="bold")
        line.append(f" ({by})", style="not bold")
        self.console.print(line)
        believed = trial.diagnosis
        if believed is not None and not believed.is_as_told:
            why = f": {believed.why}" if believed.why else ""
            self._loud(f"not as the task says: {believed}{why}")
        executions = f"{len(trial.executions)} executions{of_which(trial.executions)}"
        self.say(
            f"{trial.end_reason}{fault}: {executions}, {moves} motion{'' if moves == 1 else 's'},"
            f" {trial.simulated_s:.1f} s of robot time, {trial.wall_s:.1f} s of yours"
        )
        self.say(f"page: {shown(page)}")
        row = rows_of(trial).trial
        if told := decided(row):
            (self.say if row["own"] == row["decisions"] else self._loud)(told)
