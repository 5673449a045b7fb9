"""A real cell's operator is told what to place, labels what came of it, and may always stop."""

import io
import re
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from pliant import store
from pliant.cell import Truth
from pliant.commissioning.attending import Attending, AtTerminal
from pliant.conditions import NOMINAL, Setup
from pliant.console import Console
from pliant.errors import InputError, RobotFault
from pliant.experiment import journal, labels, results, runner, tables
from pliant.experiment.attended import Attended
from pliant.experiment.cells import Experiment
from pliant.experiment.one import Spec
from pliant.experiment.plan import from_fields
from pliant.experiment.rows import Row
from pliant.experiment.runner import Finished
from pliant.experiment.where import Where
from pliant.formations import Formation
from pliant.levels import FIELDS, shipped_levels
from pliant.records import Execution
from pliant.report import trial as report
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import Task

EXAMPLE = Path(str(files("pliant") / "ur5e" / "example.yaml"))
LATER = 500  # control periods of 10 ms: the arm is on its way to Fit
CTRL_C = "ctrl-c"
SLOW = """
import signal
from pliant.reasoners.rules import Rules

class Slow(Rules):
    def recover(self, case, verdict):
        signal.raise_signal(signal.SIGINT)
"""
FAR = {"name": "far", "hole_y_mm": [-20, -20], "grasp_roll_deg": [5, 5]}


class HandSet(SimCell):
    """The simulated cell with what a real one lacks taken away: a person places and labels. Its
    next trial breaks down after `periods` of control; None: it does not."""

    kind = "ur5e"

    def __init__(
        self,
        person: AtTerminal,
        periods: int | None = None,
        fault: str = "protective_stop",
    ) -> None:
        super().__init__()
        self.person, self.periods, self.fault = person, periods, fault
        self.is_dead = False

    def prepare(self, task: Task, setup: Setup) -> SimRobot:
        if self.is_dead:
            raise RobotFault("connection", "the controller does not answer")
        self.person.place(task, setup)
        robot = super().prepare(task, setup)
        robot.watch(self._count_down)
        return robot

    def truth(self) -> Truth:
        return self.person.truth()

    def _count_down(self) -> None:
        if self.periods is not None:
            self.periods -= 1
            if self.periods == 0:
                if self.fault == CTRL_C:
                    signal.raise_signal(signal.SIGINT)
                raise RobotFault(self.fault, "the arm has braked")


class Desk:
    """A person's answers in advance, and all that was shown."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch = monkeypatch
        self.console = Console(file=io.StringIO(), width=200)
        self.person = Attending(self.console)

    def sits_down(self, *answers: str) -> None:
        self._patch.setattr(sys, "stdin", io.StringIO("".join(f"{a}\n" for a in answers)))
        self.person = Attending(self.console)

    @property
    def shown(self) -> str:
        assert isinstance(self.console.file, io.StringIO)
        return self.console.file.getvalue()


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Desk:
    return Desk(monkeypatch)


def experiment(trials: int = 1) -> Experiment:
    names = {"pegs": ["circle"], "conditions": [FAR], "reasoners": ["none"]}
    return replace(from_fields({**names, "trials": trials}), where=Where(file=EXAMPLE))


def attend(desk: Desk, folder: Path, trials: int = 1, **fault: Any) -> Finished:
    plan = experiment(trials)
    cell = HandSet(desk.person, **fault)
    return runner.run(plan, folder, engine=Attended(cell, plan, desk.person))


def recorded(folder: Path) -> list[Row]:
    path = folder / journal.FILE
    return [r.trial for r in journal.rows_at(path, (e.offset for e in journal.scan(path)))]


def inserted(rows: Sequence[Row]) -> dict[int, bool | None]:
    return {row["seed"]: row["inserted"] for row in rows}


def test_the_combination_is_shown_and_the_label_kept(tmp_path: Path, desk: Desk) -> None:
    desk.sits_down("y", "n")
    assert attend(desk, tmp_path).complete
    for words in (
        "circle, held between the fingers",
        "20.0 mm from its nominal place, to the left in the camera's picture (the robot's right)",
        "5.0°, the peg's tip to the right in the camera's picture",
    ):
        assert words in desk.shown
    picture = desk.shown.partition("last picture: ")[2].splitlines()[0]
    assert Path(picture).is_file()
    assert desk.shown.index("Is the peg inserted?") < desk.shown.index("judged not inserted")
    (row,) = results.read_trials(tmp_path).to_pylist()
    assert (row["cell"], row["inserted"], row["failure_kind"]) == ("ur5e", False, "not_inserted")
    assert row["depth_m"] is None
    kept = tmp_path / "trials" / row["trial_id"]
    trial = store.load_trial(kept)
    assert (trial.cell, trial.inserted) == ("ur5e", False)
    assert trial.truths[0].inserted is None
    report.show(kept, trial, None)
    assert (
        "nan"
        not in re.sub("<[^>]*>", " ", (kept / report.PAGE).read_text(encoding="utf-8")).split()
    )


def test_who_stops_or_skips_goes_on_there_later(tmp_path: Path, desk: Desk) -> None:
    desk.sits_down("y", "n", "s", "q")
    first = attend(desk, tmp_path, trials=3)
    assert (first.complete, first.done) == (False, 1)
    assert not (tmp_path / results.TRIALS_FILE).exists()
    desk.sits_down("y", "u", "y", "y")
    again = attend(desk, tmp_path, trials=3)
    assert (again.complete, again.resumed) == (True, 1)
    assert inserted(recorded(tmp_path)) == {1: False, 2: None, 3: True}


def test_a_trial_that_was_broken_off_is_kept_apart_and_done_again(
    tmp_path: Path, desk: Desk
) -> None:
    desk.sits_down("y")
    ended = attend(desk, tmp_path, periods=LATER, fault="interrupted")
    assert (ended.complete, recorded(tmp_path)) == (False, [])
    (kept,) = (tmp_path / "aborted").iterdir()
    assert store.load_trial(kept).end_reason == "fault:interrupted"
    desk.sits_down("y", "y")
    assert attend(desk, tmp_path).complete
    assert inserted(recorded(tmp_path)) == {1: True}


def moving(engine: Attended, folder: Path, spec: Spec) -> None:
    engine.perform(spec, folder)  # Ctrl-C comes on the way to Fit


def thinking(engine: Attended, folder: Path, spec: Spec) -> None:
    own = folder / "slow.py"
    own.write_text(SLOW, encoding="utf-8")
    engine.perform(replace(spec, reasoner=f"{own}:Slow"), folder)


def telling(engine: Attended, folder: Path, spec: Spec) -> None:
    def tell(execution: Execution, truth: Truth) -> None:
        if execution.formation is Formation.FIT:
            signal.raise_signal(signal.SIGINT)

    engine.perform(spec, folder, on_execution=tell)


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Also in a background job, which Ctrl-C does not reach."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize(
    ("during", "executed", "aborted"),
    [(moving, 2, Formation.FIT), (thinking, 2, Formation.FIT), (telling, 3, None)],
)
def test_ctrl_c_keeps_what_was_done_whatever_was_going_on(
    tmp_path: Path,
    desk: Desk,
    monkeypatch: pytest.MonkeyPatch,
    during: Callable[[Attended, Path, Spec], None],
    executed: int,
    aborted: Formation | None,
) -> None:
    desk.sits_down("y")
    left: list[SimRobot] = []

    def leave(robot: SimRobot, *how: object) -> None:
        signal.raise_signal(signal.SIGINT)  # pressed again, in the midst of halting
        left.append(robot)

    monkeypatch.setattr(SimRobot, "__exit__", leave)
    plan = experiment()
    cell = HandSet(desk.person, LATER if during is moving else None, CTRL_C)
    with pytest.raises(KeyboardInterrupt, match="is kept in") as said:
        during(Attended(cell, plan, desk.person), tmp_path, next(plan.specs()))
    (kept,) = (tmp_path / "aborted").iterdir()
    assert f"'{kept}'" in str(said.value)
    trial = store.load_trial(kept)
    assert (trial.end_reason, len(trial.executions)) == ("fault:interrupted", executed)
    assert "Ctrl-C" in trial.fault
    assert left  # so it is halted
    if aborted is None:
        assert trial.aborted is None
    else:
        assert trial.aborted is not None
        assert trial.aborted.step.formation is aborted
        assert (trial.aborted.under_way is None) is (during is thinking)
        assert bool(trial.aborted.motions) is (during is thinking)


def test_a_fault_of_the_cell_is_a_result(tmp_path: Path, desk: Desk) -> None:
    desk.sits_down("y", "n")
    assert attend(desk, tmp_path, periods=LATER).complete
    (row,) = recorded(tmp_path)
    assert (row["end_reason"], row["failure_kind"]) == ("fault:protective_stop", "cell_fault")
    assert "ended by fault:protective_stop: the arm has braked" in desk.shown
    (cell,) = tables.build(tmp_path)["cells"]
    assert (cell["n"], cell["faults"], cell["inserted"]["percent"]) == (1, 0, 0.0)


def test_a_cell_that_cannot_be_prepared_ends_it_without_a_result(
    tmp_path: Path, desk: Desk
) -> None:
    plan = experiment()
    cell = HandSet(desk.person)
    cell.is_dead = True
    with pytest.raises(InputError, match="cannot be prepared: the controller does not answer"):
        runner.run(plan, tmp_path, engine=Attended(cell, plan, desk.person))
    assert recorded(tmp_path) == []


def test_who_leaves_without_a_label_leaves_the_trial_unlabelled(tmp_path: Path, desk: Desk) -> None:
    desk.sits_down("y")  # and nothing more comes
    ended = attend(desk, tmp_path, trials=2)
    assert (ended.complete, ended.done) == (False, 1)
    assert inserted(recorded(tmp_path)) == {1: None}
    assert desk.shown.count("held between the fingers") == 1


def test_a_label_may_be_given_later(tmp_path: Path, desk: Desk) -> None:
    desk.sits_down("y", "u", "y", "u", "y", "y")
    assert attend(desk, tmp_path, trials=3).complete
    desk.sits_down("y")  # and leaves
    assert labels.label(tmp_path, desk.person.label) == (1, 1)
    assert inserted(recorded(tmp_path)) == {1: True, 2: None, 3: True}
    desk.sits_down("n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results, "refresh", sys.exit)  # killed once the journal has the label
        with pytest.raises(SystemExit):
            labels.label(tmp_path, desk.person.label)
    assert inserted(pq.read_table(tmp_path / results.TRIALS_FILE).to_pylist()) == {
        1: True,
        2: None,
        3: True,
    }
    table = results.read_trials(tmp_path).to_pylist()
    assert inserted(table) == inserted(recorded(tmp_path)) == {1: True, 2: False, 3: True}
    assert table[1]["failure_kind"] == "not_inserted"
    (*_, last) = list(results.each_trials_executions(tmp_path))[1]
    assert last["truth_inserted"] is False
    assert attend(desk, tmp_path, trials=3).resumed == 3
    with pytest.raises(InputError, match="name the result folder of"):
        labels.label(tmp_path / "trials", desk.person.label)


def test_a_nominal_combination_is_said_in_words(desk: Desk) -> None:
    desk.sits_down("y")
    desk.person.place(experiment().cells[0].task, Setup(seed=1))
    assert "hole   at its nominal place" in desk.shown
    assert "grasp  straight" in desk.shown


def test_what_nobody_can_set_or_know_at_a_real_cell_is_refused() -> None:
    plan = experiment()
    refused: list[tuple[dict[str, Any], str]] = [
        ({"conditions": ["all"]}, "'all' on level L0 draws friction, which nobody can set"),
        (
            {"reasoners": ["oracle"], "conditions": ["pose"]},
            "the oracle plans from the whole truth",
        ),
        ({"method": "guided"}, "method guided looks with several cameras"),
        *(
            ({"conditions": [{"name": "own", field: [0, 0]}]}, f"level L0 draws {quantity},")
            for field, (quantity, _) in FIELDS.items()
            if quantity not in ("hole_y", "grasp_roll", "struck_at") and not NOMINAL[quantity]
        ),
        *(
            ({"level": level.name}, f"'none' on level {level.name} draws {', '.join(level.ranges)}")
            for level in shipped_levels().values()
            if level.ranges
        ),
    ]
    for changes, message in refused:
        fields = {"pegs": ["circle"], "conditions": ["none"], "reasoners": ["none"], **changes}
        with pytest.raises(InputError, match=re.escape(message)):
            replace(from_fields(fields), where=plan.where)
    tight = {**fields, "level": "L1", "method": "planar"}  # such a block can be screwed on
    assert replace(from_fields(tight), where=plan.where).cells[0].level == "L1"


def test_what_an_emulated_cell_lacks_is_refused_before_it_begins(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(
        f"{EXAMPLE.read_text(encoding='utf-8')}\nemulator: {{admin_port: 30100}}\n",
        encoding="utf-8",
    )
    fields = {"pegs": ["circle"], "conditions": ["all"], "reasoners": ["rules"]}
    emulated = replace(from_fields(fields), where=Where(file=file))
    for changes, message in (
        ({"level": "L3"}, "draws hole_x, board_z, grasp_pitch, board_yaw, which nobody can set"),
        ({"level": "L1", "method": "planar"}, "level L1: an emulated cell has the holes of L0"),
    ):
        with pytest.raises(InputError, match=message):
            replace(from_fields({**fields, **changes}), where=emulated.where)


def test_a_cells_file_is_part_of_what_an_experiment_is(tmp_path: Path) -> None:
    other = tmp_path / "cell.yaml"
    other.write_text(
        EXAMPLE.read_text(encoding="utf-8").replace("stiffness_n_mm: 1.0", "stiffness_n_mm: 1.5"),
        encoding="utf-8",
    )
    real, stiffer = experiment(), replace(experiment(), where=Where(file=other))
    simulated = replace(real, where=Where())
    assert len({e.fingerprint for e in (real, stiffer, simulated)}) == 3
    assert real.document["cell"]["kind"] == "ur5e"
    same = tmp_path / "elsewhere.yaml"
    same.write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    assert replace(real, where=Where(file=same)).fingerprint == real.fingerprint
