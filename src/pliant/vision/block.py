"""The board's block, which every way of measuring knows the size of: where its corners are, and
where a camera shows them."""

import math

import numpy as np

from pliant.cell import Camera
from pliant.task import BLOCK_SIZE
from pliant.vision.lines import Points

FRONT_X = BLOCK_SIZE[0] / 2
"""The x [m] of the face toward a camera at +x, of a block that is not turned."""


def upright_edges(x: float, y: float, yaw: float) -> list[tuple[float, float]]:
    """Places x and y [m] of the four upright edges of a block turned by `yaw` [rad] with its axis
    at x and y: the two behind and then the two in front, each from left to right."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    half_x, half_y = BLOCK_SIZE[0] / 2, BLOCK_SIZE[1] / 2
    return [
        (x + cos * a - sin * b, y + sin * a + cos * b)
        for a in (-half_x, half_x)
        for b in (-half_y, half_y)
    ]


def corners_px(camera: Camera, x: float, y: float, surface: float, yaw: float) -> Points:
    """The block's corners (8, 2) [px] in a picture, its top face at `surface` [m]."""
    return np.array(
        [
            camera.project(np.array([a, b, z]))
            for a, b in upright_edges(x, y, yaw)
            for z in (surface - BLOCK_SIZE[2], surface)
        ]
    )
