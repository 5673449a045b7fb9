"""The oracle: plans as the rules do, with the truth in place of every measurement.

It exists in simulation only, as the upper bound on what better seeing could give these rules. It
judges as the other controls do, so that the rows compare.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pliant.belief import Belief
from pliant.cell import Truth
from pliant.conditions import Setup
from pliant.reasoners.rules import Rules
from pliant.records import Case, Look, Recovery, Verdict
from pliant.task import Task
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Scene

NAME = "oracle"
_NOWHERE = (0.0, 0.0)
_NO_BOX = (_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE)


@dataclass(frozen=True)
class Oracle(Rules):
    """The rules, planning from `truth`, the cell's, and `setup`, what was drawn."""

    name: str = NAME
    truth: Callable[[], Truth] | None = None
    setup: Setup | None = None

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        assert self.truth is not None, "the experiment gives the oracle its truth"
        assert self.setup is not None, "the experiment gives the oracle its setup"
        truth = self.truth()
        outcome = case.outcome
        last = outcome.looks[-1]
        seen = Look(observation=last.observation, scene=_as_seen(truth, case.task))
        belief = Belief(
            hole_y=_exactly(truth.hole_y),
            grasp_roll=_exactly(self.setup.grasp_roll),
            surface_z=_exactly(_surface_z(truth)),
        )
        known = replace(
            case, outcome=replace(outcome, looks=(*outcome.looks[:-1], seen)), belief=belief
        )
        return super().recover(known, verdict)


def _as_seen(truth: Truth, task: Task) -> Scene:
    """The truth as a measurement without error; the pixels, which no plan reads, are void."""
    _, y, z = truth.tip
    half = task.peg.half_extents[1]
    dy, dz = half * math.cos(truth.tilt_rad), half * math.sin(truth.tilt_rad)
    return Scene(
        peg=PegSeen(
            box_px=_NO_BOX,
            center_px=_NOWHERE,
            edge_px=_NOWHERE,
            tilt_deg=math.degrees(truth.tilt_rad),
            tilt=_exactly(truth.tilt_rad),
            tip_y=_exactly(y),
            tip_z=_exactly(z),
            left_y=y - dy,
            left_z=z - dz,
            right_y=y + dy,
            right_z=z + dz,
        ),
        hole=HoleSeen(
            box_px=_NO_BOX,
            center_px=_NOWHERE,
            y=_exactly(truth.hole_y),
            surface_z=_exactly(_surface_z(truth)),
        ),
    )


def _surface_z(truth: Truth) -> float:
    """The height [m] of the board's surface where the hole is."""
    return truth.tip[2] + truth.depth_m


def _exactly(value: float) -> Measured:
    return Measured(value=value, sd=0.0)
