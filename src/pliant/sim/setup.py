"""A trial's setup in the compiled model, as it is at a time: what is drawn before the trial, and
the strike that may fall in its middle. Then the board is pushed, and the peg turns and slides in
the grasp, smoothly and within 0.3 s.

It depends on the setup and the clock alone, so that a stored trial can be drawn again. The board
has no velocity of its own: its walls push the peg, but it does not drag along what stands on it.
"""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.conditions import Setup
from pliant.pose import rotation_matrix
from pliant.sim import constants as c
from pliant.sim import model as m
from pliant.sim import strange

STRIKE_S = 0.3


def apply(model: mujoco.MjModel, setup: Setup, time_s: float = 0.0) -> None:
    """Put into a compiled model what a trial randomises, as it is at `time_s`."""
    place(model, setup, time_s)
    strange.bring_out(model, setup)
    board = model.body(m.BOARD)
    first = int(board.geomadr[0])
    geoms = slice(first, first + int(board.geomnum[0]))
    model.geom_friction[geoms, 0] = c.FRICTION[0] * setup.friction
    nominal = model.numeric(m.WRIST_STIFFNESS).data
    model.jnt_stiffness[model.njnt - len(nominal) :] = nominal * setup.wrist_stiffness


def place(model: mujoco.MjModel, setup: Setup, time_s: float) -> None:
    """Put board and peg where they are at `time_s`."""
    struck = _struck(setup, time_s)
    roll = setup.grasp_roll + struck * setup.grasp_turn
    along = rotation_matrix(roll, setup.grasp_pitch, 0.0)
    leaning, grasp = np.zeros(4), np.zeros(4)
    mujoco.mju_mulQuat(leaning, _about(setup.grasp_pitch, 2), _about(roll, 1))
    mujoco.mju_mulQuat(grasp, leaning, _about(setup.grasp_yaw, 3))
    heading, way = setup.board_shift_heading, struck * setup.board_shift
    board, peg = model.body(m.BOARD), model.body(m.PEG)
    board.pos[:] = [
        setup.hole_x + way * np.cos(heading),
        setup.hole_y + way * np.sin(heading),
        setup.board_z,
    ]
    board.quat[:], peg.quat[:] = _about(setup.board_yaw, 3), grasp
    peg.pos[:] = model.numeric(m.GRASP).data + struck * setup.grasp_slide * along[:, 2]


def _about(angle: float, axis: int) -> NDArray[np.float64]:  # (4,)
    """The quaternion of a turn [rad] about x, y or z (1, 2 or 3)."""
    quaternion = np.zeros(4)
    quaternion[0], quaternion[axis] = math.cos(angle / 2), math.sin(angle / 2)
    return quaternion


def is_moving(setup: Setup, time_s: float) -> bool:
    """Whether board or peg moves within the control period that begins at `time_s`."""
    if not (setup.board_shift or setup.grasp_turn or setup.grasp_slide):
        return False
    begun = time_s + c.CONTROL_PERIOD - setup.struck_at
    return 0.0 < begun < STRIKE_S + 2 * c.CONTROL_PERIOD


def _struck(setup: Setup, time_s: float) -> float:
    """The part of the strike that has happened, from 0 to 1: from rest to rest."""
    part = min(1.0, max(0.0, (time_s - setup.struck_at) / STRIKE_S))
    return part * part * (3.0 - 2.0 * part)
