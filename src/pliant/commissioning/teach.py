"""Teaching goals by keyboard, as the paper did (Sec. VI): keys move the arm in small steps, one
key records pose and picture, and what was recorded is on the disk at once.

Every motion goes through the envelope, at contact speed, and ends when the wrist is pressed to its
limit. Keys that were pressed while the arm moved are dropped, and of several at once only the first
may move it: nothing that lies in a buffer moves an arm.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from pliant import teaching
from pliant.cell import Observation, Robot
from pliant.commissioning import session as s
from pliant.commissioning.draft import Draft
from pliant.commissioning.keys import INTENTS, Do
from pliant.envelope import Guarded, Limits
from pliant.errors import InputError
from pliant.formations import Formation
from pliant.pose import Axis
from pliant.task import Task
from pliant.vision.measure import SIMULATED, Colours, measure
from pliant.vision.scene import Scene
from pliant.wrist import LOADED_M

CONTACT_SPEED = 0.02  # [m/s]
_AFTER_MOTION_S = 0.2
_BEFORE_PICTURE_S = 1.5  # in free hang the wrist swings
_IDLE_S = 0.5


@runtime_checkable
class KeyboardHand(Protocol):
    """A robot that can be led by hand, as an arm in freedrive. The simulated one cannot."""

    def freedrive(self, on: bool) -> None:
        """Give way to a hand, or hold the arm where it is. `halt` and leaving the robot's context
        hold it too."""
        ...


class Presses(Protocol):
    """A source of pressed keys."""

    def wait(self, seconds: float) -> list[str]: ...


Show = Callable[[s.Session, Observation, Scene], None]


@dataclass(frozen=True, kw_only=True)
class Place:
    """The place of what is taught: the goals file, and the draft beside it."""

    out: Path
    cell: Path | None  # its file; None: the simulated one
    peg: str

    @property
    def draft(self) -> Draft:
        return Draft(folder=self.out.with_suffix(".draft"), cell=self.cell, peg=self.peg)

    def check(self) -> None:
        """Refuse to write over goals that exist.

        Raises:
            InputError: the file, or a picture that would stand beside it, exists.
        """
        pictures = [self.out.parent / f"{formation}.png" for formation in Formation]
        for path in (self.out, *pictures):
            if path.exists():
                raise InputError(
                    f"'{path}' exists, and goals are not overwritten: choose another folder"
                )


class Teacher:
    """Carry out what the keys ask for while goals are taught. Use it within the robot's own
    context."""

    def __init__(
        self,
        robot: Robot,
        task: Task,
        place: Place,
        *,
        limits: Limits | None = None,
        speed_m_s: float = CONTACT_SPEED,
        colours: Colours = SIMULATED,
    ) -> None:
        """
        Raises:
            InputError: the draft cannot be used.
            RobotFault: the robot cannot.
        """
        self._limits = limits or Limits()
        self._robot, self._hand = Guarded(robot, self._limits), robot
        self._task, self._place = task, place
        self._speed, self._colours = speed_m_s, colours
        log = place.draft.load()
        self.look()
        self.session = s.begin(self.observation.pose, log)
        self.is_over = self.is_written = False

    def look(self) -> None:
        """Observe the robot and measure the picture."""
        self.observation = self._robot.observe()
        self.scene = measure(self.observation.views["side"], self._task, self._colours)

    def press(self, key: str) -> bool:
        """Do what a key asks for; return whether the arm was moved."""
        intent = INTENTS.get(key)
        if intent is None:
            return False
        before = self.session.log
        self.session, command = s.decide(
            self.session, intent, self._limits, can_guide=isinstance(self._hand, KeyboardHand)
        )
        if command is not None:
            self._carry_out(command)
        if self.session.log is not before:
            self._place.draft.save(self.session.log)
        return isinstance(command, s.MoveTo | s.Guide)

    def idle(self) -> None:
        """Look again as no key was pressed, and hold an arm that a hand led out of the
        workspace."""
        self._robot.settle(_AFTER_MOTION_S)
        self.look()
        pose = self.observation.pose
        if self.session.is_guided and self._limits.outside({a: pose[a] for a in Axis}):
            self._carry_out(s.Guide(on=False))

    def _carry_out(self, command: s.Command) -> None:
        match command:
            case s.MoveTo(pose=pose):
                motion = self._robot.move_to(
                    pose,
                    speed_m_s=self._speed,
                    stop_at_compression_m=self._limits.compression_m,
                )
                self.session = s.moved(self.session, pose, motion)
                self._robot.settle(_AFTER_MOTION_S)
                self.look()
            case s.Take():
                self._robot.settle(_BEFORE_PICTURE_S)
                self.look()
                self.session = s.taken(self.session, self.observation, self.scene)
            case s.Tare():
                self.look()
                loaded = abs(self.observation.compression_m) > LOADED_M
                if not loaded:
                    self._robot.tare()
                    self.look()
                self.session = s.tared(self.session, self.observation, loaded=loaded)
            case s.Guide(on=on):
                assert isinstance(self._hand, KeyboardHand)
                self._hand.freedrive(on)
                self.look()
                self.session = s.guided(self.session, on, self.observation.pose)
            case s.Finish():
                self._write()
            case s.Quit():
                self._robot.halt()
                self.is_over = True

    def _write(self) -> None:
        """Write the goals file, and read it back before the draft goes."""
        self._place.check()
        taught = self.session.teaching(self._place.peg, self._colours)
        try:
            teaching.save(self._place.out, taught)
        except OSError as error:
            raise InputError(
                f"'{self._place.out}' cannot be written ({error.strerror}); the draft"
                f" '{self._place.draft.folder}' is kept"
            ) from error
        teaching.load(self._place.out, self._limits, self._colours)
        self._place.draft.remove()
        self.is_over = self.is_written = True


def teach(teacher: Teacher, presses: Presses, show: Show) -> bool:
    """Obey keys until the goals are written or the person ends; return whether they are written."""
    while not teacher.is_over:
        show(teacher.session, teacher.observation, teacher.scene)
        pressed = presses.wait(_IDLE_S)
        if not pressed:
            teacher.idle()
            continue
        if not _asks_to_stop(pressed) and _press_until_it_moves(teacher, pressed):
            pressed = presses.wait(0.0)
        if _asks_to_stop(pressed):
            teacher.press("q")
    return teacher.is_written


def _press_until_it_moves(teacher: Teacher, pressed: Iterable[str]) -> bool:
    """Press the keys until one moves the arm, and drop those after it; return whether it moved."""
    return any(not teacher.is_over and teacher.press(key) for key in pressed)


def _asks_to_stop(pressed: Iterable[str]) -> bool:
    return any(INTENTS.get(key) is Do.QUIT for key in pressed)
