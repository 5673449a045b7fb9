"""RTDE, version 2 (port 30004): framing, recipes, and one connection with its subscription.

A message is `u16 size, u8 command, body`, big-endian; the size counts the header.
"""

import asyncio
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from pliant.emulator.controller import REGISTERS, Controller
from pliant.emulator.outputs import FORMATS, VARIABLES, Getter
from pliant.ur5e.protocol import FREQUENCY

VERSION = (5, 12, 6, 1)  # PolyScope's, as reported: from 5.23 on clients expect more registers
_HEADER = struct.Struct(">HB")
_PROTOCOL = 2
_ASKS_FOR_PROTOCOL = _HEADER.pack(5, ord("V"))
_MOST_UNSENT = 1 << 16  # [bytes]; a client that does not read misses packages


def frame(command: str, body: bytes) -> bytes:
    """One message with its header."""
    return _HEADER.pack(_HEADER.size + len(body), ord(command)) + body


def frames_in(buffer: bytearray) -> Iterator[tuple[str, bytes]]:
    """Take the complete messages from the front of a buffer.

    Raises:
        ValueError: a message cannot be that short.
    """
    while len(buffer) >= _HEADER.size:
        size, command = _HEADER.unpack_from(buffer)
        if size < _HEADER.size:
            raise ValueError(f"an RTDE message of {size} bytes: it has at least {_HEADER.size}")
        if len(buffer) < size:
            return
        body = bytes(buffer[_HEADER.size : size])
        del buffer[:size]
        yield chr(command), body


def is_begun(buffer: bytearray) -> bool:
    """Whether what a client sends first begins as RTDE does: by asking for the protocol."""
    return _ASKS_FOR_PROTOCOL.startswith(bytes(buffer[: len(_ASKS_FOR_PROTOCOL)]))


# --- what a client may write ---------------------------------------------------------------------


_INPUTS = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",  # accepted and not used
    **{f"input_int_register_{i}": "INT32" for i in range(REGISTERS)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(REGISTERS)},
}
_FIRST_BIT = {
    "standard_digital_output": 0,
    "configurable_digital_output": 8,
    "tool_digital_output": 16,
}


def _write(controller: Controller, values: dict[str, float]) -> None:
    """Take a client's values over, as the controller does when the package arrives."""
    registers = controller.registers
    for name, value in values.items():
        kind, _, number = name.rpartition("_register_")
        if kind == "input_int":
            registers.in_int[int(number)] = int(value)
        elif kind == "input_double":
            registers.in_double[int(number)] = value
    if "input_int_register_0" in values:
        controller.fed()
    if values.get("speed_slider_mask"):
        controller.speed_slider = min(1.0, max(0.0, values["speed_slider_fraction"]))
    for name, first in _FIRST_BIT.items():
        mask = int(values.get(f"{name}_mask", 0)) << first
        if mask:
            bits = int(values[name]) << first
            controller.digital_outputs = (controller.digital_outputs & ~mask) | (bits & mask)
    for k in (0, 1):
        if int(values.get("standard_analog_output_mask", 0)) >> k & 1:
            controller.analog_outputs[k] = values[f"standard_analog_output_{k}"]


# --- connections ---------------------------------------------------------------------------------


@dataclass(kw_only=True, eq=False)
class Rtde:
    """The RTDE side of a controller: all its connections, and who writes which input."""

    controller: Controller
    wake: Callable[[], None]  # something was written
    connections: set["Connection"] = field(default_factory=set)
    owners: dict[str, "Connection"] = field(default_factory=dict)
    refuse_until: float = 0.0  # on the loop's clock

    def connection(self) -> "Connection":
        return Connection(self)

    def publish(self, *, always: bool = False) -> None:
        """Send every connection what is due; `always`: whatever its frequency."""
        for connection in self.connections:
            if always or self.controller.ticks % connection.every == 0:
                connection.publish()

    def drop(self, refuse_s: float) -> None:
        """Cut every connection, and take no new one for a while."""
        self.refuse_until = asyncio.get_running_loop().time() + refuse_s
        for connection in tuple(self.connections):
            connection.abort()


class Connection(asyncio.Protocol):
    """One client's connection, with its subscription."""

    def __init__(self, rtde: Rtde) -> None:
        self._rtde, self._controller = rtde, rtde.controller
        self._buffer = bytearray()
        self._inputs: list[list[tuple[str, str]]] = []  # recipes: names with their types
        self._outputs: list[Getter] = []
        self._format = struct.Struct(">")
        self._started = False
        self._is_known = False
        self.every = 1  # ticks between packages

    # --- asyncio.Protocol ------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if asyncio.get_running_loop().time() < self._rtde.refuse_until:
            transport.abort()
            return
        self._rtde.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._rtde.connections.discard(self)
        owners = self._rtde.owners
        for name in [n for n, owner in owners.items() if owner is self]:
            del owners[name]

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        if not (self._is_known or is_begun(self._buffer)):
            self._transport.abort()  # not RTDE
            return
        self._is_known |= len(self._buffer) >= len(_ASKS_FOR_PROTOCOL)
        try:
            for command, body in frames_in(self._buffer):
                self._handle(command, body)
        except (ValueError, KeyError, struct.error):
            self._transport.abort()  # not RTDE

    def abort(self) -> None:
        self._transport.abort()

    # --- messages --------------------------------------------------------------------------------

    def _handle(self, command: str, body: bytes) -> None:
        if command == "V":
            (wanted,) = struct.unpack_from(">H", body)
            self._reply(command, struct.pack(">?", wanted == _PROTOCOL))
        elif command == "v":
            self._reply(command, struct.pack(">4I", *VERSION))
        elif command == "O":
            self._reply(command, self._subscribe(body))
        elif command == "I":
            self._reply(command, self._claim(body))
        elif command in "SP":
            self._reply(command, struct.pack(">?", True))
            self._started = command == "S" and bool(self._outputs)
            self.publish()
        elif command == "U":
            self._take(body)

    def _reply(self, command: str, body: bytes) -> None:
        self._transport.write(frame(command, body))

    def _subscribe(self, body: bytes) -> bytes:
        (frequency,) = struct.unpack_from(">d", body)
        names = _names(body[8:])
        known = [VARIABLES.get(name) for name in names]
        types = tuple("NOT_FOUND" if v is None else v[0] for v in known)
        if "NOT_FOUND" in types or not names:
            return b"\0" + ",".join(types).encode()
        self.every = max(1, round(FREQUENCY / min(max(frequency, 1.0), FREQUENCY)))
        self._outputs = [v[1] for v in known if v is not None]
        self._format = struct.Struct(">" + "".join(FORMATS[t] for t in types))
        return b"\1" + ",".join(types).encode()

    def _claim(self, body: bytes) -> bytes:
        names, owners = _names(body), self._rtde.owners
        types = []
        for name in names:
            kind = _INPUTS.get(name)
            taken = owners.get(name, self) is not self
            types.append("NOT_FOUND" if kind is None else "IN_USE" if taken else kind)
        if "NOT_FOUND" in types or "IN_USE" in types:
            return b"\0" + ",".join(types).encode()
        owners.update(dict.fromkeys(names, self))
        self._inputs.append(list(zip(names, types, strict=True)))
        return bytes([len(self._inputs)]) + ",".join(types).encode()

    def _take(self, body: bytes) -> None:
        """Take values in the recipe's order; some clients send fewer or more than the recipe
        has."""
        number = body[0] if body else 0
        if not 1 <= number <= len(self._inputs):
            raise ValueError(f"there is no input recipe {number}")
        values: dict[str, float] = {}
        offset = 1
        for name, kind in self._inputs[number - 1]:
            code = ">" + FORMATS[kind]
            if offset + struct.calcsize(code) > len(body):
                break
            values[name] = struct.unpack_from(code, body, offset)[0]
            offset += struct.calcsize(code)
        _write(self._controller, values)
        self._rtde.wake()

    def publish(self) -> None:
        """Send a data package, if the client has asked for them and reads them."""
        if not self._started or self._transport.get_write_buffer_size() > _MOST_UNSENT:
            return
        flat: list[float] = []
        for getter in self._outputs:
            value = getter(self._controller)
            if isinstance(value, int | float):
                flat.append(value)
            else:
                flat.extend(value.tolist() if isinstance(value, np.ndarray) else value)
        self._transport.write(frame("U", b"\1" + self._format.pack(*flat)))


def _names(body: bytes) -> tuple[str, ...]:
    return tuple(n for n in body.decode("ascii", "replace").split(",") if n)
