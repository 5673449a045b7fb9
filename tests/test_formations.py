import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.errors import InputError
from pliant.formations import OWNED, RECOVERABLE, Formation, Goals, Step
from pliant.pose import Axis, Pose

PAPER = {
    "approach": {"y", "z", "roll"},
    "contact": {"z"},
    "fit": {"y"},
    "align": {"y"},
    "insertion": {"z"},
}
VALUES = st.floats(-0.5, 0.5)
GOALS = st.builds(
    lambda approach, contact, fit, align, insertion: Goals(
        formations={
            Formation.APPROACH: dict(zip((Axis.Y, Axis.Z, Axis.ROLL), approach, strict=True)),
            Formation.CONTACT: {Axis.Z: contact},
            Formation.FIT: {Axis.Y: fit},
            Formation.ALIGN: {Axis.Y: align},
            Formation.INSERTION: {Axis.Z: insertion},
        }
    ),
    st.tuples(VALUES, VALUES, VALUES),
    VALUES,
    VALUES,
    VALUES,
    VALUES,
)


def some_goals() -> Goals:
    return Goals(
        formations={
            Formation.APPROACH: {Axis.Y: 0.026, Axis.Z: 0.21, Axis.ROLL: 0.17},
            Formation.CONTACT: {Axis.Z: 0.19},
            Formation.FIT: {Axis.Y: -0.035},
            Formation.ALIGN: {Axis.Y: 0.001},
            Formation.INSERTION: {Axis.Z: 0.17},
        }
    )


def test_each_formation_owns_exactly_the_papers_axes() -> None:
    assert {str(f): {str(a) for a in axes} for f, axes in OWNED.items()} == PAPER


def test_the_formations_follow_each_other_as_in_the_paper() -> None:
    assert [f"CF{f.order} {f}" for f in Formation] == [
        "CF0 approach",
        "CF1 contact",
        "CF2 fit",
        "CF3 align",
        "CF4 insertion",
    ]


def test_recovery_starts_at_fit_or_later() -> None:
    assert RECOVERABLE == (Formation.FIT, Formation.ALIGN, Formation.INSERTION)


def test_a_dash_is_the_goal_of_the_formation_before() -> None:
    goals = some_goals()
    assert goals.target(Formation.APPROACH) == Pose(y=0.026, z=0.21, roll=0.17)
    assert goals.target(Formation.CONTACT) == Pose(y=0.026, z=0.19, roll=0.17)
    assert goals.target(Formation.FIT) == Pose(y=-0.035, z=0.19, roll=0.17)
    assert goals.target(Formation.ALIGN) == Pose(y=0.001, z=0.19, roll=0.17)
    assert goals.target(Formation.INSERTION) == Pose(y=0.001, z=0.17, roll=0.17)


def test_fit_after_a_failed_insertion_is_at_contacts_height_not_at_insertions() -> None:
    goals = some_goals().updated(Step(formation=Formation.INSERTION, goal={Axis.Z: 0.16}))
    assert goals.target(Formation.FIT).z == 0.19


@given(GOALS, st.sampled_from(list(Formation)), VALUES)
def test_a_new_goal_changes_its_own_and_later_formations_only(
    goals: Goals, formation: Formation, value: float
) -> None:
    axis = OWNED[formation][0]
    updated = goals.updated(Step(formation=formation, goal={axis: value}))
    assert updated.target(formation)[axis] == value
    for earlier in list(Formation)[: formation.order]:
        assert updated.target(earlier) == goals.target(earlier)
    for later in list(Formation)[formation.order + 1 :]:
        for other in Axis:
            if other is not axis:
                assert updated.target(later)[other] == goals.target(later)[other]


@given(GOALS)
def test_updating_leaves_the_goals_it_came_from_alone(goals: Goals) -> None:
    before = {f: dict(g) for f, g in goals.formations.items()}
    goals.updated(Step(formation=Formation.FIT, goal={Axis.Y: 9.0}))
    assert goals.formations == before


@given(GOALS, st.sampled_from(list(Formation)))
def test_commanding_the_goal_in_force_changes_nothing(goals: Goals, formation: Formation) -> None:
    assert goals.updated(goals.step(formation)) == goals


@pytest.mark.parametrize(
    ("formation", "axis"),
    [(f, a) for f in Formation for a in Axis if a not in OWNED[f]],
)
def test_a_goal_for_an_axis_that_is_not_owned_is_refused(formation: Formation, axis: Axis) -> None:
    formations = dict(some_goals().formations)
    formations[formation] = {**formations[formation], axis: 0.0}
    with pytest.raises(InputError, match=f"goal for {formation} sets {axis}") as error:
        Goals(formations=formations)
    assert all(str(a) in str(error.value) for a in OWNED[formation])


@pytest.mark.parametrize(("formation", "axis"), [(f, a) for f in Formation for a in OWNED[f]])
def test_a_goal_that_lacks_an_owned_axis_is_refused(formation: Formation, axis: Axis) -> None:
    formations = dict(some_goals().formations)
    formations[formation] = {a: v for a, v in formations[formation].items() if a is not axis}
    with pytest.raises(InputError, match=f"goal for {formation} lacks {axis}"):
        Goals(formations=formations)


@pytest.mark.parametrize("formation", list(Formation))
def test_goals_without_one_of_the_formations_are_refused(formation: Formation) -> None:
    formations = {f: g for f, g in some_goals().formations.items() if f is not formation}
    with pytest.raises(InputError, match=f"no goal for {formation}"):
        Goals(formations=formations)


def test_a_step_reads_as_words() -> None:
    step = Step(formation=Formation.FIT, goal={Axis.Y: -0.0401}, retreat=True)
    assert str(step) == "fit to y -40.1 mm after a retreat"
