"""The three cameras together: what each shows of how far things are from the others."""

import math

import numpy as np
import pytest
from stand_ins import PEGS, cell_for, prepared

from pliant.conditions import condition
from pliant.levels import load_level
from pliant.pose import Pose
from pliant.vision.sight import ByColour


@pytest.mark.parametrize("peg", PEGS)
def test_a_tip_is_measured_where_it_is_also_when_it_is_nearer_or_leans_to_the_camera(
    peg: str,
) -> None:
    drawing = load_level("L3").on(condition("all"))
    errors = []
    for seed in range(810, 818):
        setup = drawing.draw(seed)
        robot = prepared(peg, setup)
        above = Pose(
            x=setup.hole_x,
            y=setup.hole_y + 0.02,
            z=robot.task.tip_below_hinge + setup.board_z + 0.015,
            roll=math.radians(10),
            yaw=setup.board_yaw,
        )
        robot.move_to(above, speed_m_s=0.05, stop_at_compression_m=0.02)
        robot.settle(3.0)
        seen = robot.observe(cameras=("side", "front", "oblique"))
        scene = ByColour(robot.task)(seen)
        assert scene.peg is not None
        assert scene.hole is not None
        tip = cell_for(peg).truth().tip
        errors.append((scene.peg.tip_y.value - tip[1], scene.peg.tip_z.value - tip[2]))
        assert abs(scene.hole.y.value - setup.hole_y) < 0.0007
    y, z = np.abs(errors).T
    assert np.median(z) < 0.0002  # without the front camera 0.8 mm, and up to 2 mm
    assert np.max(z) < 0.001
    assert np.max(y) < 0.0007
