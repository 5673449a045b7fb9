"""The variables that the controller reports over RTDE: their types, and where each value comes
from.

Variables that the cell has no counterpart for (temperatures, currents, voltages) are constant.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pliant.emulator import frames
from pliant.emulator.controller import REGISTERS, Controller, Runtime
from pliant.emulator.frames import Array
from pliant.ur5e.protocol import Mode

Value = float | Sequence[float] | Array
Getter = Callable[[Controller], Value]

FORMATS: Mapping[str, str] = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
}
"""RTDE's types as `struct` writes them."""

_ZEROS = (0.0,) * 6
_POWER_ON, _PROGRAM_RUNNING = 1, 2  # robot status bits
_JOINT_RUNNING = (253,) * 6


def _tool_speed(c: Controller) -> Value:
    linear, angular = c.plant.flange_velocity()
    lever = c.plant.flange[:3, :3] @ c.tool[:3, 3]
    return np.concatenate([linear + frames.cross(angular, lever), angular])


def _tool_force(c: Controller) -> Value:
    return c.sensor.at(c.plant.flange[:3, :3] @ c.tool[:3, 3])


def _status_bits(c: Controller) -> int:
    powered = _POWER_ON if c.mode >= Mode.IDLE else 0
    return powered | (_PROGRAM_RUNNING if c.runtime is Runtime.PLAYING else 0)


def _constant(value: Value) -> Getter:
    return lambda c: value


VARIABLES: dict[str, tuple[str, Getter]] = {
    "timestamp": ("DOUBLE", lambda c: c.time_s),
    "target_q": ("VECTOR6D", lambda c: c.q),
    "target_qd": ("VECTOR6D", lambda c: c.qd),
    "target_qdd": ("VECTOR6D", _constant(_ZEROS)),
    "target_current": ("VECTOR6D", _constant(_ZEROS)),
    "target_moment": ("VECTOR6D", _constant(_ZEROS)),
    "actual_q": ("VECTOR6D", lambda c: c.plant.q),
    "actual_qd": ("VECTOR6D", lambda c: c.plant.qd),
    "actual_qdd": ("VECTOR6D", _constant(_ZEROS)),
    "actual_current": ("VECTOR6D", _constant(_ZEROS)),
    "actual_current_as_torque": ("VECTOR6D", lambda c: c.plant.joint_torques),
    "actual_moment": ("VECTOR6D", lambda c: c.plant.joint_torques),
    "joint_control_output": ("VECTOR6D", _constant(_ZEROS)),
    "actual_TCP_pose": ("VECTOR6D", lambda c: frames.pose(c.tool_pose())),
    "actual_TCP_speed": ("VECTOR6D", _tool_speed),
    "actual_TCP_force": ("VECTOR6D", _tool_force),
    "target_TCP_pose": ("VECTOR6D", lambda c: frames.pose(c.tool_target())),
    "target_TCP_speed": ("VECTOR6D", _constant(_ZEROS)),
    "actual_digital_input_bits": ("UINT64", _constant(0)),
    "joint_temperatures": ("VECTOR6D", _constant((30.0,) * 6)),
    "actual_execution_time": ("DOUBLE", _constant(0.0)),
    "robot_mode": ("INT32", lambda c: int(c.mode)),
    "joint_mode": ("VECTOR6INT32", _constant(_JOINT_RUNNING)),
    "safety_mode": ("INT32", lambda c: int(c.safety)),
    "actual_tool_accelerometer": ("VECTOR3D", _constant((0.0, 0.0, 0.0))),
    "speed_scaling": ("DOUBLE", lambda c: c.speed_slider),
    "target_speed_fraction": ("DOUBLE", lambda c: c.speed_slider),
    "actual_momentum": ("DOUBLE", _constant(0.0)),
    "actual_main_voltage": ("DOUBLE", _constant(48.0)),
    "actual_robot_voltage": ("DOUBLE", _constant(48.0)),
    "actual_robot_current": ("DOUBLE", _constant(0.5)),
    "actual_joint_voltage": ("VECTOR6D", _constant((48.0,) * 6)),
    "actual_digital_output_bits": ("UINT64", lambda c: c.digital_outputs),
    "runtime_state": ("UINT32", lambda c: int(c.runtime)),
    "robot_status_bits": ("UINT32", _status_bits),
    "safety_status_bits": ("UINT32", lambda c: c.safety.bits),
    "standard_analog_input0": ("DOUBLE", _constant(0.0)),
    "standard_analog_input1": ("DOUBLE", _constant(0.0)),
    "standard_analog_output0": ("DOUBLE", lambda c: c.analog_outputs[0]),
    "standard_analog_output1": ("DOUBLE", lambda c: c.analog_outputs[1]),
    "ft_raw_wrench": ("VECTOR6D", lambda c: c.sensor.raw),
    "payload": ("DOUBLE", lambda c: c.sensor.payload.mass),
    "payload_cog": ("VECTOR3D", lambda c: c.sensor.payload.centre),
    "payload_inertia": ("VECTOR6D", lambda c: c.sensor.payload.inertia),
    "output_bit_registers0_to_31": ("UINT32", _constant(0)),
    "output_bit_registers32_to_63": ("UINT32", _constant(0)),
}


def _register(kind: str, index: int) -> Getter:
    return lambda c: getattr(c.registers, f"out_{kind}")[index]


for _kind, _type in (("int", "INT32"), ("double", "DOUBLE")):
    for _index in range(REGISTERS):
        VARIABLES[f"output_{_kind}_register_{_index}"] = (_type, _register(_kind, _index))
