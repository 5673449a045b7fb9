"""The measurements in one picture: pixels as in the paper, metres through the calibration."""

import math
from dataclasses import dataclass
from typing import Any

from pliant.task import Place

Pixel = tuple[float, float]
"""A pixel (column, row); columns grow toward +y, rows downward."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A value [m or rad] and its standard deviation."""

    value: float
    sd: float

    def __neg__(self) -> "Measured":
        return Measured(value=-self.value, sd=self.sd)

    def plus(self, by: float) -> "Measured":
        """This value and `by`, as sure."""
        return Measured(value=self.value + by, sd=self.sd)


@dataclass(frozen=True, kw_only=True)
class PegSeen:
    """The peg as the picture shows it.

    `box_px` are the corners of the minimum-area rectangle around the visible peg; P_center and
    P_edge of Table I are its centre and its bottom-right corner. Tilt is positive to the left.
    The metric corners are those of the whole peg, also where the hole hides it: its visible top
    edge plus its known length.
    """

    box_px: tuple[Pixel, Pixel, Pixel, Pixel]
    center_px: Pixel
    edge_px: Pixel
    tilt_deg: float  # of the minimum-area rectangle
    tilt: Measured  # [rad], from the peg's two long edges
    tip_y: Measured  # centre of the bottom face [m]
    tip_z: Measured
    left_y: float  # bottom-left corner [m]
    left_z: float
    right_y: float  # bottom-right corner [m]
    right_z: float
    wider: Measured | None = None  # than the task's peg [m]; None: its width is taken as known
    longer: Measured | None = None  # than the task's peg [m]; None: its lower end was not seen


def peg_at(
    y: Measured, z: Measured, tilt: Measured, edges: tuple[Place, Place], **more: Any
) -> PegSeen:
    """A peg whose tip is at y and z, with its bottom corners as far from there as these edges of it
    are from its axis; `more` are its pixels and what else is known of it."""
    cos, sin = math.cos(tilt.value), math.sin(tilt.value)
    (left, _), (right, _) = edges
    return PegSeen(
        tilt=tilt,
        tip_y=y,
        tip_z=z,
        left_y=y.value + left * cos,
        left_z=z.value + left * sin,
        right_y=y.value + right * cos,
        right_z=z.value + right * sin,
        **more,
    )


@dataclass(frozen=True, kw_only=True)
class HoleSeen:
    """The block with the hole: H_center of Table I, and the same in metres."""

    box_px: tuple[Pixel, Pixel, Pixel, Pixel]
    center_px: Pixel
    y: Measured  # hole centre [m]
    surface_z: Measured  # the board's surface [m]


@dataclass(frozen=True, kw_only=True)
class Across:
    """The measurements that the front camera adds: across the plane that the side camera sees.
    None: not seen."""

    tip_x: Measured | None  # centre of the peg's bottom face [m]
    pitch: Measured | None  # [rad], of the peg
    hole_x: Measured | None  # [m]
    wider: Measured | None = None  # than the task's peg [m], as in PegSeen


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The measurements in the pictures of one moment: the side picture, and the front and the
    oblique one where they were taken. What could not be measured is None; `problems` says why.
    `doubts` says where two ways of measuring contradict each other, and which is believed."""

    peg: PegSeen | None
    hole: HoleSeen | None
    problems: tuple[str, ...] = ()
    time_s: float = 0.0
    across: Across | None = None
    board_yaw: Measured | None = None  # [rad]
    doubts: tuple[str, ...] = ()
