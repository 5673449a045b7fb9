"""What each key of `pliant teach` does, without a terminal; and teaching on a robot."""

from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stand_ins import ScriptedRobot, motion_to, prepared, scene_of, side_camera
from teach_keys import PRESSES

from pliant.cell import Observation, Robot, Stop, View
from pliant.commissioning import session as s
from pliant.commissioning.draft import Draft
from pliant.commissioning.keys import HELP, INTENTS, split
from pliant.commissioning.screen import render
from pliant.commissioning.session import Session, begin
from pliant.commissioning.teach import Place, Teacher, teach
from pliant.console import Console
from pliant.envelope import Limits
from pliant.errors import InputError, RobotFault
from pliant.formations import OWNED, Formation
from pliant.pose import Axis, Pose
from pliant.task import load_task
from pliant.teaching import load

HOME = Pose(x=-0.00003, z=0.24377, pitch=0.0005)
VIEW = View(camera=side_camera(), time_s=0.0, image=np.zeros((480, 640, 3), np.uint8))


def after(session: Session, keys: Sequence[str]) -> Session:
    """The state after keys, with a robot that goes exactly where it is told."""
    for key in keys:
        session, command = s.decide(session, INTENTS[key], Limits())
        match command:
            case s.MoveTo(pose=pose):
                assert Limits().outside({a: pose[a] for a in Axis}) is None
                session = s.moved(session, pose, motion_to(pose))
            case s.Take():
                observation = Observation(
                    time_s=0.0, pose=session.at, compression_m=0.0, views={"side": VIEW}
                )
                session = s.taken(session, observation, scene_of())
    return session


def assert_at(pose: Pose, other: Pose) -> None:
    assert all(abs(e) < 1e-9 for e in pose.error(other, Axis).values()), pose


def all_taught() -> list[str]:
    return [key for _, _, keys in PRESSES for key in [*keys, "enter"]]


# --- keys ----------------------------------------------------------------------------------------


def test_teaching_begins_at_the_measured_pose_without_its_noise() -> None:
    assert_at(begin(HOME).at, Pose(z=0.2438))


def test_a_step_goes_along_one_axis_by_the_size_chosen_for_lengths_or_angles() -> None:
    session = after(begin(HOME), ["3", "d", "1", "w", "4", ","])
    assert_at(session.at, Pose(y=0.010, z=0.2443, roll=Axis.ROLL.from_report(0.5)))


def test_a_wrist_that_is_loaded_is_not_tared() -> None:
    session = begin(HOME)
    seen = Observation(time_s=0.0, pose=HOME, compression_m=0.0071, views={})
    assert s.tared(session, seen, loaded=True).note.startswith("not tared: +7.1 mm of compression")
    assert s.tared(session, seen, loaded=False).note == "compression counts from here"


def test_plus_y_is_right_and_minus_roll_leans_right() -> None:
    session = after(begin(HOME), ["right", "up", "."])
    assert session.at.y > 0
    assert session.at.z > HOME.z
    assert session.at.roll < 0


def test_every_key_that_does_something_is_explained_on_the_screen() -> None:
    told = {word.strip(",").lower() for keys, _ in HELP for word in keys.split()} | {","}
    arrows = {"left": "←", "right": "→", "up": "↑", "down": "↓"}
    assert {arrows.get(key, key) for key in INTENTS} <= told


@given(st.lists(st.sampled_from(["\x1b[A", "\x1bOB", "\x1b[3~", "A", "\r", "é", "5"])), st.data())
def test_keys_are_the_same_however_the_terminal_cuts_what_it_sends(
    sent: list[str], data: st.DataObject
) -> None:
    whole = "".join(sent).encode()
    keys, rest = [], b""
    while whole:
        cut = data.draw(st.integers(1, len(whole)))
        found, rest = split(rest + whole[:cut])
        keys += found
        whole = whole[cut:]
    meant = {"\x1b[A": "up", "\x1bOB": "down", "A": "a", "\r": "enter", "5": "5"}
    assert [key for key in keys if key] == [meant[key] for key in sent if key in meant]
    assert rest == b""


def test_the_whole_screen_fits_80_columns_by_24_rows() -> None:
    session = after(begin(HOME), all_taught())
    observation = Observation(time_s=0.0, pose=HOME, compression_m=0.0, views={"side": VIEW})
    shown = render(session, observation, scene_of(), title="a long title " * 9, size=(80, 24))
    console = Console(width=80, file=StringIO())
    lines = console.render_lines(shown)
    assert len(lines) <= 24
    text = "".join(segment.text for line in lines for segment in line)
    for word in ("done", "Enter writes the goals", "tip y", "hole y", "freedrive", "Ctrl-C", "▀"):
        assert word in text


# --- recording -----------------------------------------------------------------------------------


def test_the_five_formations_are_taught_in_order_and_become_goals() -> None:
    session = after(begin(HOME), all_taught())
    assert session.formation is None
    _, command = s.decide(session, INTENTS["enter"], Limits())
    assert command == s.Finish()
    goals = session.teaching("circle").goals
    assert goals.target(Formation.INSERTION).z == pytest.approx(0.1678)
    for formation, record in session.records.items():
        assert goals.target(formation) == record.goal


@given(st.lists(st.sampled_from(sorted(INTENTS.keys() - {"q", "f"})), max_size=80))
def test_whatever_is_pressed_what_is_taught_is_what_a_trial_would_command(keys: list[str]) -> None:
    session = after(after(begin(HOME), all_taught()), keys)
    assert set(session.records) | set(session.open()) == set(Formation)
    if session.open():
        return
    goals = session.teaching("circle").goals
    for formation, record in session.records.items():
        error = goals.target(formation).error(record.goal, Axis)
        assert all(abs(a.to_report(e)) < 0.06 for a, e in error.items())


def test_a_pose_that_the_formations_before_would_not_lead_to_is_not_recorded() -> None:
    taught = after(begin(HOME), [*PRESSES[0][2], "enter"])
    moved = after(taught, ["s", "d", "enter"])
    assert Formation.CONTACT not in moved.records
    assert "contact keeps y 26.0 mm" in moved.note
    back = after(moved, ["=", "enter"])
    assert back.records[Formation.CONTACT].goal.y == pytest.approx(0.026)


def test_teaching_a_formation_again_reopens_those_that_relied_on_it() -> None:
    taught = after(begin(HOME), all_taught())
    changed = after(taught, ["b"] * 5 + ["g", "d", "enter"])
    assert changed.records[Formation.APPROACH].goal.y > 0.026
    assert changed.open() == [Formation.CONTACT]  # the later ones set y, z themselves
    assert changed.formation is Formation.CONTACT
    assert "teach contact again" in changed.note


def test_undo_gives_back_what_was_recorded_before() -> None:
    once = after(begin(HOME), ["enter"])
    twice = after(once, ["b", "d", "enter"])
    undone = after(twice, ["u"])
    assert undone.formation is Formation.APPROACH
    assert undone.records[Formation.APPROACH] is once.records[Formation.APPROACH]
    assert "nothing to undo" in after(undone, ["u", "u"]).note


def test_a_picture_without_the_peg_is_not_recorded() -> None:
    robot = ScriptedRobot()
    teacher = Teacher(robot, load_task("circle"), place_in(Path("unused")))
    teacher.press("enter")
    assert "not recorded: no hole" in teacher.session.note
    assert not teacher.session.log


def test_a_step_out_of_the_workspace_is_not_even_asked_of_the_envelope() -> None:
    session = after(begin(HOME), ["3", *["d"] * 12])
    assert session.at.y == pytest.approx(0.09)
    assert "not moved: y 100.0 mm is outside" in session.note


def test_after_a_compression_stop_the_arm_is_where_the_wrist_stopped_it() -> None:
    start = begin(HOME)
    target = start.at.updated({Axis.Z: 0.234})
    ended = Pose(x=0.0001, y=0.0001, z=0.2371)
    session = s.moved(start, target, motion_to(target, ended, Stop.COMPRESSION))
    assert_at(session.at, Pose(z=0.2371))
    assert "the wrist is pressed by 20.0 mm" in session.note


# --- on a robot ----------------------------------------------------------------------------------


class Pressed:
    """Keys that come in batches, and those that come while the arm moves; then q."""

    def __init__(self, batches: Sequence[Sequence[str]], during: Sequence[Sequence[str]]) -> None:
        self.batches, self.during = list(batches), list(during)

    def wait(self, seconds: float) -> list[str]:
        if seconds == 0.0:
            return list(self.during.pop(0)) if self.during else []
        return list(self.batches.pop(0)) if self.batches else ["q"]


class Led(ScriptedRobot):
    """A robot that a hand can lead."""

    def freedrive(self, on: bool) -> None:
        self._called(f"freedrive {on}")


def place_in(folder: Path) -> Place:
    return Place(out=folder / "goals.yaml", cell=None, peg="circle")


def run(
    robot: Robot,
    folder: Path,
    *batches: Sequence[str],
    during: Sequence[Sequence[str]] = (),
) -> bool:
    teacher = Teacher(robot, load_task("circle"), place_in(folder))
    return teach(teacher, Pressed(batches, during), lambda *_: None)


def test_motions_are_slow_and_stop_at_the_compression_limit(tmp_path: Path) -> None:
    robot = ScriptedRobot()
    run(robot, tmp_path, ["3"], ["s"])
    assert robot.speeds == [0.02]
    assert robot.compression_limits == [Limits().compression_m]


def test_keys_pressed_during_a_motion_are_dropped_but_the_one_that_stops(tmp_path: Path) -> None:
    robot = ScriptedRobot()
    run(robot, tmp_path, ["3", "d", "d"], ["d"], ["d"], during=[["d", "d"], ["d", "q"]])
    assert [p.y for p in robot.poses] == pytest.approx([0.010, 0.020])
    assert robot.calls[-1] == "halt"


def test_a_stop_among_other_keys_comes_first(tmp_path: Path) -> None:
    robot = ScriptedRobot()
    run(robot, tmp_path, ["d", "q"])
    assert not robot.poses
    assert robot.calls[-1] == "halt"


def test_a_fault_ends_teaching(tmp_path: Path) -> None:
    with pytest.raises(RobotFault):
        run(ScriptedRobot(fault=("move_to", 1)), tmp_path, ["d"])


def test_a_robot_that_can_be_led_is_held_again_where_it_was_led_to(tmp_path: Path) -> None:
    robot = Led()
    teacher = Teacher(robot, load_task("circle"), place_in(tmp_path))
    teacher.press("f")
    teacher.press("d")
    assert not robot.poses
    robot.pose = Pose(y=0.02004, z=0.2)
    teacher.press("f")
    assert [c for c in robot.calls if "freedrive" in c] == ["freedrive True", "freedrive False"]
    assert_at(teacher.session.at, Pose(y=0.02, z=0.2))


def test_a_hand_that_leads_out_of_the_workspace_is_ended(tmp_path: Path) -> None:
    robot = Led()
    teacher = Teacher(robot, load_task("circle"), place_in(tmp_path))
    teacher.press("f")
    robot.pose = Pose(y=0.2, z=0.2)
    teacher.idle()
    assert robot.calls.count("freedrive False") == 1
    assert not teacher.session.is_guided


def test_the_simulated_cell_has_no_freedrive(tmp_path: Path) -> None:
    teacher = Teacher(ScriptedRobot(), load_task("circle"), place_in(tmp_path))
    teacher.press("f")
    assert "no freedrive" in teacher.session.note


def test_what_was_recorded_survives_a_crash_and_is_undone_on_the_disk_too(tmp_path: Path) -> None:
    task, place = load_task("circle"), place_in(tmp_path)
    teacher = Teacher(prepared(), task, place)
    for key in [*PRESSES[0][2], "enter", "3", "s", "enter"]:
        teacher.press(key)
    resumed = Teacher(prepared(), task, place).session
    assert list(resumed.records) == [Formation.APPROACH, Formation.CONTACT]
    for formation, record in teacher.session.records.items():
        assert resumed.records[formation].goal == record.goal
        assert resumed.records[formation].pose == record.pose
        assert np.array_equal(resumed.records[formation].view.image, record.view.image)
    teacher.press("u")
    assert list(Teacher(prepared(), task, place).session.records) == [Formation.APPROACH]


@pytest.mark.parametrize("name", ["0-approach.png", "draft.yaml"])
def test_a_draft_is_not_written_through_a_link(tmp_path: Path, name: str) -> None:
    teacher = Teacher(prepared(), load_task("circle"), place_in(tmp_path))
    teacher.press("enter")
    mine, link = tmp_path / "mine", tmp_path / "goals.draft" / name
    link.rename(mine)
    before = mine.read_bytes()
    link.symlink_to(mine)
    teacher.press("u")
    teacher.press("enter")
    assert mine.read_bytes() == before
    assert not link.is_symlink()


def test_goals_are_written_as_they_are_loaded_and_the_draft_goes(tmp_path: Path) -> None:
    place = place_in(tmp_path)
    assert run(prepared(), tmp_path, *[[key] for key in all_taught()], ["enter"])
    taught = load(place.out)
    for formation, goal in taught.goals.formations.items():
        assert set(goal) == set(OWNED[formation])
    assert taught.goals.formations[Formation.FIT] == {Axis.Y: pytest.approx(-0.035)}
    assert not place.draft.folder.exists()
    with pytest.raises(InputError, match="not overwritten"):
        place.check()


def test_a_draft_of_another_cell_or_peg_or_a_broken_one_is_refused(tmp_path: Path) -> None:
    teacher = Teacher(prepared(), load_task("circle"), place_in(tmp_path))
    teacher.press("enter")
    folder = tmp_path / "goals.draft"
    with pytest.raises(InputError, match="has peg 'circle', not 'square'"):
        Draft(folder=folder, cell=None, peg="square").load()
    (folder / "0-approach.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"cannot be used .*is no PNG"):
        Draft(folder=folder, cell=None, peg="circle").load()
    (folder / "draft.yaml").write_text("[]", encoding="utf-8")
    with pytest.raises(InputError, match="holds no fields; remove its folder to begin anew"):
        Draft(folder=folder, cell=None, peg="circle").load()
