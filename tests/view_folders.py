"""Result folders to look at: made-up rows, a trial that was really run; and how to read a page."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from test_tables import made, step

from pliant.conditions import condition
from pliant.experiment import holdings, results
from pliant.experiment.one import Spec, perform
from pliant.experiment.plan import from_fields
from pliant.experiment.rows import Rows, rows_of
from pliant.formations import Formation, Step
from pliant.pose import Axis
from pliant.records import (
    Admission,
    Exchange,
    Execution,
    FailureAnalysis,
    Recovery,
    Trial,
)
from pliant.sim.cell import SimCell, Trajectory
from pliant.sim.replay import save as save_trajectory
from pliant.store import save_trial
from pliant.task import load_task
from pliant.teaching import shipped

HOSTILE = (
    "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
    "<!-- & <b>bold</b> \x1b[31mred\x1b[0m \u202egnola \x00"
)
"""What a model, a peg file or a condition may be called or say."""


class Page(HTMLParser):
    """The elements of a page, its text, and its scripts by id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self.scripts: dict[str | None, str] = {}
        self._script: str | None = None
        self._in_script = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._in_script = tag in ("script", "style")
        self._script = dict(attrs).get("id")

    def handle_endtag(self, tag: str) -> None:
        self._in_script = False

    def handle_data(self, data: str) -> None:
        if self._in_script:
            self.scripts[self._script] = self.scripts.get(self._script, "") + data
        else:
            self.words += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def data(self) -> Any:
        return json.loads(self.scripts["data"])


@cache
def ran() -> tuple[Trial, Trajectory]:
    """One trial, open loop, with what the robot did."""
    cell = SimCell()
    spec = Spec(task=load_task("circle"), condition=condition("none"), seed=1, reasoner="none")
    return perform(spec, cell, shipped()), cell.trajectory()


def failed(execution: Execution, says: str) -> Execution:
    """The execution as a model would have judged it, that says `says` wherever it can."""
    picture = execution.outcome.looks[-1].observation.views["side"].image
    asked = Exchange(
        stage="judge",
        request=says,
        reply=says,
        model="m",
        pictures=(picture,),
        input_tokens=1200,
        cached_tokens=800,
        output_tokens=34,
        latency_s=1.5,
        cost_usd=0.0123,
    )
    step_ = Step(formation=Formation.FIT, goal={Axis.Y: -0.04}, retreat=True)
    beyond = Step(formation=Formation.ALIGN, goal={Axis.Y: 0.03})
    analysis = FailureAnalysis(what=says, why="too short", how="further", motion=step_.goal)
    return replace(
        execution,
        verdict=replace(execution.verdict, success=False, reason=says, exchanges=(asked,)),
        recovery=Recovery(
            analysis=analysis,
            steps=(step_, beyond),
            by="m",
            exchanges=(replace(asked, stage="plan", refused=says),),
            fallback="no answer in time",
            clamped=(step_, replace(beyond, goal={Axis.Y: 0.5})),
        ),
        admission=Admission(steps=(step_,), refusals=("align: too far",)),
    )


def told(says: str) -> Trial:
    """The trial with its Fit judged by a model that says `says`."""
    trial, _ = ran()
    executions = list(trial.executions)
    executions[2] = failed(executions[2], says)
    return replace(trial, executions=tuple(executions), model=says)


def experiment(folder: Path, extra: Sequence[Rows] = (), *, keep: Trial | None = None) -> Path:
    """An experiment's folder: two reasoners on eight seeds, `extra` rows, and the record of `keep`,
    which then is one of the trials."""
    fields = {"pegs": "circle", "conditions": ["none", "all"], "reasoners": ["rules", "none"]}
    holdings.prepare(from_fields({**fields, "trials": 8}), folder)
    rows = [made(s, s <= 7, executions=(step("fit", to="fit"),), **drawn(s)) for s in range(1, 9)]
    rows += [made(s, s <= 2, reasoner="none", **drawn(s)) for s in range(1, 9)]
    if keep is not None:
        rows.append(rows_of(keep))
        store_trial(folder, keep)
    results.write_rows(folder, [*rows, *extra])
    return folder


def store_trial(folder: Path, trial: Trial) -> Path:
    """Keep a trial's record in a run's folder, as `--save` does."""
    place = folder / "trials" / trial.trial_id
    save_trial(place, trial)
    save_trajectory(place, ran()[1])
    return place


def drawn(seed: int) -> dict[str, Any]:
    return {"drawn_friction": 1 + seed / 2, "drawn_hole_y": seed / 1000 - 0.004}
