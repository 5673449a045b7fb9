"""One trial in a workcell, with the truth sampled beside it after every execution."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from pliant.cell import Truth, Workcell
from pliant.envelope import Limits
from pliant.errors import RobotFault
from pliant.experiment.oracle import NAME, Oracle
from pliant.reasoners import reasoner
from pliant.records import Execution, Trial
from pliant.recovery import Reasoner
from pliant.skills.planar import Planar
from pliant.task import Condition, Setup, Task
from pliant.teaching import Teaching
from pliant.trial import Patience, Run


@dataclass(frozen=True, kw_only=True)
class Spec:
    """Which trial: everything that decides its outcome."""

    task: Task
    condition: Condition
    seed: int
    reasoner: str

    @property
    def trial_id(self) -> str:
        names = (self.task.level, self.task.peg.name, self.condition.name, self.reasoner, self.seed)
        return "-".join(_file_name(str(n)) for n in names)


def perform(
    spec: Spec,
    cell: Workcell,
    teaching: Teaching,
    *,
    limits: Limits | None = None,
    on_execution: Callable[[Execution, Truth], None] | None = None,
) -> Trial:
    """Run a trial to its end. The truth goes into the record, never to the reasoner. A cell that
    cannot even be prepared gives a trial without executions."""
    started = time.perf_counter()
    setup = spec.condition.draw(spec.seed)
    mind = _reasoner(spec.reasoner, cell, setup)
    teaching = teaching.for_task(spec.task)
    history: list[Execution] = []
    truths: list[Truth] = []
    simulated_s = 0.0
    try:
        robot = cell.prepare(spec.task, setup)
    except RobotFault as fault:
        end_reason, why = fault.end_reason, str(fault)
    else:
        run = Run(
            robot=robot,
            task=spec.task,
            teaching=teaching,
            reasoner=mind,
            skill=Planar(taught=teaching.goals),
            limits=limits or Limits(),
            patience=Patience(),
        )
        for execution in run:
            truths.append(cell.truth())
            if on_execution is not None:
                on_execution(execution, truths[-1])
        history, simulated_s = run.history, run.clock_s
        end_reason, why = run.end_reason, run.fault
    return Trial(
        trial_id=spec.trial_id,
        task=spec.task,
        condition=spec.condition.name,
        seed=spec.seed,
        reasoner=spec.reasoner,
        model=getattr(mind, "model", None),
        goals=teaching.goals,
        executions=tuple(history),
        end_reason=end_reason,
        fault=why,
        simulated_s=simulated_s,
        wall_s=time.perf_counter() - started,
        drawn=setup.quantities(),
        truths=tuple(truths),
    )


def _reasoner(name: str, cell: Workcell, setup: Setup) -> Reasoner:
    """A reasoner; only the oracle, which is a control, is given the truth."""
    return Oracle(truth=cell.truth, setup=setup) if name == NAME else reasoner(name)


def _file_name(text: str) -> str:
    return "".join(c if c.isalnum() or c in "._" else "_" for c in text)
