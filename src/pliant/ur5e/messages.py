"""The messages between the trial's process and the driver's. Poses are in the task frame."""

from dataclasses import dataclass

from pliant.cell import Trace
from pliant.pose import Pose
from pliant.wrist import SensorAnswer


@dataclass(frozen=True, kw_only=True)
class Connect:
    """Reach the controller and the gripper."""


@dataclass(frozen=True, kw_only=True)
class SetUp:
    """Set up tool, payload, watchdog; `holds`: the peg must be in the gripper, and stay there."""

    holds: bool


@dataclass(frozen=True, kw_only=True)
class Tare:
    """Count compression from here, at rest in free hang."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """Move straight to a pose [m/s, m]."""

    pose: Pose
    speed_m_s: float
    stop_at_compression_m: float


@dataclass(frozen=True, kw_only=True)
class Permits:
    """Ask whether the controller's own safety limits let the arm be there."""

    pose: Pose


@dataclass(frozen=True, kw_only=True)
class Weigh:
    """Measure by how much compression changes [m] while the controller believes in a lighter
    payload [kg]: the weight that it no longer makes up for stretches the wrist."""

    lighter_kg: float


@dataclass(frozen=True, kw_only=True)
class Wait:
    """Wait on the controller's clock."""

    seconds: float


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Measure where the arm is now."""


@dataclass(frozen=True, kw_only=True)
class Fingers:
    """Close on a peg, or open."""

    close: bool


@dataclass(frozen=True, kw_only=True)
class Freedrive:
    """Give way to a hand, or hold the arm where it is."""

    on: bool


@dataclass(frozen=True, kw_only=True)
class Halt:
    """Brake. With `why` it ends whatever is under way, and the driver, as that fault."""

    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Close:
    """Say goodbye."""


Request = (
    Connect
    | SetUp
    | Tare
    | Move
    | Permits
    | Weigh
    | Wait
    | Measure
    | Fingers
    | Freedrive
    | Halt
    | Close
)


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


Result = ArmReading | Moved | bool | float | None


@dataclass(frozen=True, kw_only=True)
class Alive:
    """Sign of life: the driver works on the request."""


@dataclass(frozen=True, kw_only=True)
class Done:
    """The request has been done."""

    result: Result = None


@dataclass(frozen=True, kw_only=True)
class Failed:
    """A RobotFault, or an InputError where `kind` is empty. The driver ends after it."""

    kind: str
    message: str
