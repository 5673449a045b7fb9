"""One trial in a workcell, with the truth sampled beside it after every execution."""

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pliant import conditions, signals
from pliant.cell import Robot, Truth, Workcell
from pliant.conditions import Condition, Setup
from pliant.envelope import Limits
from pliant.errors import InputError, RobotFault
from pliant.experiment import faults
from pliant.experiment.misread import Misread
from pliant.experiment.oracle import NAME, Oracle
from pliant.levels import EDGES, load_level
from pliant.methods.named import method as method_named
from pliant.own import short_name
from pliant.reasoners import reasoner, vlm
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Execution, Trial
from pliant.recovery import Reasoner
from pliant.task import Task, load_task, on_level
from pliant.teaching import Teaching, shipped
from pliant.trial import Patience, Run
from pliant.vision.measure import SIMULATED, Colours

MOST_SEED = 2**32
INTERRUPTED = "fault:interrupted"
"""The end reason of a trial that the person stops."""


@dataclass(frozen=True, kw_only=True)
class Spec:
    """A trial's specification: everything that decides its outcome. `reasoner` is a name of
    `reasoners`, or a user's file with its folder; with `vlm` it is what this model with these
    settings is called. `method` is a name of `methods`, or a user's file likewise. `level` is the
    rung or the scenario that the task's hole and depth are of.

    Raises:
        InputError: no level has that name, or the task is on another.
    """

    task: Task
    condition: Condition
    seed: int
    reasoner: str
    level: str = "L0"
    vlm: Settings | None = None
    method: str = "planar"

    def __post_init__(self) -> None:
        if on_level(self.task, load_level(self.level)) != self.task:
            raise InputError(
                f"level {self.level} has another hole or depth than the task, which goes"
                f" {self.task.depth * 1e3:g} mm deep with {self.task.hole.clearance * 1e3:g} mm of"
                " play: name the level that the task was made for"
            )

    @classmethod
    def named(
        cls,
        *,
        peg: str = "circle",
        level: str = "L0",
        condition: str | Condition = "all",
        seed: int = 1,
        method: str | None = None,
        reasoner: str = "rules",
    ) -> Self:
        """The specification of the trial that these names say. `peg` may be a peg file, `method`
        None is the level's, and what the level draws is added to the condition.

        Raises:
            InputError: a name is unknown, or the peg file cannot be used.
        """
        for what, value in (("peg", peg), ("level", level), ("reasoner", reasoner)):
            if not isinstance(value, str):
                raise InputError(f"{what} is {value!r}: it must be a name")
        if not (method is None or isinstance(method, str)):
            raise InputError(f"method is {method!r}: it must be a name")
        whole("seed", seed, 0, MOST_SEED)
        rung = load_level(level)
        drawn = condition if isinstance(condition, Condition) else conditions.condition(condition)
        return cls(
            task=load_task(peg, level),
            level=level,
            condition=rung.on(drawn),
            seed=seed,
            method=rung.method if method is None else method,
            reasoner=reasoner,
        )

    @property
    def reasoner_name(self) -> str:
        """The reasoner's name in results: that of a user's file without its folder."""
        return self.reasoner if self.vlm is not None else short_name(self.reasoner)

    @property
    def names(self) -> tuple[str, str, str, str]:
        """(level, peg, condition, reasoner), as in the result's columns."""
        return self.level, self.task.peg.name, self.condition.name, self.reasoner_name

    @property
    def trial_id(self) -> str:
        return trial_id(self.names, self.seed)

    def trial(self, **done: Any) -> Trial:
        """The record of the trial, with what came of it."""
        return Trial(
            trial_id=self.trial_id,
            task=self.task,
            level=self.level,
            condition=self.condition.name,
            seed=self.seed,
            reasoner=self.reasoner_name,
            method=short_name(self.method),
            drawn=self.condition.draw(self.seed).quantities(),
            **done,
        )


def whole(name: str, value: Any, least: int, most: int) -> None:
    """Check a number. Raises InputError where it is no whole number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InputError(f"{name} is {value!r}: it must be a whole number from {least} to {most}")


def trial_id(names: tuple[str, str, str, str], seed: int) -> str:
    """The name of a trial, which can be a folder's: (level, peg, condition, reasoner), and seed."""
    return "-".join(_file_name(str(n)) for n in (*names, seed))


def run(
    *,
    peg: str = "circle",
    level: str = "L0",
    condition: str | Condition = "all",
    seed: int = 1,
    method: str | None = None,
    reasoner: str = "rules",
    cell: Workcell | None = None,
) -> Trial:
    """Run one insertion, from its names, as `pliant run` does it. `cell` None: a simulated cell;
    one that is given to several trials is compiled once.

    Raises:
        InputError: a name is unknown, a file that it says cannot be used, or the seed is no whole
            number from 0 to 2**32.
    """
    spec = Spec.named(
        peg=peg, level=level, condition=condition, seed=seed, method=method, reasoner=reasoner
    )
    if cell is None:
        from pliant.sim.cell import SimCell

        cell = SimCell()
    return perform(spec, cell, shipped())


def perform(
    spec: Spec,
    cell: Workcell,
    teaching: Teaching,
    *,
    limits: Limits | None = None,
    colours: Colours = SIMULATED,
    on_execution: Callable[[Execution, Truth], None] | None = None,
    record: Path | None = None,
    replay: Path | None = None,
) -> Trial:
    """Run a trial to its end. The truth goes into the record, never to the reasoner. A cell that
    cannot even be prepared gives a trial without executions; a reasoner that raises something ends
    it as the fault "reasoner", with what was done until then. A VLM's conversations are kept in the
    file `record`, or answered from the file `replay`.

    Ctrl-C or its like (`pliant.signals`) ends a trial in a real or an emulated cell as the fault
    "interrupted", whatever was going on; a simulated one, which can be repeated exactly, is left.

    Raises:
        InputError: the reasoner cannot be made, or a recording cannot be used.
        KeyboardInterrupt: in a simulated cell, or in one that was not prepared yet.
    """
    started = time.perf_counter()
    setup = spec.condition.draw(spec.seed)
    limits = limits or Limits()
    mind = _reasoner(spec, cell, setup, limits, record, replay)
    teaching = teaching.for_task(spec.task)
    history: list[Execution] = []
    truths: list[Truth] = []
    simulated_s, aborted = 0.0, None
    try:
        robot = cell.prepare(spec.task, setup)
    except RobotFault as fault:
        end_reason, why = fault.end_reason, str(fault)
    else:
        heeded = faults.Heeded(inner=mind)
        run = composed(spec, robot, setup, teaching, heeded, limits=limits, colours=colours)
        try:
            with closing(iter(run)) as executions:  # left early, it halts the robot
                for execution in executions:
                    truths.append(cell.truth())
                    if on_execution is not None:
                        on_execution(execution, truths[-1])
        except faults.ReasonerFault as fault:
            run.end_reason, run.fault = f"{faults.PREFIX}{faults.REASONER}", str(fault)
        except KeyboardInterrupt:
            if cell.kind == "sim":
                raise
            run.end_reason = INTERRUPTED
            run.fault = str(signals.interrupted())
        history, simulated_s = run.history, run.clock_s
        end_reason, why, aborted = run.end_reason, run.fault, run.aborted
    return spec.trial(
        model=getattr(mind, "model", None),
        goals=teaching.goals,
        executions=tuple(history),
        end_reason=end_reason,
        fault=why,
        simulated_s=simulated_s,
        wall_s=time.perf_counter() - started,
        truths=tuple(truths),
        aborted=aborted,
        cell=cell.kind,
        limits=limits,
    )


def composed(
    spec: Spec,
    robot: Robot,
    setup: Setup,
    teaching: Teaching,
    mind: Reasoner,
    *,
    limits: Limits | None = None,
    colours: Colours = SIMULATED,
    patience: Patience | None = None,
) -> Run:
    """The loop of a trial, with the sight that its level asks for. `robot` is
    prepared with `setup`, and `teaching` is for the task. Of the setup and the level nothing is in
    the loop but through what is sensed."""
    way = method_named(spec.method)
    known = None if load_level(spec.level).senses == EDGES else colours
    return Run(
        robot=robot,
        task=spec.task,
        teaching=teaching,
        reasoner=mind,
        method=way,
        limits=limits or Limits(),
        patience=patience or Patience(),
        sight=Misread(way.sight(spec.task, teaching, known), setup),
    )


def _reasoner(
    spec: Spec,
    cell: Workcell,
    setup: Setup,
    limits: Limits,
    record: Path | None,
    replay: Path | None,
) -> Reasoner:
    """Make a trial's reasoner; only the oracle, which is a control, is given the truth."""
    if spec.vlm is not None:
        return vlm(spec.vlm, name=spec.reasoner, limits=limits, record=record, replay=replay)
    if spec.reasoner == NAME:
        return Oracle(truth=cell.truth, setup=setup)
    return reasoner(spec.reasoner)


def _file_name(text: str) -> str:
    return "".join(c if c.isalnum() or c in "._" else "_" for c in text)
