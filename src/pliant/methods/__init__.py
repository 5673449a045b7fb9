"""The protocol of a method: all that is one way of inserting, in one object. `planar` is the
paper's, `guided` ours; yours is a file.

A method is stateless, and one for all trials. What a trial needs to remember is in its sight, its
skill and its belief, which the loop makes and keeps.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from pliant.belief import Belief, Seen
from pliant.cell import Robot
from pliant.diagnosis import Sign
from pliant.envelope import Limits
from pliant.formations import Step
from pliant.pose import Pose
from pliant.records import Evidence, Execution, KnownMethod, Looking, Outcome, Probe, Probed
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.measure import Colours
from pliant.vision.sight import Sight


class Skill(Protocol):
    """Executes a step on the robot, looking when it has come to rest."""

    def __call__(
        self, robot: Robot, look: Looking, target: Pose, step: Step, belief: Belief
    ) -> Outcome: ...


class Prober(Protocol):
    """Makes a probe on the robot, which may be anywhere; the peg hangs clear of the board
    afterwards."""

    def __call__(self, robot: Robot, look: Looking, probe: Probe, belief: Belief) -> Probed: ...


class Method(KnownMethod, Protocol):
    """One way of inserting: how it sees, moves, believes and checks, and what a reasoner knows of
    it."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras that its skills look with."""
        ...

    @property
    def retakes(self) -> int:
        """The number of times that a picture which turns out to be stale is taken again."""
        ...

    def sight(self, task: Task, teaching: Teaching, colours: Colours | None) -> Sight:
        """The sight that measures the pictures of one trial. `colours` None: they may be
        anything."""
        ...

    def skill(self, task: Task, teaching: Teaching, limits: Limits) -> Skill:
        """The skill that executes the steps of one trial."""
        ...

    @property
    def prober(self) -> Callable[[Task, Teaching, Limits], Prober] | None:
        """Makes the prober of one trial; None: the method has no probes."""
        ...

    def believe(self, belief: Belief, look: Seen, teaching: Teaching) -> Belief:
        """The belief after one more look."""
        ...

    def signs(
        self, task: Task, history: Sequence[Execution], outcome: Outcome, belief: Belief
    ) -> Sequence[Sign] | None:
        """All that so far does not fit the task; `outcome` and `belief` are of the execution that
        has just ended. None: the method does not look for such things."""
        ...

    def check(self, task: Task, outcome: Outcome, belief: Belief, teaching: Teaching) -> Evidence:
        """Every check that the executed formation calls for."""
        ...
