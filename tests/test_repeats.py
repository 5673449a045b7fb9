"""An execution that changed nothing is said to have changed nothing."""

from dataclasses import replace
from io import StringIO

import pytest
from stand_ins import case_after, executed, outcome_of, scene_of

from pliant.cell import Stop, Truth
from pliant.cli.run import _Teller
from pliant.console import Lasting
from pliant.formations import Formation
from pliant.records import Execution, Outcome
from pliant.repeats import (
    SAME_COMPRESSION_M,
    SAME_GOAL_M,
    SAME_POSE_RAD,
    SAME_SEEN_M,
    Repeat,
    of_which,
    repeats,
)


def execution(formation: Formation = Formation.INSERTION, **changes: float) -> Execution:
    """One that ended early, with what is measured of it moved by `changes` [m, deg, rad]."""
    scene = scene_of(
        tip_y=changes.get("tip_y", 0.0),
        tip_z=-0.004 + changes.get("tip_z", 0.0),
        tilt_deg=changes.get("tilt_deg", 0.0),
    )
    outcome = outcome_of(formation, stop=Stop.COMPRESSION, scene=scene)
    target = outcome.target
    look = outcome.looks[-1]
    observation = replace(
        look.observation,
        pose=replace(target, roll=target.roll + changes.get("roll", 0.0)),
        compression_m=0.02 + changes.get("pressed", 0.0),
    )
    outcome = replace(
        outcome,
        target=replace(target, y=target.y + changes.get("goal_y", 0.0)),
        looks=(replace(look, observation=observation),),
    )
    return executed(case_after(outcome))


def told(history: list[Execution]) -> list[str]:
    return [str(repeat or "new") for repeat in repeats(history)]


def test_pairs_in_the_same_place_are_one_attempt() -> None:
    pair = [execution(Formation.ALIGN), execution()]
    history = [execution(Formation.FIT), *pair * 3]
    assert told(history) == [
        *["new"] * 3,
        "as execution 2: nothing changed (2nd time)",
        "as execution 3: nothing changed (2nd time)",
        "as execution 2: nothing changed (3rd time)",
        "as execution 3: nothing changed (3rd time)",
    ]
    assert of_which(history) == ", of which 4 repeated a state"
    assert of_which(history[:3]) == ""
    assert repeats([]) == ()


LIMITS = {
    "goal_y": SAME_GOAL_M,
    "roll": SAME_POSE_RAD,
    "tip_y": SAME_SEEN_M,
    "tip_z": SAME_SEEN_M,
    "tilt_deg": 1.0,
    "pressed": SAME_COMPRESSION_M,
}


@pytest.mark.parametrize("what", LIMITS)
def test_what_is_within_its_tolerance_is_the_same_and_what_is_beyond_is_new(what: str) -> None:
    for share, found in ((0.95, Repeat(first=0, times=2)), (1.05, None)):
        changed = execution(Formation.INSERTION, **{what: share * LIMITS[what]})
        assert repeats([execution(), changed]) == (None, found)


def test_small_changes_that_add_up_are_a_change() -> None:
    creeping = [execution(tip_z=-0.7 * n * SAME_SEEN_M) for n in range(4)]
    assert [r and r.first for r in repeats(creeping)] == [None, 0, None, 2]


def test_what_only_one_of_them_saw_is_a_difference() -> None:
    def blind(outcome: Outcome) -> Execution:
        looks = (replace(outcome.looks[-1], scene=outcome_of(Formation.FIT).scene),)
        return executed(case_after(replace(outcome, looks=looks)))

    hidden = blind(execution().outcome)
    assert repeats([execution(), hidden, hidden]) == (None, None, Repeat(first=1, times=2))


def test_another_formation_or_another_stop_is_new() -> None:
    stopped = execution()
    reached = executed(case_after(replace(stopped.outcome, motions=())))
    assert repeats([stopped, reached, execution(Formation.ALIGN)]) == (None, None, None)


def test_the_terminal_says_so_behind_the_verdict() -> None:
    console = Lasting(file=StringIO(), width=200)
    teller = _Teller(console)
    truth = Truth(
        inserted=False, depth_m=0, tip=(0, 0, 0), tilt_rad=0, hole_y=0, compression_m=0, fit=False
    )
    for _ in range(2):
        teller.tell(execution(), truth)
    first, second = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert first.endswith("failure (scripted)")
    assert second.endswith("failure (scripted); as execution 1: nothing changed (2nd time)")


@pytest.mark.parametrize(
    ("n", "said"), [(2, "2nd"), (3, "3rd"), (4, "4th"), (11, "11th"), (21, "21st"), (112, "112th")]
)
def test_times_are_counted_in_words(n: int, said: str) -> None:
    assert f"({said} time)" in str(Repeat(first=0, times=n))
