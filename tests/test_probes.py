"""Before it plans, a reasoner may ask for probes: the peg is lifted out, every camera looks, and
its low corner touches where it was asked to."""

import math
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo
from stand_ins import cell_for
from vlm_cases import asked, asking
from voices import analysis, bounded, judgement, no_shifts, reply

from pliant.belief import Belief
from pliant.cell import Robot
from pliant.conditions import Setup
from pliant.envelope import Limits
from pliant.errors import InputError, RobotFault
from pliant.experiment.faults import Heeded, ReasonerFault
from pliant.experiment.one import Spec, composed
from pliant.experiment.rows import exchanges
from pliant.formations import Formation
from pliant.methods import Prober
from pliant.methods.guided import Guided
from pliant.methods.guided.skills import SHIFTS
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.replies import motion_field
from pliant.records import Case, Execution, Looking, Probe, Probed, Recovery, Trial, Verdict
from pliant.recovery import Reasoner, admit
from pliant.report.trial import write
from pliant.store import load_trial, save_trial
from pliant.task import Task, load_task
from pliant.teaching import Teaching, shipped
from pliant.trial import Patience, Run

TASK = load_task("circle")
BOARD = 0.003  # [m] above nominal
IN_HOLE, ON_BOARD, OFF_THE_WORKSPACE = (0.0, -0.015), (0.0, 0.035), (0.1, 0.0)


Places = Sequence[tuple[float, float] | None]


class Doubtful(Rules):
    """The rules, but the first Fit is called a failure, and these places are probed after it."""

    def __init__(self, places: Places) -> None:
        self.places = places
        self.shown: list[Case] = []

    def judge(self, case: Case) -> Verdict:
        fits = [e for e in case.history if e.formation is Formation.FIT]
        is_first = case.outcome.step.formation is Formation.FIT and not fits
        verdict = super().judge(case)
        return replace(verdict, success=False) if is_first else verdict

    def inquire(self, case: Case, verdict: Verdict) -> Probe | None:
        self.shown.append(case)
        done = len(case.probes) + sum(len(e.probes) for e in case.history)
        if done >= len(self.places):
            return None
        return Probe(reason="what is there?", at=self.places[done], by=self.name)


def running(
    mind: Reasoner, *, probes: int = 4, method: Guided | None = None, **drawn: float
) -> Run:
    setup = Setup(seed=3, board_z=BOARD, **drawn)
    spec = Spec.named(peg=TASK.peg.name, level="L4", seed=setup.seed)
    robot = cell_for("circle").prepare(TASK, setup)
    teaching = shipped().for_task(TASK)
    run = composed(spec, robot, setup, teaching, mind, patience=Patience(probes=probes))
    run.method = method or run.method
    return run


@cache
def probed(places: Places, plugged_at: float) -> Execution:
    """The execution that was probed, of a trial that ends with the one after it."""
    run = running(Doubtful(places), plugged_at=plugged_at)
    for execution in run:
        if execution.probes:
            return execution
    raise AssertionError(run.fault)


# --- what a probe tells ------------------------------------------------------------------------


def test_a_touch_tells_the_height_of_the_board_and_the_depth_of_what_is_in_the_hole() -> None:
    places = (ON_BOARD, IN_HOLE)
    (board, hole), (_, plug) = (probed(places, at).probes for at in (0.0, 0.001))
    assert board.touched_z == pytest.approx(BOARD, abs=0.001)
    assert hole.touched_z is not None
    assert plug.touched_z is not None
    assert plug.touched_z == pytest.approx(BOARD - 0.001, abs=0.001)
    assert hole.touched_z < plug.touched_z - 0.001


def test_every_camera_looks_and_the_peg_hangs_clear_of_the_board_afterwards() -> None:
    looked, _ = probed((None, ON_BOARD), 0.0).probes
    for found in probed((None, ON_BOARD), 0.0).probes:
        look = found.looks[-1]
        assert set(look.observation.views) == {"side", "front", "oblique"}
        assert look.scene.peg is not None
        assert look.scene.peg.left_z > BOARD + 0.010
        assert found.held_m < 0.001
    assert looked.touched_z is None
    assert looked.note == ""


def test_a_place_that_the_hand_cannot_reach_is_not_touched_and_the_probe_says_why() -> None:
    (found,) = probed((OFF_THE_WORKSPACE,), 0.0).probes
    assert found.touched_z is None
    assert "outside the workspace" in found.note
    with pytest.raises(InputError, match="x nan, y 0 m: it must be finite numbers"):
        Probe(reason="", at=(math.nan, 0.0), by="me")


def test_a_touch_presses_no_harder_than_a_touch() -> None:
    for found in probed((ON_BOARD, IN_HOLE), 0.001).probes:
        touching = found.motions[-4:]
        assert max(motion.peak_compression_m for motion in touching) < 0.007


# --- what the loop grants ----------------------------------------------------------------------


def test_a_trial_grants_so_many_probes_and_the_plan_after_one_begins_with_a_retreat() -> None:
    mind = Doubtful((None, None, None))
    run = running(mind, probes=2)
    executions = [next(e for e in run if e.probes)]
    assert [len(case.probes) for case in mind.shown] == [0, 1]
    assert [case.probes_left for case in mind.shown] == [2, 1]
    (execution,) = executions
    assert execution.admission is not None
    assert execution.admission.steps[0].retreat
    case = mind.shown[-1]
    resumed = case.goals.step(Formation.FIT)
    assert execution.recovery is not None
    refused = admit(replace(execution.recovery, steps=(resumed,)), case, Limits())
    assert refused.refusals == ("fit: the peg was lifted out to probe: retreat first",)


def test_an_insertion_succeeds_after_its_probes_and_they_count_as_motions() -> None:
    run = running(Doubtful((None, ON_BOARD)))
    executions = list(run)
    assert run.end_reason == "inserted"
    assert cell_for("circle").truth().inserted
    with_probes = next(e for e in executions if e.probes)
    assert len(with_probes.motions) > len(with_probes.outcome.motions) + 5


@dataclass(frozen=True)
class Breaks(Guided):
    """The guided method, whose probes meet a fault."""

    def prober(self, task: Task, teaching: Teaching, limits: Limits) -> Prober:
        def broken(robot: Robot, look: Looking, probe: Probe, belief: Belief) -> Probed:
            raise RobotFault("lost", "the arm is gone")

        return broken


def test_a_fault_during_a_probe_ends_the_trial_and_loses_no_judged_execution() -> None:
    run = running(Doubtful((None,)), method=Breaks())
    executions = list(run)
    assert run.end_reason == "fault:lost"
    assert executions[-1].formation is Formation.FIT
    assert not executions[-1].verdict.success
    assert run.aborted is None


def test_a_reasoner_that_asks_for_what_is_no_probe_is_at_fault() -> None:
    class Wrong(Doubtful):
        def inquire(self, case: Case, verdict: Verdict) -> Probe | None:
            return "please"  # type: ignore[return-value]

    with pytest.raises(ReasonerFault, match="which is no Probe"):
        list(running(Heeded(inner=Wrong((None,)))))


@pytest.mark.parametrize(
    "words",
    [
        ("run", "--reasoner", "vlm", "--model", "test", "--probes"),
        ("run", "--method", "guided", "--reasoner", "vlm", "--recover", "rules", "--probes"),
        ("experiment", "--reasoners", "vlm", "--model", "test", "--probes"),
        ("bench-reasoner", "vlm", "--model", "test", "--probes"),
    ],
)
def test_probes_that_nobody_could_make_are_refused_before_a_model_is_asked(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    command = (sys.executable, "-m", "pliant", *words)
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, encoding="utf-8")
    assert ended.returncode == 2
    assert ended.stdout == ""
    (line,) = ended.stderr.splitlines()
    assert "probe" in line
    assert list(tmp_path.iterdir()) == []


# --- a model that asks -------------------------------------------------------------------------


class Curious(Doubtful):
    """A model by whose mouth the rules speak, and which asks for a touch first."""

    def __init__(self) -> None:
        super().__init__(())
        self.requests: list[str] = []
        self.mind = asking(self.answer, probes=True)

    def judge(self, case: Case) -> Verdict:
        self.case, self.said = case, super().judge(case)
        judged = self.mind.judge(case)
        return replace(judged, success=self.said.success)

    def inquire(self, case: Case, verdict: Verdict) -> Probe | None:
        self.case = case
        return self.mind.inquire(case, verdict)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        self.case = case
        return self.mind.recover(case, verdict)

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        wanted = asked(messages)
        self.requests.append(str(messages))
        if wanted.startswith("judge"):
            return reply(info, judgement(self.said))
        if wanted.startswith("say whether you need a probe"):
            wants = "none" if self.case.probes else "touch"
            x_mm, y_mm = (0, 0) if self.case.probes else (0, -15)
            fields = {"reason": "a plug?", "probe": wants, "x_mm": x_mm, "y_mm": y_mm}
            return reply(info, fields)
        recovery = Rules().recover(self.case, self.said)
        assert recovery is not None
        if wanted.startswith("analyse"):
            shifts = no_shifts(self.case, *map(motion_field, SHIFTS))
            return reply(info, analysis(recovery, self.case) | shifts)
        return reply(info, bounded(recovery, self.case))


@cache
def curious() -> tuple[Curious, Execution]:
    mind = Curious()
    return mind, next(e for e in running(mind) if e.probes)


def test_a_model_asks_for_a_touch_by_a_function_call_and_is_told_what_was_felt() -> None:
    mind, execution = curious()
    (found,) = execution.probes
    assert found.probe.at == IN_HOLE
    assert found.probe.reason == "a plug?"
    assert f"1: {found}" in mind.requests[-1]
    assert "3 left in this trial" in mind.requests[-1]
    assert execution.recovery is not None
    assert execution.recovery.is_own
    stages = [exchange.stage for exchange in exchanges(execution)]
    assert stages == ["judge", "probe", "probe", "analyse", "plan"]
    shown = execution.recovery.exchanges[-1].pictures
    assert len(shown) == len(found.probe.exchanges[-1].pictures) + 3


class Mute(Curious):
    """A model that answers everything but whether it needs a probe."""

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        if asked(messages).startswith("say whether you need a probe"):
            return reply(info, {"reason": "hm"})
        return super().answer(messages, info)


def test_a_model_that_does_not_say_whether_it_needs_a_probe_is_named_for_it() -> None:
    execution = next(e for e in running(Mute()) if e.recovery is not None)
    assert execution.probes == ()
    assert execution.recovery is not None
    assert "probe: Field required" in execution.recovery.no_answer_about_probes
    assert execution.recovery.is_own
    _, told = curious()
    assert told.recovery is not None
    assert told.recovery.no_answer_about_probes == ""


def test_a_probe_is_stored_read_back_and_shown_with_its_pictures(tmp_path: Path) -> None:
    _, execution = curious()
    trial = Trial(
        trial_id="probed",
        task=TASK,
        level="L4",
        condition="all",
        seed=3,
        reasoner="vlm",
        model="scripted",
        goals=shipped().goals,
        executions=(replace(execution, index=0),),
        end_reason="stopped",
        fault="",
        simulated_s=60.0,
        wall_s=1.0,
        truths=(cell_for("circle").truth(),),
        method="guided",
    )
    save_trial(tmp_path, trial)
    (back,) = load_trial(tmp_path).executions[0].probes
    (found,) = execution.probes
    assert str(back) == str(found)
    assert back.looks[-1].observation.pose == found.looks[-1].observation.pose
    write(tmp_path, trial, shipped(), video=False)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert str(found) in page
    assert page.count('alt="Probe 1, ') == 3
