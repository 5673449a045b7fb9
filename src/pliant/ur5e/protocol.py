"""The words of a UR5e's controller, its gripper and an emulated cell, which both ends use: ports,
numbers of modes and bits, and names on the wire."""

from enum import IntEnum, IntFlag, StrEnum

RTDE_PORT, SCRIPT_PORT, DASHBOARD_PORT, GRIPPER_PORT = 30004, 30003, 29999, 63352
ADMIN_PORT, CAMERA_PORT = 30100, 30101  # of an emulated cell
CYCLE_S = 0.002  # of the controller
FREQUENCY = round(1 / CYCLE_S)  # [Hz]
STOPPED = "Stopped"  # the dashboard's answer to `stop`
TIME_HEADER = "X-Robot-Time"  # of a picture over HTTP: the controller's time stamp [s]


class Pacing(StrEnum):
    """The relation between an emulated controller's time and the wall's."""

    REAL = "real"
    FAST = "fast"
    LOCKSTEP = "lockstep"


class Mode(IntEnum):
    """Robot modes as RTDE numbers them."""

    POWER_OFF = 3
    IDLE = 5
    RUNNING = 7


class SafetyBits(IntFlag):
    """The safety status bits of RTDE."""

    NORMAL = 1 << 0
    REDUCED = 1 << 1
    PROTECTIVE_STOP = 1 << 2
    SAFEGUARD_STOP = 1 << 4
    SYSTEM_EMERGENCY_STOP = 1 << 5
    ROBOT_EMERGENCY_STOP = 1 << 6
    EMERGENCY_STOP = 1 << 7
    VIOLATION = 1 << 8
    FAULT = 1 << 9
    STOPPED = 1 << 10


class Object(IntEnum):
    """The gripper's object detection, as its variable OBJ reports it."""

    MOVING = 0
    OPENING = 1  # contact while opening
    CLOSING = 2  # contact while closing: the peg
    NONE = 3  # arrived where it was sent
