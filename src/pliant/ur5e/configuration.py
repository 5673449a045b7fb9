"""The cell's file: everything about one real cell that a person measures, chooses or calibrates.

One YAML file; `example.yaml` beside this module explains each field. Millimetres and degrees in the
file, with the unit in the field's name; SI units and radians from the properties.
"""

import math
from collections.abc import Sequence
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, field_validator, model_validator

from pliant import cell, files
from pliant.files import Fields
from pliant.pose import Axis, Pose, rotation_matrix
from pliant.ur5e.protocol import ADMIN_PORT, GRIPPER_PORT

Transform = NDArray[np.float64]
"""A rigid transform (4, 4) [m]."""

Length = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]  # [mm]
Angle = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]  # [deg]
Port = Annotated[int, Field(ge=1, le=65535)]
Byte = Annotated[int, Field(ge=0, le=255)]
Hsv = tuple[Annotated[int, Field(ge=0, le=179)], Byte, Byte]
KIND = "cell file"


class ArmSettings(Fields):
    """The arm: how its controller is reached, and how it brakes."""

    address: Annotated[str, Field(min_length=1)]
    stop_mm_s2: Annotated[float, Field(ge=500, le=10_000)] = 3000.0
    ramp_s: Annotated[float, Field(ge=0.05, le=2.0)] = 0.15  # from rest to full speed
    speed_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  # the pendant's speed slider
    watchdog_hz: Annotated[float, Field(ge=2.0, le=50.0)] = 10.0


class _Place(Fields):
    x_mm: Length
    y_mm: Length
    z_mm: Length

    @property
    def position(self) -> list[float]:  # (3,) [m]
        return [v * 1e-3 for v in (self.x_mm, self.y_mm, self.z_mm)]


class TcpSettings(_Place):
    """The wrist's hinge point on the flange, as on the pendant: the rotation is a vector."""

    rx_deg: Angle
    ry_deg: Angle
    rz_deg: Angle

    @property
    def pose(self) -> list[float]:  # (6,) [m, rad] as UR writes poses
        return self.position + [math.radians(v) for v in (self.rx_deg, self.ry_deg, self.rz_deg)]


class PayloadSettings(Fields):
    """The payload that hangs on the flange: wrist, gripper and peg."""

    mass_kg: Annotated[float, Field(gt=0.0, le=5.0)]
    center_mm: tuple[Length, Length, Length]

    @property
    def center_m(self) -> list[float]:  # (3,)
        return [v * 1e-3 for v in self.center_mm]


class FrameSettings(_Place):
    """The task frame in the arm's base frame."""

    roll_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    yaw_deg: Angle = 0.0

    @property
    def transform(self) -> Transform:
        """The transform from task to base coordinates."""
        angles = (self.roll_deg, self.pitch_deg, self.yaw_deg)
        return placed(self.position, rotation_matrix(*map(math.radians, angles)))


class WorkspaceSettings(Fields):
    """The workspace of the hinge point: [from, to] per axis, in the task frame."""

    x_mm: tuple[Length, Length]
    y_mm: tuple[Length, Length]
    z_mm: tuple[Length, Length]
    roll_deg: tuple[Angle, Angle]
    pitch_deg: tuple[Angle, Angle]
    yaw_deg: tuple[Angle, Angle]

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for name in type(self).model_fields:
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name}: the first number must be below the second")
        return self

    @property
    def low(self) -> Pose:
        return self._corner(0)

    @property
    def high(self) -> Pose:
        return self._corner(1)

    def _corner(self, which: int) -> Pose:
        ranges = {axis: getattr(self, f"{axis}_{axis.report_unit}") for axis in Axis}
        return Pose().updated({a: a.from_report(r[which]) for a, r in ranges.items()})


class LimitsSettings(Fields):
    """The limits of the cell: how fast, how hard, how far."""

    speed_mm_s: Annotated[float, Field(gt=0.0, le=250.0)] = 100.0
    contact_speed_mm_s: Annotated[float, Field(gt=0.0, le=20.0)] = 20.0  # faster, it stops too late
    free_above_mm: Annotated[float, Field(ge=0.0, le=100.0)] = 10.0
    compression_mm: Annotated[float, Field(gt=0.0, le=40.0)] = 20.0
    goal_step_mm: Annotated[float, Field(gt=0.0, le=100.0)] = 45.0


class WristSettings(Fields):
    """The wrist: how the force becomes compression."""

    stiffness_n_mm: Annotated[float, Field(gt=0.0, le=100.0)]
    axis: Literal["x", "y", "z"] = "z"
    sign: Literal[1, -1] = 1
    filter_ms: Annotated[float, Field(ge=0.0, le=100.0)] = 20.0


class GripperSettings(Fields):
    """The Robotiq 2F-85 behind its URCap socket."""

    port: Port = GRIPPER_PORT
    force: Byte = 150
    speed: Byte = 100
    closed_at: Byte = 255
    open_at: Byte = 0


class CameraSource(StrEnum):
    """The kind of source that the camera's pictures come from."""

    REALSENSE = "realsense"
    OPENCV = "opencv"
    HTTP = "http"
    FILE = "file"


class CameraSettings(Fields):
    """The side camera, and where it stands in the task frame."""

    source: CameraSource
    where: str = ""
    width: Annotated[int, Field(ge=64, le=4096)] = 640
    height: Annotated[int, Field(ge=64, le=4096)] = 480
    fps: Annotated[int, Field(ge=1, le=120)] = 30
    exposure_us: Annotated[int, Field(ge=1, le=200_000)] | None = None
    white_balance_k: Annotated[int, Field(ge=2000, le=10_000)] | None = None
    latency_ms: Annotated[float, Field(ge=0.0, le=1000.0)] = 100.0
    focal_px: Annotated[float, Field(gt=10.0, le=100_000.0)]
    position_mm: tuple[Length, Length, Length]
    rotation_deg: tuple[Angle, Angle, Angle]

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if self.source is not CameraSource.REALSENSE and not self.where:
            raise ValueError(
                f"where: the source {self.source} needs a device, an address or a file"
            )
        return self

    @property
    def calibration(self) -> cell.Camera:
        return cell.Camera(
            name="side",
            width=self.width,
            height=self.height,
            focal_px=self.focal_px,
            position=np.array(self.position_mm) * 1e-3,
            rotation=rotation_matrix(*map(math.radians, self.rotation_deg)),
        )


class ColoursSettings(Fields):
    """HSV ranges, each [low, high]: hue 0 to 179, saturation and value 0 to 255."""

    peg: tuple[tuple[Hsv, Hsv], ...] = Field(min_length=1)
    block: tuple[tuple[Hsv, Hsv], ...] = Field(min_length=1)


class PatienceSettings(Fields):
    """The longest that anything may take before the cell counts as broken. All of pliant's waits
    for a cell are these."""

    stamp_ms: Annotated[float, Field(ge=20.0, le=60_000.0)] = 100.0
    driver_ms: Annotated[float, Field(ge=200.0, le=60_000.0)] = 1000.0
    dashboard_ms: Annotated[float, Field(ge=50.0, le=60_000.0)] = 300.0
    picture_ms: Annotated[float, Field(ge=100.0, le=60_000.0)] = 1500.0
    gripper_ms: Annotated[float, Field(ge=20.0, le=60_000.0)] = 200.0
    connect_ms: Annotated[float, Field(ge=500.0, le=120_000.0)] = 10_000.0

    @model_validator(mode="after")
    def _in_turn(self) -> Self:
        if not self.driver_ms > self.stamp_ms:
            raise ValueError(
                f"driver_ms {self.driver_ms:g}: it must be above stamp_ms, {self.stamp_ms:g}, since"
                " the driver waits that long for the controller"
            )
        return self


class EmulatorSettings(Fields):
    """The emulator of an emulated cell: experiments set up its trials, and learn the truth, through
    it."""

    admin_port: Port = ADMIN_PORT
    ticks_per_look: Annotated[int, Field(ge=1, le=10)] = 5


class Configuration(Fields):
    """The configuration of one cell. A file that lacks a section with defaults has them."""

    arm: ArmSettings
    tcp: TcpSettings
    payload: PayloadSettings
    task_frame: FrameSettings
    workspace: WorkspaceSettings
    limits: LimitsSettings = LimitsSettings()
    wrist: WristSettings
    gripper: GripperSettings | None = GripperSettings()
    camera: CameraSettings
    colours: ColoursSettings | None = None
    goals: Path | None = None
    patience: PatienceSettings = PatienceSettings()
    emulator: EmulatorSettings | None = None

    @field_validator("goals", mode="before")
    @classmethod
    def _a_file(cls, goals: Any) -> Any:
        if goals == "":
            raise ValueError("it must be a file's path; null: the shipped goals")
        return goals

    @property
    def kind(self) -> str:
        """The kind of cell, as `cell.Workcell.kind` names it."""
        return "ur5e" if self.emulator is None else "emulator"


_CONFIGURATION = TypeAdapter(Configuration)


def load(path: Path) -> Configuration:
    """Read a cell's file. A relative path in it counts from its folder.

    Raises:
        InputError: the file cannot be read, or a field is missing, unknown or out of range.
    """
    example = resources.files("pliant") / "ur5e" / "example.yaml"
    document = files.read_yaml(path, KIND, f"start from {example}")
    return _from_folder(checked(document), path.parent)


def checked(document: files.Document) -> Configuration:
    """The configuration in a cell's file, with relative paths as they are written. Raises as `load`
    does."""
    document.fields()
    return files.checked(document, _CONFIGURATION)


def save(path: Path, configuration: Configuration) -> None:
    """Write a cell's file as `load` reads it, without comments.

    Raises:
        InputError: it cannot be written.
    """
    data = configuration.model_dump(mode="json", exclude_none=True)
    if configuration.gripper is None:
        data["gripper"] = None  # absent means the usual one
    files.write_text(path, files.yaml_text(data))


def _from_folder(configuration: Configuration, folder: Path) -> Configuration:
    camera, goals = configuration.camera, configuration.goals
    changes: dict[str, Any] = {}
    if camera.source is CameraSource.FILE:
        changes["camera"] = camera.model_copy(update={"where": str(folder / camera.where)})
    if goals is not None:
        changes["goals"] = folder / goals
    return configuration.model_copy(update=changes)


# --- transforms, and poses as the controller writes them -----------------------------------------


def placed(position: Sequence[float] | NDArray[Any], rotation: NDArray[Any]) -> Transform:
    """The transform with a position (3,) and a rotation matrix (3, 3)."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rotation, position
    return result


def transform(pose: list[float]) -> Transform:
    """The transform of a pose (6,): position [m] and rotation vector [rad]."""
    return placed(pose[:3], cv2.Rodrigues(np.asarray(pose[3:], dtype=float))[0])


def ur_pose(matrix: Transform) -> list[float]:
    """The pose (6,) of a transform, to 0.00001 rad."""
    vector = cv2.Rodrigues(np.ascontiguousarray(matrix[:3, :3]))[0].ravel()
    return [float(v) for v in (*matrix[:3, 3], *vector)]
