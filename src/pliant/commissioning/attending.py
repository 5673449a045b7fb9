"""The person at a real cell, asked at the terminal (protocol `pliant.ur5e.cell.Operator`), during
an experiment also how each trial went."""

import math
from dataclasses import replace
from pathlib import Path

from rich.prompt import Confirm, Prompt
from rich.text import Text

from pliant.cell import Truth
from pliant.conditions import Setup, in_words
from pliant.console import Console
from pliant.errors import RobotFault
from pliant.experiment.one import Spec
from pliant.records import Trial
from pliant.task import Task

_LABELS = {"y": True, "n": False, "u": None}


class AtTerminal:
    """A person at a real cell, told at the terminal what to place, and asked before the arm moves
    by itself. It gives no label."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True, highlight=False)

    def place(self, task: Task, setup: Setup) -> None:
        hole, grasp = in_words("hole_y", setup.hole_y), in_words("grasp_roll", setup.grasp_roll)
        question = (
            f"Place the hole at y {hole}; the {task.peg.name} peg in the gripper at {grasp}. Done?"
        )
        if not self._ask(question):
            raise RobotFault("interrupted", "the operator said no")

    def may_move(self, what: str) -> bool:
        return self._ask(f"The arm is going to {what}. Is the way free?")

    def truth(self) -> Truth:
        unknown = math.nan
        return Truth(
            inserted=None,
            depth_m=unknown,
            tip=(unknown, unknown, unknown),
            tilt_rad=unknown,
            hole_y=unknown,
            compression_m=unknown,
        )

    def _ask(self, question: str) -> bool:
        try:
            return Confirm.ask(question, console=self._console, default=False)
        except EOFError as error:
            raise RobotFault("interrupted", "nobody is at the terminal") from error


class Attending(AtTerminal):
    """The person at a real cell, asked at the terminal about each trial. Stopping is always an
    answer: what is finished is kept."""

    def __init__(self, console: Console | None = None, *, one_trial: bool = False) -> None:
        """Ask on `console`; `one_trial`: there is no later trial to go on to."""
        super().__init__(console)
        self._one_trial = one_trial
        self._hole_y = math.nan
        self._has_left = False

    def begin(self, spec: Spec) -> None:
        """Announce a trial. Raises KeyboardInterrupt when the person has said that this is all."""
        if self._has_left:
            raise KeyboardInterrupt
        line = Text(f"\n{spec.condition.name}", style="bold")
        line.append(f", trial with seed {spec.seed}", style="not bold")
        self._console.print(line)

    def place(self, task: Task, setup: Setup) -> None:
        """Ask the person to place hole and peg. Raises RobotFault "skipped" or "interrupted" when
        it is not done."""
        self._hole_y = setup.hole_y
        self._console.print(f"  peg    {task.peg.name}, held between the fingers")
        self._console.print(f"  hole   {hole_in_words(setup.hole_y)}")
        self._console.print(f"  grasp  {grasp_in_words(setup.grasp_roll)}")
        choices = {"y": "it is placed", "s": "skip this trial for now", "q": "stop here"}
        if self._one_trial:
            del choices["s"]
        answer = self._choice("Is it placed?", choices, at_the_end="q")
        if answer == "s":
            raise RobotFault("skipped", "the operator left it for later")
        if answer == "q":
            raise RobotFault("interrupted", "the operator stopped")

    def truth(self) -> Truth:
        """The truth as far as it is known: the hole's y; the rest is not known until somebody
        labels it."""
        return replace(super().truth(), hole_y=self._hole_y)

    def label(self, trial: Trial, picture: Path) -> bool | None:
        """Ask the person whether the peg is inserted; None: not known yet. Whoever leaves instead
        of answering has not labelled it, and there is no next one: KeyboardInterrupt."""
        if self._has_left:
            raise KeyboardInterrupt
        if trial.fault:
            self._console.print(f"ended by {trial.end_reason}: {trial.fault}")
        self._console.print(f"last picture: {picture}", soft_wrap=True)
        choices = {"y": "10 mm deep or more", "n": "no", "u": "unknown: label it later"}
        answer = self._choice("Is the peg inserted?", choices, at_the_end="")
        self._has_left = not answer
        inserted = _LABELS[answer or "u"]
        judged = "inserted" if trial.judged else "not inserted"
        self._console.print(f"judged {judged} ({trial.end_reason})")
        return inserted

    def _choice(self, question: str, choices: dict[str, str], at_the_end: str) -> str:
        """Ask for one of the keys of `choices`; `at_the_end` when the person or the terminal
        leaves."""
        named = ", ".join(f"{key}: {meaning}" for key, meaning in choices.items())
        try:
            return Prompt.ask(f"{question} ({named})", console=self._console, choices=list(choices))
        except (EOFError, KeyboardInterrupt):
            self._console.print()
            return at_the_end


def hole_in_words(y: float) -> str:
    """Say for a person beside the board where the hole is to be, y [m]."""
    if round(y * 1e3, 1) == 0:
        return "at its nominal place"
    picture, robot = ("right", "left") if y > 0 else ("left", "right")
    return (
        f"{abs(y) * 1e3:.1f} mm from its nominal place, to the {picture} in the camera's picture"
        f" (the robot's {robot})"
    )


def grasp_in_words(roll: float) -> str:
    """Say for a person how the peg is to be gripped, roll [rad]."""
    if round(math.degrees(roll), 1) == 0:
        return "straight"
    side = "right" if roll > 0 else "left"
    return f"{abs(math.degrees(roll)):.1f}°, the peg's tip to the {side} in the camera's picture"
