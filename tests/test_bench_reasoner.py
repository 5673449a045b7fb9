"""The benchmark of reasoners: its cases, the right answers, and what a reasoner scores."""

import json
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stand_ins import case_after, goal_step, outcome_of, recovery_of, scene_of, verdict_of

from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.errors import InputError
from pliant.experiment.bench import table
from pliant.experiment.bench.answers import Answer, answer
from pliant.experiment.bench.blind import Pictures, shown
from pliant.experiment.bench.cases import (
    SHIPPED,
    SHIPPED_HASH,
    BenchCase,
    Cases,
    Key,
    Kind,
    Origin,
    thinned,
    write,
)
from pliant.experiment.bench.coin import Coin
from pliant.experiment.bench.marks import put
from pliant.experiment.bench.run import run
from pliant.experiment.bench.scores import group
from pliant.experiment.success import succeeded
from pliant.formations import OWNED, RECOVERABLE, Formation, Step
from pliant.levels import STOP, load_level
from pliant.methods.planar.checks import check
from pliant.pictures import name_of
from pliant.reasoners.rules import Rules
from pliant.records import Case, Exchange, Recovery, Verdict

SET = Cases(SHIPPED)


# --- the set that ships ------------------------------------------------------------------------


def test_the_set_that_ships_is_the_frozen_one() -> None:
    assert SET.hash == SHIPPED_HASH
    assert SHIPPED.stat().st_size < 13.5e6


def test_the_set_holds_every_sort_of_case_and_is_balanced() -> None:
    keys = SET.keys
    assert len(keys) >= 300
    assert len({key.origin for key in keys}) == len(keys)
    successes = sum(key.answer.success for key in keys)
    assert 0.4 <= successes / len(keys) <= 0.6
    pegs = Counter(key.origin.peg for key in keys)
    of_the_paper = [pegs.pop(name) for name in ("circle", "square", "rectangle_narrow")]
    assert max(of_the_paper) <= 1.3 * min(of_the_paper)
    assert pegs.total() <= 0.1 * len(keys)
    for formation in RECOVERABLE:
        for success in (True, False):
            n = sum(k.formation is formation and k.answer.success is success for k in keys)
            assert n >= 40, f"{formation} {success}"
    for kind in Kind:
        assert sum(key.kind is kind for key in keys) >= 30, kind
    right = Counter(
        (k.formation, k.answer.steps[0].formation, k.answer.steps[0].retreat)
        for k in keys
        if k.answer.steps
    )
    assert len(right) >= 7  # kinds of failure, told apart by what mends them


def test_cases_hold_no_truth() -> None:
    with zipfile.ZipFile(SHIPPED) as archive:
        lines = archive.read("cases.jsonl").splitlines()
    secret = {"truth", "truths", "drawn", "setup", "inserted", "tilt_rad", "kind", "origin"}
    for line, key in zip(lines, SET.keys, strict=True):
        names, numbers = set(), set()
        for name, value in leaves(json.loads(line)):
            names.add(name)
            if isinstance(value, float):
                numbers.add(value)
        assert not names & secret
        true = {*key.truth.tip, key.truth.depth_m, key.truth.tilt_rad, key.truth.hole_y}
        assert not (true - {0.0}) & numbers


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield key, None
            yield from leaves(item, key)
    elif isinstance(value, list):
        for item in value:
            yield from leaves(item, name)
    else:
        yield name, value


def test_the_hard_cases_are_what_their_kind_says() -> None:
    for question in SET:
        key, case = question.key, question.case
        look = case.outcome.looks[-1]
        view = look.observation.views["side"]
        lag = look.observation.time_s - view.time_s
        assert (lag > 0.1) is (key.kind is Kind.STALE), question.name
        if key.kind is Kind.STALE:
            assert look.scene.time_s == view.time_s
        if key.kind is Kind.NEARLY:
            assert 0.007 <= key.truth.depth_m <= 0.013
        if key.kind is Kind.MESSAGE:
            assert case.evidence["table_i"] is not None
        if not key.answer.success and key.answer.steps:
            low, high = key.answer.goals_m or (np.nan, np.nan)
            assert low <= high, question.name
        for execution in case.history:
            assert not execution.outcome.looks[-1].observation.views


# --- scores ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Knows:
    """Answers from the key: rightly, or all the wrong way round."""

    key: Key
    inverted: bool = False
    name: str = "knows"

    def judge(self, case: Case) -> Verdict:
        return verdict_of(self.key.answer.success is not self.inverted)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        assert not verdict.success
        right = self.key.answer.steps
        if self.key.answer.stop or self.key.answer.go_on:
            stops = self.key.answer.stop is not self.inverted
            return recovery_of() if stops else recovery_of(case.goals.step(Formation.INSERTION))
        if not self.inverted:
            return recovery_of(*right)
        first = right[0]
        axis = OWNED[first.formation][0]
        before = case.goals.formations[first.formation][axis]
        away = before - 0.5 * (first.goal[axis] - before)
        return recovery_of(replace(first, goal={axis: away}, retreat=not first.retreat))


def test_who_knows_the_truth_scores_perfectly_and_its_inverse_the_opposite() -> None:
    keys = {f"{number:04d}": key for number, key in enumerate(SET.keys, start=1)}
    document = run(
        {"right": lambda n: Knows(keys[n]), "wrong": lambda n: Knows(keys[n], True)}, SET
    )
    right, wrong = (document["reasoners"][name]["all"] for name in ("right", "wrong"))
    assert document["cases"] == {
        "hash": SHIPPED_HASH,
        "n": len(SET),
        "of": len(SET),
        "pictures": "own",
    }
    assert right["balanced_accuracy"]["percent"] == 100
    assert wrong["balanced_accuracy"]["percent"] == 0
    for score in ("false_accepts", "false_rejects"):
        assert right[score]["percent"] == 0
        assert wrong[score]["percent"] == 100
    for score in ("plan_valid", "start_right", "retreat_right", "direction_right"):
        assert right[score]["percent"] == 100, score
    assert right["own"]["n"] == 0  # no model was asked
    assert (right["stops"]["percent"], right["stops_needlessly"]["percent"]) == (100, 0)
    assert wrong["stops"]["percent"] == 0
    assert wrong["direction_right"]["percent"] == 0
    assert wrong["retreat_right"]["percent"] == 0
    assert wrong["reaches"]["percent"] == 0
    assert right["toward_mm"]["mean"]["value"] > 1 > -1 > wrong["toward_mm"]["mean"]["value"]


def question(
    reached: tuple[float, float] = (-0.070, -0.045), answer: Answer | None = None
) -> BenchCase:
    """A Fit that failed; its goal is -35.2 mm, the right one -50.2 mm, down to -70 would do."""
    outcome = outcome_of(Formation.FIT, scene=scene_of(tip_y=0.02))
    case = case_after(outcome)
    case = replace(case, evidence=check(case.task, outcome, case.teaching.scenes))
    steps = (goal_step(Formation.FIT, -0.015), goal_step(Formation.ALIGN))
    truth = Truth(
        inserted=False, depth_m=0, tip=(0, 0, 0), tilt_rad=0, hole_y=0, compression_m=0, fit=False
    )
    key = Key(
        kind=Kind.PLAIN,
        formation=Formation.FIT,
        answer=answer or Answer(success=False, steps=steps, goals_m=reached),
        truth=truth,
        origin=Origin(peg="circle", condition="all", seed=1, reasoner="rules", index=2),
    )
    return BenchCase(name="0001", case=case, key=key)


@dataclass(frozen=True)
class Plans(Rules):
    plan: Recovery | None = None
    success: bool = False

    def judge(self, case: Case) -> Verdict:
        return verdict_of(self.success)

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        assert not verdict.success
        return self.plan


@pytest.mark.parametrize(
    ("steps", "toward_mm", "direction", "start", "reaches", "valid"),
    [
        ((goal_step(Formation.FIT, -0.012),), 9.8, True, True, True, True),
        ((goal_step(Formation.FIT, -0.030),), 9.8, True, True, True, True),
        ((goal_step(Formation.FIT, -0.005),), 5.0, True, True, False, True),
        ((goal_step(Formation.FIT, 0.010),), -10.0, False, True, False, True),
        ((goal_step(Formation.FIT, -0.012, retreat=True),), 9.8, True, True, False, True),
        ((goal_step(Formation.ALIGN, -0.012),), 0.0, False, False, False, True),
        ((goal_step(Formation.FIT, -10.0),), 0.0, False, False, False, False),
        ((), 0.0, False, False, False, False),
    ],
)
def test_a_plan_is_scored_by_what_of_it_may_be_done(
    steps: tuple[Step, ...],
    toward_mm: float,
    direction: bool,
    start: bool,
    reaches: bool,
    valid: bool,
) -> None:
    mark = put(question(), "plans", lambda _: Plans(plan=recovery_of(*steps), success=True))
    plan = mark.plan
    assert plan is not None
    assert plan.toward_m * 1e3 == pytest.approx(toward_mm)
    assert (plan.direction, plan.start, plan.reaches) == (direction, start, reaches)
    assert (not plan.refusal) is valid


def test_stopping_is_scored_apart_from_planning() -> None:
    nothing_helps = question(answer=Answer(success=False, stop=True))
    stops, goes_on = recovery_of(), recovery_of(goal_step(Formation.FIT, -0.012))
    marks = [
        put(asked, "plans", lambda _, plan=plan: Plans(plan=plan))  # type: ignore[misc]
        for asked in (nothing_helps, question())
        for plan in (stops, goes_on, None)
    ]
    assert [mark.plan is None for mark in marks] == [True] * 3 + [False] * 3
    scored = group(marks)
    for score in ("stops", "stops_needlessly"):
        assert (scored[score]["successes"], scored[score]["n"]) == (1, 3), score
    assert scored["plan_valid"]["n"] == 3


@dataclass(frozen=True, kw_only=True)
class Failed:
    """A failure of the set, without its pictures: its key, whether the guided skills made it,
    whether an earlier execution had shown that something is wrong, and what is no evidence."""

    key: Key
    is_guided: bool
    was_seen_coming: bool
    no_evidence: dict[str, str]


@cache
def failures() -> tuple[Failed, ...]:
    return tuple(
        Failed(
            key=q.key,
            is_guided=q.case.method.follows_belief,
            was_seen_coming=any(
                not e.verdict.success or e.outcome.scene.peg is None for e in q.case.history
            ),
            no_evidence={name: str(of(q)) for name, of in WITHOUT_EVIDENCE.items()},
        )
        for q in SET
        if not q.key.answer.success
    )


def test_stop_cases_are_failures_that_a_reasoner_could_see_coming() -> None:
    stops = [q for q in failures() if q.key.answer.stop]
    met = {q.key.origin.condition for q in stops}
    assert len(met) >= 8  # kinds
    assert all(load_level(name).right == STOP for name in met)
    goes_on = [q for q in failures() if q.key.kind is Kind.SOUND]
    assert all(q.key.answer == Answer(success=False, stop=True) for q in stops)
    assert all(q.key.answer == Answer(success=False, go_on=True) for q in goes_on)
    assert all(q.was_seen_coming for q in (*stops, *goes_on))


WITHOUT_EVIDENCE: dict[str, Callable[[BenchCase], Any]] = {
    "method": lambda q: q.case.method.name,
    "peg": lambda q: q.case.task.peg.name,
    "hole": lambda q: q.case.task.hole,
    "depth": lambda q: q.case.task.depth,
    "formation": lambda q: q.key.formation,
    "executions before": lambda q: len(q.case.history),
    "failures before": lambda q: sum(not e.verdict.success for e in q.case.history),
    "looks": lambda q: len(q.case.outcome.looks),
    "cameras": lambda q: set(q.case.outcome.looks[-1].observation.views),
    "place in the set": lambda q: int(q.name) // 200,
}


@pytest.mark.parametrize("told_by", WITHOUT_EVIDENCE)
def test_nothing_but_the_evidence_tells_whether_it_is_right_to_stop(told_by: str) -> None:
    """The best guess from one thing that is no evidence, in balanced accuracy: 50 % is blind."""
    assert best_guess(failures(), told_by) <= 0.65
    assert best_guess([q for q in failures() if q.is_guided], told_by) <= 0.62


def best_guess(of: Sequence[Failed], name: str) -> float:
    sides = {
        stop: Counter(q.no_evidence[name] for q in of if q.key.answer.stop is stop)
        for stop in (True, False)
    }
    stops, goes_on = (counts.total() for counts in (sides[True], sides[False]))
    values = {*sides[True], *sides[False]}
    right = sum(max(sides[True][v] / stops, sides[False][v] / goes_on) for v in values)
    return right / 2


def test_what_another_answered_in_its_place_is_not_its_own() -> None:
    plan = recovery_of(goal_step(Formation.FIT, -0.012))
    spoke = Exchange(
        stage="plan",
        request="",
        reply="",
        model="m",
        input_tokens=90,
        output_tokens=10,
        latency_s=2.0,
        cost_usd=0.01,
    )
    plans = [
        replace(plan, exchanges=(spoke, spoke)),
        replace(plan, fallback="no reply", exchanges=(spoke,)),
        replace(plan, clamped=plan.steps, exchanges=(replace(spoke, refused="too far"),)),
    ]
    marks = [put(question(), "m", lambda _, p=p: Plans(plan=p)) for p in plans]  # type: ignore[misc]
    scored = group(marks)
    assert (scored["own"]["successes"], scored["own"]["n"]) == (1, 3)  # the judge asked no model
    assert (scored["clamped"], scored["fallbacks"]) == (1, 1)
    assert (scored["requests"], scored["input_tokens"], scored["output_tokens"]) == (4, 360, 40)
    assert scored["cost_usd"] == pytest.approx(0.04)
    assert scored["latency_s"]["p50"] == pytest.approx(2.0)
    unpriced = replace(plan, exchanges=(replace(spoke, cost_usd=None), spoke))
    assert group([put(question(), "m", lambda _: Plans(plan=unpriced))])["cost_usd"] is None


def test_the_tables_show_every_reasoner_also_where_nothing_was_asked() -> None:
    document = run({"rules": lambda _: Rules(), "coin": lambda _: Coin()}, SET, limit=6)
    text = table.markdown(document)
    assert text.count("| rules |") >= 3 < text.count("| coin |") + 1
    assert "the first 6" in text
    assert document == json.loads(json.dumps(document))


def test_the_coin_answers_the_same_again_and_is_admissible() -> None:
    first, again = (run({"coin": lambda _: Coin()}, SET, limit=40) for _ in range(2))
    assert first == again
    assert first != run({"coin": lambda _: Coin(seed=2)}, SET, limit=40)
    assert first["reasoners"]["coin"]["all"]["plan_valid"]["percent"] > 80


def test_a_reasoner_that_breaks_is_named_with_the_case() -> None:
    class Breaks(Rules):
        def judge(self, case: Case) -> Verdict:
            raise ZeroDivisionError("by nought")

    with pytest.raises(InputError, match=r"'mine' failed at case 0001: ZeroDivisionError"):
        put(question(), "mine", lambda _: Breaks())
    with pytest.raises(InputError, match="AttributeError"):
        put(question(), "mine", lambda _: object())  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize(("reasoners", "limit"), [({}, None), ({"rules": lambda _: Rules()}, 0)])
def test_nothing_to_do_is_refused(reasoners: dict[str, Any], limit: int | None) -> None:
    with pytest.raises(InputError):
        run(reasoners, SET, limit=limit)


# --- right answers -----------------------------------------------------------------------------


def truth_of(**given: Any) -> Truth:
    upright = Truth(
        inserted=False,
        depth_m=0.005,
        tip=(0.0, 0.0, -0.005),
        tilt_rad=0.0,
        hole_y=0.0,
        compression_m=0.001,
        fit=True,
    )
    return replace(upright, **given)


@pytest.mark.parametrize(
    ("formation", "truth", "success"),
    [
        (Formation.APPROACH, truth_of(depth_m=-0.02, compression_m=0.0), True),
        (Formation.APPROACH, truth_of(depth_m=-0.02, compression_m=0.003), False),
        (Formation.CONTACT, truth_of(compression_m=0.003), True),
        (Formation.CONTACT, truth_of(compression_m=0.0), False),
        (Formation.FIT, truth_of(), True),
        (Formation.FIT, truth_of(tip=(0.0, 0.004, 0.0), depth_m=0.0), False),  # on the near rim
        (Formation.FIT, truth_of(fit=False), False),
        (Formation.ALIGN, truth_of(), True),
        (Formation.ALIGN, truth_of(tilt_rad=0.1), False),
        (Formation.ALIGN, truth_of(tip=(0.0, 0.0016, 0.0), depth_m=0.0), False),
        (Formation.INSERTION, truth_of(inserted=True), True),
        (Formation.INSERTION, truth_of(inserted=False), False),
    ],
)
def test_a_formation_succeeds_where_the_next_skill_can_take_over(
    formation: Formation, truth: Truth, success: bool
) -> None:
    case = case_after(outcome_of(formation))
    assert succeeded(case.task, case.outcome, truth) is success


def test_the_right_step_after_a_shallow_insertion_is_to_push_on() -> None:
    case = case_after(outcome_of(Formation.INSERTION, scene=scene_of()))
    shallow = goal_step(Formation.INSERTION, 0.012)
    goals = case.goals.updated(shallow)
    right = answer(replace(case, goals=goals), truth_of(), Setup(seed=0))
    assert right is not None
    assert right.steps == (goal_step(Formation.INSERTION),)


def test_what_no_plan_mends_has_no_steps_and_is_judged_only() -> None:
    case = case_after(outcome_of(Formation.CONTACT, scene=scene_of()))
    right = answer(case, truth_of(compression_m=0.0), Setup(seed=0))
    assert right == Answer(success=False)
    asked = replace(question(answer=right), case=case)
    assert put(asked, "rules", lambda _: Plans(success=True)).plan is None


# --- sets of one's own -------------------------------------------------------------------------


@pytest.fixture
def own(tmp_path: Path) -> Path:
    write(tmp_path / "own.zip", [question(), replace(question(), name="0002")])
    return tmp_path / "own.zip"


def test_a_set_reads_back_as_it_was_written(own: Path) -> None:
    asked = question()
    found = list(Cases(own))
    assert [q.name for q in found] == ["0001", "0002"]
    assert found[0].key == asked.key
    image = asked.case.outcome.looks[-1].observation.views["side"].image
    again = found[0].case.outcome.looks[-1].observation.views["side"].image
    assert np.array_equal(image, again)
    assert found[0].case.goals == asked.case.goals
    shown = found[0].case.teaching.demonstrations[Formation.FIT].view.image
    taught = asked.case.teaching.demonstrations[Formation.FIT].view.image
    assert name_of(shown) == name_of(taught)
    assert Rules().judge(found[0].case) == Rules().judge(thinned(asked.case))
    copy = own.with_name("copy.zip")
    write(copy, Cases(own))
    assert copy.read_bytes() == own.read_bytes()


def rewritten(path: Path, member: str, change: Any) -> Path:
    """The archive with one member's text changed."""
    broken = path.with_name("broken.zip")
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(broken, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            target.writestr(name, change(content) if name == member else content)
    return broken


def drop_last_line(text: bytes) -> bytes:
    return b"".join(text.splitlines(keepends=True)[:-1])


def second_line(line: bytes) -> Any:
    return lambda text: text.splitlines(keepends=True)[0] + line + b"\n"


@pytest.mark.parametrize(
    ("member", "change", "says"),
    [
        ("cases.jsonl", second_line(b"{"), "cases.jsonl line 2 is not JSON"),
        ("cases.jsonl", second_line(b"[]"), "cases.jsonl line 2 holds no fields"),
        ("cases.jsonl", second_line(b"{}"), "cases.jsonl line 2 is broken"),
        ("cases.jsonl", drop_last_line, "1 cases and 2 answers"),
        ("answers.jsonl", second_line(b'{"kind": "odd"}'), "answers.jsonl line 2 is broken"),
        ("answers.jsonl", lambda t: t.replace(b'"fit"', b'"align"'), "to another case"),
        ("teaching.json", lambda t: t.replace(b'"schema":2', b'"schema":99'), "has schema 99"),
        (
            f"pictures/{name_of(np.zeros((480, 640, 3), np.uint8))}.webp",
            lambda _: b"",
            "is broken",
        ),
    ],
)
def test_a_broken_set_names_the_line(own: Path, member: str, change: Any, says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        list(Cases(rewritten(own, member, change)))
    assert "\n" not in str(refused.value)


def test_what_is_no_set_is_refused(tmp_path: Path, own: Path) -> None:
    (tmp_path / "text.zip").write_text("no archive", encoding="utf-8")
    with pytest.raises(InputError, match="not a case set"):
        len(Cases(tmp_path / "text.zip"))
    with pytest.raises(InputError, match="cannot be read"):
        len(Cases(tmp_path / "missing.zip"))
    with zipfile.ZipFile(tmp_path / "half.zip", "w") as archive:
        archive.writestr("cases.jsonl", "{}\n")
    with pytest.raises(InputError, match="not a whole case set"):
        len(Cases(tmp_path / "half.zip"))


# --- controls that see nothing -------------------------------------------------------------------


def first(n: int) -> list[BenchCase]:
    return [case for case, _ in zip(SET, range(n), strict=False)]


def images(question: BenchCase) -> dict[str, np.ndarray]:
    views = question.case.outcome.looks[-1].observation.views
    return {name: view.image for name, view in views.items()}


def test_black_pictures_are_black_and_change_nothing_else() -> None:
    for own, black in zip(first(8), shown(first(8), Pictures.BLACK), strict=True):
        assert not any(image.any() for image in images(black).values())
        assert black.key == own.key
        assert black.case.evidence == own.case.evidence
        assert black.case.outcome.looks[-1].scene == own.case.outcome.looks[-1].scene


def test_others_pictures_are_of_another_case_after_the_same_formation() -> None:
    cases = first(40)
    own = {n: images(question) for n, question in enumerate(cases)}
    for n, question in enumerate(shown(cases, Pictures.OTHERS)):
        for name, image in images(question).items():
            (of,) = {
                m for m, all_of in own.items() if name in all_of and (all_of[name] == image).all()
            } or {n}
            assert cases[of].key.formation is question.key.formation
    exchanged = [
        not (images(a)["side"] == images(b)["side"]).all()
        for a, b in zip(cases, shown(cases, Pictures.OTHERS), strict=True)
    ]
    assert sum(exchanged) > 30


def test_own_pictures_are_the_cases_themselves() -> None:
    cases = first(2)
    assert shown(cases, Pictures.OWN) is cases
