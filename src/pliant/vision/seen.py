"""A peg and a hole as they are seen, from their places in a picture and in metres: what every way
of measuring by shape ends with."""

import math

import numpy as np

from pliant.cell import Camera
from pliant.task import Peg
from pliant.vision.lines import Points
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Pixel, peg_at


def peg_seen(
    camera: Camera,
    peg: Peg,
    yaw: float,
    *,
    top: Points,
    tilt: Measured,
    y: Measured,
    z: Measured,
) -> PegSeen:
    """A peg turned by `yaw` [rad] whose axis meets its top edge at `top` (2,) [px] and whose tip is
    at y and z [m]."""
    mpp = camera.metres_per_pixel(peg.silhouette_x)
    edges = (left_y, _), (right_y, _) = peg.silhouette(yaw)
    cos, sin = math.cos(tilt.value), math.sin(tilt.value)
    half, length = (right_y - left_y) / 2 / mpp, peg.length / mpp
    down, across = np.array([sin, cos]), np.array([cos, -sin])
    corners = [
        top + a * half * across + b * length * down for a, b in ((-1, 1), (-1, 0), (1, 0), (1, 1))
    ]
    a, b, c, d = ((float(u), float(v)) for u, v in corners)
    return peg_at(
        y,
        z,
        tilt,
        edges,
        box_px=(a, b, c, d),
        center_px=((a[0] + c[0]) / 2, (a[1] + c[1]) / 2),
        edge_px=d,
        tilt_deg=math.degrees(tilt.value),
    )


def hole_seen(
    *, left: float, right: float, top: float, bottom: float, y: Measured, surface_z: Measured
) -> HoleSeen:
    """A block between these columns and rows [px], and its hole in metres."""
    box: tuple[Pixel, Pixel, Pixel, Pixel]
    box = (left, bottom), (left, top), (right, top), (right, bottom)
    return HoleSeen(
        box_px=box,
        center_px=((left + right) / 2, (top + bottom) / 2),
        y=y,
        surface_z=surface_z,
    )


def shifted(value: float, sd: float, offset: Measured) -> Measured:
    """A value [m] with its standard deviation, moved by a camera's offset."""
    return Measured(value=value + offset.value, sd=math.hypot(sd, offset.sd))
