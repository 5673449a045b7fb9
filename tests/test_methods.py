"""A method is one thing: asked, never compared by its name, and a user's own is a file."""

import re
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path

import pytest
from stand_ins import ScriptedRobot, case_after, cell_for, outcome_of, scene_of, verdict_of

import pliant
from pliant.belief import Belief
from pliant.cell import Truth
from pliant.conditions import Setup, condition
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.experiment import decides
from pliant.experiment.one import Spec, composed, perform
from pliant.experiment.oracle import Oracle
from pliant.export.labels import correction, labels
from pliant.formations import OWNED, Formation, Step
from pliant.levels import load_level
from pliant.methods.guided import Guided
from pliant.methods.named import METHODS, method
from pliant.methods.planar import Planar
from pliant.pose import Axis
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Case, Execution, Trial
from pliant.store import load_case, save_case
from pliant.task import Task, load_task
from pliant.teaching import Teaching, shipped
from pliant.trial import Run
from pliant.vision.measure import SIMULATED, Colours
from pliant.vision.sight import ByColour, Sight

SOURCE = Path(__file__).parents[1] / "src" / "pliant"
OWN = """
from pliant.methods.planar import Planar

class Mine(Planar):
    @property
    def name(self):
        return "mine"
"""


def test_no_code_outside_methods_compares_a_methods_name() -> None:
    compared = re.compile(
        r"""(==|!=|\bin\b|\bis\b) *\(?["'](planar|guided)["']|(PLANAR|GUIDED)\b"""
    )
    found = [
        f"{path.relative_to(SOURCE)}:{number}: {line.strip()}"
        for path in SOURCE.rglob("*.py")
        if path.relative_to(SOURCE).parts[0] != "methods"
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if compared.search(line)
    ]
    assert found == []


@pytest.mark.parametrize("name", METHODS)
def test_a_plan_must_name_what_its_formation_owns(name: str) -> None:
    plannable = method(name).plannable
    for formation in Formation:
        assert plannable[formation][: len(OWNED[formation])] == OWNED[formation]


@pytest.mark.parametrize("name", [*METHODS, "guided-dither-ease"])
def test_a_stored_case_comes_back_with_its_method(name: str, tmp_path: Path) -> None:
    case = replace(case_after(outcome_of(Formation.FIT)), method=method(name))
    save_case(tmp_path, case)
    assert load_case(tmp_path).method == case.method


def test_a_users_own_method_is_a_file_whose_content_is_in_the_fingerprint(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(OWN, encoding="utf-8")
    name = f"{file}:Mine"
    assert method(name).name == "mine"
    spec = Spec(
        task=load_task("circle"), condition=condition("none"), seed=1, reasoner="none", method=name
    )
    before = decides.expected(spec)["method_file"]
    file.write_text(OWN + "\n# another\n", encoding="utf-8")
    assert decides.expected(spec)["method_file"] != before is not None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "method file '.*mine.py' does not exist"),
        ("class Mine: name = 'mine'", "lacks 'plannable'; see pliant.methods.Method"),
        ("class Other: ...", "has no class 'Mine': it has Other"),
    ],
)
def test_what_is_no_method_is_refused_in_one_line(
    content: str | None, said: str, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / "mine.py").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        method(f"{tmp_path}/mine.py:Mine")


def test_a_model_is_not_asked_about_a_method_that_has_no_words() -> None:
    @dataclass(frozen=True)
    class Wordless(Planar):
        @property
        def words(self) -> dict[str, str]:
            return {}

    case = replace(case_after(outcome_of(Formation.FIT)), method=Wordless())
    with pytest.raises(InputError, match="method planar has no words for a model"):
        prompt.instructions(Settings(), case, Limits())


# --- who plans, by the truth ---------------------------------------------------------------------

LOW_M = -0.010  # of a board that lies lower than taught


def stuck(depth_m: float) -> tuple[Case, Truth]:
    """A guided insertion that stuck so deep in the hole of a low board, and the truth."""
    tip = LOW_M - depth_m
    truth = Truth(
        inserted=False,
        depth_m=depth_m,
        tip=(0.0, 0.0, tip),
        tilt_rad=0.05,
        hole_y=0.0,
        compression_m=0.0,
        fit=True,
    )
    case = case_after(outcome_of(Formation.INSERTION, scene=scene_of(tip_z=tip)))
    return replace(case, method=Guided()), truth


@pytest.mark.parametrize(("depth_m", "first"), [(0.006, "align"), (-0.002, "fit")])
def test_the_oracle_knows_how_high_the_board_lies(depth_m: float, first: str) -> None:
    """It once took it for 0, so that a peg above a low board counted as in its hole."""
    case, truth = stuck(depth_m)
    oracle = Oracle(truth=lambda: truth, setup=Setup(seed=0))
    recovery = oracle.recover(case, verdict_of(success=False))
    assert recovery is not None
    assert recovery.steps[0].formation == first


def test_a_guided_failure_is_labelled_with_a_guided_correction() -> None:
    """It once was corrected as the paper's method would have been, with absolute goals."""
    case, truth = stuck(-0.002)
    execution = Execution(
        index=0,
        outcome=case.outcome,
        evidence=case.evidence,
        belief=Belief(),
        verdict=verdict_of(success=False),
    )
    trial = Trial(
        trial_id="t",
        task=case.task,
        level="L3",
        condition="all",
        seed=1,
        reasoner="rules",
        model=None,
        goals=shipped().goals,
        executions=(execution,),
        end_reason="cap",
        fault="",
        simulated_s=1.0,
        wall_s=1.0,
        drawn={"hole_y": 0.012},
        truths=(replace(truth, hole_y=0.012),),
        method="guided",
    )
    guided, papers = (
        correction(labelled, labels(labelled)[0])
        for labelled in (trial, replace(trial, method="planar"))
    )
    assert guided is not None
    assert papers is not None
    taught = shipped().goals.formations[Formation.FIT]
    assert guided.steps[0] == Step(formation=Formation.FIT, goal=taught, retreat=True)
    assert papers.steps[0].goal[Axis.Y] == pytest.approx(taught[Axis.Y] + 0.012)


def test_the_rules_plan_as_their_method_does() -> None:
    """L5's random colours, say, or a guided case: whoever asks, the method answers."""
    assert load_level("L5").method == "guided"
    case = case_after(outcome_of(Formation.FIT, scene=scene_of(tip_y=0.05, tip_z=0.001)))
    verdict = verdict_of(success=False)
    for by in (Planar(), Guided()):
        known = replace(case, method=by)
        assert Rules().recover(known, verdict) == by.plan(known, verdict, "rules")


# --- one call ------------------------------------------------------------------------------------


def test_one_call_from_names_is_the_trial_that_an_experiment_performs() -> None:
    cell = cell_for("circle")
    trial = pliant.run(peg="circle", condition="none", seed=3, reasoner="none", cell=cell)
    spec = Spec(task=load_task("circle"), condition=condition("none"), seed=3, reasoner="none")
    assert trial.truths == perform(spec, cell, shipped()).truths
    assert repr(trial) == ("<Trial L0-circle-none-none-3: inserted, inserted, 5 executions>")
    assert trial._repr_html_().count("<tr>") == 5


def test_a_trial_from_names_takes_the_levels_method_and_what_the_level_draws() -> None:
    spec = Spec.named(level="L3", condition="none")
    assert spec.method == "guided"
    assert set(spec.condition.ranges) >= {"hole_x", "board_yaw"}
    assert Spec.named(level="L3", method="planar").method == "planar"


def test_the_package_says_its_version_and_refuses_what_it_lacks() -> None:
    assert re.fullmatch(r"\d+\.\d+.*", pliant.__version__)
    with pytest.raises(AttributeError, match="has no attribute 'walk'"):
        _ = pliant.walk


def test_a_run_is_given_eight_things_at_most() -> None:
    assert len(fields(Run)) <= 8


@pytest.mark.parametrize(("level", "colours"), [("L5", None), ("L1", SIMULATED)])
def test_where_colours_are_anything_the_method_is_told_none(
    level: str, colours: Colours | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = []

    def sight(by: Guided, task: Task, teaching: Teaching, known: Colours | None) -> Sight:
        told.append(known)
        return ByColour(task)

    monkeypatch.setattr(Guided, "sight", sight)
    composed(Spec.named(level=level), ScriptedRobot(), Setup(seed=1), shipped(), Rules())
    assert told == [colours]


def test_the_drawing_of_the_architecture_is_the_contract_that_imports_are_held_to() -> None:
    root = SOURCE.parents[1]
    contract = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    layers = contract["tool"]["importlinter"]["contracts"][0]["layers"]
    held = [set(re.findall(r"\w+", layer)) for layer in layers]
    page = (root / "docs" / "architecture.md").read_text(encoding="utf-8")
    drawing = page.split("```text\n")[1].split("```")[0]
    drawn = [name for line in drawing.splitlines() for name in line.split("  ")[0].split()]
    assert len(drawn) == len(set(drawn)) == sum(map(len, held))
    for layer in held:
        assert set(drawn[: len(layer)]) == layer
        drawn = drawn[len(layer) :]
