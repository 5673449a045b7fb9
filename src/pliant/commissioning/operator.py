"""The person at a real cell, asked at the terminal (protocol `pliant.ur5e.cell.Operator`)."""

import math

from rich.prompt import Confirm

from pliant.cell import Truth
from pliant.conditions import Setup, in_words
from pliant.console import Console
from pliant.errors import RobotFault
from pliant.task import Task


class AtTerminal:
    """A person at a real cell, told at the terminal what to place, and asked before the arm moves
    by itself. It gives no label."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True, highlight=False)

    def place(self, task: Task, setup: Setup) -> None:
        hole, grasp = in_words("hole_y", setup.hole_y), in_words("grasp_roll", setup.grasp_roll)
        self._agree(
            f"Place the hole at y {hole}; the {task.peg.name} peg in the gripper at {grasp}. Done?"
        )

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

    def _agree(self, question: str) -> None:
        if not self._ask(question):
            raise RobotFault("interrupted", "the operator said no")

    def _ask(self, question: str) -> bool:
        try:
            return Confirm.ask(question, console=self._console, default=False)
        except EOFError as error:
            raise RobotFault("interrupted", "nobody is at the terminal") from error
