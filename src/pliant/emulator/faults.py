"""Faults to order: now, through the admin port, or at a time of the trial, from a file.

A fault file is a YAML list; `at_s` counts from the trial's set-up, on the controller's clock:

    - {at_s: 2.5, kind: protective_stop}
    - {at_s: 4.0, kind: stall, seconds: 1.0}
"""

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from pliant import files
from pliant.emulator.block import CameraFault
from pliant.errors import InputError

MOST_NOISE = 100.0  # [N]
MOST_WAIT_S = 3600.0
Seconds = Annotated[float, Field(ge=0.0, le=MOST_WAIT_S, allow_inf_nan=False)]


class ProtectiveStop(files.Fields):
    kind: Literal["protective_stop"]


class EmergencyStop(files.Fields):
    """An emergency stop: someone presses the button."""

    kind: Literal["emergency_stop"]


class PowerOff(files.Fields):
    kind: Literal["power_off"]


class Stall(files.Fields):
    """A stall: the controller neither moves nor sends for some time of the wall's clock, then goes
    on."""

    kind: Literal["stall"]
    seconds: Seconds


class DropRtde(files.Fields):
    """A loss of RTDE: every connection is cut; new ones are refused for `refuse_s`."""

    kind: Literal["drop_rtde"]
    refuse_s: Seconds = 0.0


class CameraState(files.Fields):
    """A state of the camera: frames stop changing, are answered with status 503, or with a closed
    connection."""

    kind: Literal["camera"]
    state: CameraFault


class GripperLost(files.Fields):
    """A lost peg: it slips out of the fingers, as the gripper reports it."""

    kind: Literal["gripper_lost"]


class ForceNoise(files.Fields):
    """Gaussian noise on each axis of the measured force, one standard deviation."""

    kind: Literal["force_noise"]
    newtons: Annotated[float, Field(ge=0.0, le=MOST_NOISE, allow_inf_nan=False)]


Fault = Annotated[
    ProtectiveStop
    | EmergencyStop
    | PowerOff
    | Stall
    | DropRtde
    | CameraState
    | GripperLost
    | ForceNoise,
    Field(discriminator="kind"),
]
_FAULT: TypeAdapter[Fault] = TypeAdapter(Fault)


def fault(data: object) -> Fault:
    """A fault from plain data.

    Raises:
        InputError: there is no such fault.
    """
    try:
        return _FAULT.validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        raise InputError(f"fault {data}: {first_problem(error)}") from error


def load(path: Path) -> list[tuple[float, Fault]]:
    """The faults in a file as (at_s, fault), in the order in which they come.

    Raises:
        InputError: the file cannot be read, or is not a list of faults.
    """
    document = files.read_yaml(path, "fault file", "it must be a list of faults")
    items = document.value
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise document.error((), "it must be a list of faults, each with at_s and kind")
    scheduled = []
    for i, item in enumerate(items):
        at_s = item.pop("at_s", None)
        if not isinstance(at_s, int | float) or isinstance(at_s, bool) or not 0 <= at_s < 1e6:
            raise document.error((i, "at_s"), f"at_s is {at_s!r}; it must be 0 s or more")
        scheduled.append((float(at_s), files.checked(document.part((i,)), _FAULT)))
    return sorted(scheduled, key=lambda pair: pair[0])


def first_problem(error: ValidationError) -> str:
    """The first of a validation's findings, in one line."""
    problem = error.errors()[0]
    where = ".".join(str(part) for part in problem["loc"])
    return f"{where}: {problem['msg']}" if where else problem["msg"]
