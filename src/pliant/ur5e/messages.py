"""The messages between the trial's process and the driver's. Poses are in the task frame.

A request is a call of one of the driver's own methods (`driver_process.ArmDriver`).
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from pliant.cell import Trace
from pliant.pose import Pose
from pliant.wrist import SensorAnswer


@dataclass(frozen=True, kw_only=True)
class Interrupt:
    """End whatever is under way, and the driver, as the fault "interrupted"."""

    why: str


class Word(Enum):
    """What is said without anything more."""

    CLOSE = auto()  # goodbye
    ALIVE = auto()  # the driver works on the request


@dataclass(frozen=True, kw_only=True)
class ArmReading:
    """The arm at one moment; the time is the controller's."""

    time_s: float
    pose: Pose
    compression_m: float
    compression_sd_m: float  # of it, by the noise of the readings


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """The end of a motion, and 20 samples a second of it."""

    is_reached: bool  # False: stopped by compression
    peak_compression_m: float
    started_s: float
    ended: ArmReading
    trace: Trace  # on the controller's clock
    answer: SensorAnswer | None


@dataclass(frozen=True, kw_only=True)
class Done:
    """The request has been done."""

    result: Any


@dataclass(frozen=True, kw_only=True)
class Failed:
    """A RobotFault, or an InputError where `kind` is empty. The driver ends after it."""

    kind: str
    message: str
