"""Physical constants of the simulated cell, each with its source.

[F24]  Fuchioka et al. 2024, the robosuite fork with the soft wrist that the paper builds on
[MEN]  MuJoCo Menagerie's UR5e and 2F-85
[PAP]  the paper
[OWN]  our choice; the reason stands in docs/assumptions.md
"""

import math
from typing import Final

Vec3 = tuple[float, float, float]
Rgba = tuple[float, float, float, float]

# Soft wrist and what hangs on it. Its stiffness and damping are `task.Wrist`. -------------------
WRIST_BELOW_FLANGE: Final = 0.055  # [m] hinge point below the flange [F24]
GRIPPER_MASS: Final = 0.864  # [kg] [F24]
GRIPPER_COM_BELOW_HINGE: Final = 0.046  # [m] [F24]
GRIPPER_INERTIA: Final[Vec3] = (1.02e-3, 1.03e-3, 0.49e-3)  # [kg m2] [F24]
GRIPPER_RAISED: Final = 0.030  # [m] above flush, so that the fingertips clear the board [OWN]
PEG_MASS: Final = 0.03  # [kg] [F24]

# Contact: one set for every peg and hole. -------------------------------------------------------
FRICTION: Final[Vec3] = (1.0, 0.005, 1e-4)  # sliding, torsional, rolling [F24]
SOLREF: Final = (0.004, 1.0)  # [s], ratio; [F24] has 0.02 on the peg, which sinks 1.8 mm [OWN]
SOLIMP: Final = (0.99, 0.999, 0.0001, 0.5, 2.0)  # stiff within 0.1 mm of touch [OWN]
CONDIM: Final = 4  # [F24]
IMPRATIO: Final = 10.0  # [MEN] 2F-85
HOLE_BITS: Final = (2, 4)  # contype, conaffinity: only peg and fingers meet the board
PEG_BITS: Final = (4, 2)
TIMESTEP: Final = 0.002  # [s] [F24]
ROUND_HOLE_SIDES: Final = 12  # flats at +-y, as a 12-gon around the peg's circle [F24]

# Arm. --------------------------------------------------------------------------------------------
SERVO_STIFFNESS_FACTOR: Final = 10.0  # on Menagerie's position gain: 0.2 mm tracking [OWN]
COVERED_LEVEL: Final = 24  # of 255: what a covered lens shows [OWN]
FREEZES_S: Final = 4.0  # [s] when the cameras of a trial with frozen pictures get stuck [OWN]
CONTROL_PERIOD: Final = 0.010  # [s] set points, and how often compression is looked at [OWN]
ACCELERATION_RAMP: Final = 0.15  # [s] from rest to full speed [OWN]
BASE_POSITION: Final[Vec3] = (-0.5, -0.13, -0.14)  # [m] of the arm in the task frame [OWN]

# Looks. -------------------------------------------------------------------------------------------
PEG_RGBA: Final[Rgba] = (0.0, 0.7, 0.7, 1.0)  # cyan [F24], [PAP] Sec. V-A
BLOCK_RGBA: Final[Rgba] = (0.75, 0.05, 0.05, 1.0)  # red [F24], [PAP] Sec. V-A
STRANGE_RGBA: Final[Rgba] = (0.45, 0.45, 0.48, 1.0)  # steel: what does not belong there [OWN]
CAMERAS: Final = ("side", "front", "oblique", "wide")
IMAGE_SIZE: Final = (640, 480)  # [px] [OWN]
SIDE_CAMERA_DISTANCE: Final = 1.2  # [m] from the hole's axis along +x [OWN]
SIDE_CAMERA_HEIGHT: Final = 0.0  # [m]: at the board's surface, which it sees edge on [OWN]
SIDE_CAMERA_FOVY: Final = 15.0  # [deg] [OWN]
OBLIQUE_CAMERA_ELEVATION: Final = math.radians(55)  # [OWN]
OBLIQUE_CAMERA_FOVY: Final = 13.0  # [deg] [OWN]
WIDE_CAMERA_FOVY: Final = 36.0  # [deg] [OWN]


UNTOUCHED: Final = {"contype": 0, "conaffinity": 0}  # of a geom that only shows


def contact(bits: tuple[int, int]) -> dict[str, object]:
    """A geom's contact parameters, the same for every peg and hole; contype and conaffinity."""
    return {
        "contype": bits[0],
        "conaffinity": bits[1],
        "condim": CONDIM,
        "friction": list(FRICTION),
        "solref": list(SOLREF),
        "solimp": list(SOLIMP),
    }
