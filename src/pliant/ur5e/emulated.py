"""The cell's file for an emulated cell, from what the emulator says about itself."""

import json
import math
from collections.abc import Iterable

import numpy as np

from pliant.errors import InputError
from pliant.network import open_directly
from pliant.pose import angles_from
from pliant.ur5e import configuration as c
from pliant.ur5e.admin_port import AdminPort
from pliant.ur5e.protocol import ADMIN_PORT, Pacing

_PATIENCE_S = 20.0
_REAL_TIME = {"stamp_ms": 900, "driver_ms": 1400, "gripper_ms": 900, "connect_ms": 30_000}
_LOCKSTEP = {  # on a machine under load nothing is late
    "stamp_ms": 10_000,
    "driver_ms": 15_000,
    "dashboard_ms": 5000,
    "picture_ms": 20_000,
    "gripper_ms": 10_000,
    "connect_ms": 60_000,
}


def configuration_of(address: str = "127.0.0.1", admin_port: int = ADMIN_PORT) -> c.Configuration:
    """The configuration of an emulated cell: frames, tool, payload, stiffness and camera as the
    emulator has them; the patience is for a machine that also has to compute the physics, in
    lockstep for any machine.

    Raises:
        InputError: no emulator answers there.
    """
    admin = AdminPort(address, admin_port)
    try:
        cell = admin.ask("describe")
        url = f"{cell['camera_url']}/cameras.json"
        with open_directly(url, _PATIENCE_S) as answer:
            (side,) = (camera for camera in json.load(answer) if camera["name"] == "side")
    except OSError as error:
        raise InputError(f"the emulator at {address} does not answer: {error}") from error
    finally:
        admin.close()
    x, y, z, *turn = cell["hinge_on_flange"]
    base = cell["base_in_task_m"]
    payload = cell["payload"]
    is_lockstep = cell["mode"] == Pacing.LOCKSTEP
    return c.Configuration.model_validate(
        {
            "arm": {"address": address, "watchdog_hz": 10 if is_lockstep else 2},
            "tcp": _millimetres(x, y, z)
            | dict(zip(("rx_deg", "ry_deg", "rz_deg"), _degrees(turn), strict=True)),
            "payload": {
                "mass_kg": payload["mass_kg"],
                "center_mm": [_round(v * 1e3) for v in payload["centre_on_flange_m"]],
            },
            "task_frame": _millimetres(*(-v for v in base)),
            "workspace": {
                "x_mm": [-30, 30],
                "y_mm": [-100, 100],
                "z_mm": [120, 400],
                "roll_deg": [-28, 28],
                "pitch_deg": [-17, 17],
                "yaw_deg": [-28, 28],
            },
            "wrist": {"stiffness_n_mm": cell["wrist_stiffness_z"] * 1e-3},
            "camera": {
                "source": "http",
                "where": f"{cell['camera_url']}/side.png",
                "width": side["width"],
                "height": side["height"],
                "focal_px": _round(side["focal_px"]),
                "position_mm": [_round(v * 1e3) for v in side["position"]],
                "rotation_deg": _degrees(angles_from(np.array(side["rotation"]))),
            },
            "patience": _LOCKSTEP if is_lockstep else _REAL_TIME,
            "emulator": {"admin_port": admin_port},
        }
    )


def _millimetres(x: float, y: float, z: float) -> dict[str, float]:
    return {"x_mm": _round(x * 1e3), "y_mm": _round(y * 1e3), "z_mm": _round(z * 1e3)}


def _degrees(angles: Iterable[float]) -> list[float]:
    return [_round(math.degrees(v)) for v in angles]


def _round(value: float) -> float:
    """A number as a person reads it in the file: a millionth of a millimetre or of a degree, and no
    negative zero."""
    return round(value, 6) + 0.0
