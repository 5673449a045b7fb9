"""The emulated controller's wire: RTDE's framing and recipes, and the line-based ports."""

import asyncio
import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.conditions import Setup
from pliant.emulator import frames
from pliant.emulator.block import Block, CameraFault
from pliant.emulator.controller import Controller, SafetyLimits
from pliant.emulator.gripper import EmulatedGripper
from pliant.emulator.outputs import FORMATS, VARIABLES
from pliant.emulator.plant import Plant
from pliant.emulator.ports import Dashboard, Scripts, path_in
from pliant.emulator.rtde import Connection, Rtde, frame, frames_in
from pliant.errors import InputError
from pliant.task import load_task


class Wire(asyncio.Transport):
    """A transport that keeps what is sent."""

    def __init__(self) -> None:
        super().__init__()
        self.sent = bytearray()
        self.is_open = True

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.sent += bytes(data)

    def get_write_buffer_size(self) -> int:
        return 0

    def abort(self) -> None:
        self.is_open = False

    def messages(self) -> list[tuple[str, bytes]]:
        return list(frames_in(self.sent))


@pytest.fixture(scope="module")
def controller() -> Controller:
    return Controller(Plant(load_task("circle"), Setup(seed=0)), SafetyLimits())


@pytest.fixture
def rtde(controller: Controller) -> Rtde:
    return Rtde(controller=controller, wake=lambda: None)


async def meets(connection: Connection, wire: Wire) -> None:
    connection.connection_made(wire)


def connected(rtde: Rtde) -> tuple[Connection, Wire]:
    connection, wire = rtde.connection(), Wire()
    asyncio.run(meets(connection, wire))
    connection.data_received(frame("V", struct.pack(">H", 2)))  # as every client begins
    wire.sent.clear()
    return connection, wire


def ask(connection: Connection, wire: Wire, command: str, body: bytes = b"") -> list[bytes]:
    """Everything sent back to one message."""
    connection.data_received(frame(command, body))
    return [data for _, data in wire.messages()]


@given(st.lists(st.tuples(st.sampled_from("VvOISPU"), st.binary(max_size=300))), st.data())
def test_messages_survive_any_cut_of_the_stream(
    messages: list[tuple[str, bytes]], data: st.DataObject
) -> None:
    stream = b"".join(frame(command, body) for command, body in messages)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)))))
    buffer, received = bytearray(), []
    for start, end in pairwise([0, *cuts, len(stream)]):
        buffer += stream[start:end]
        received += list(frames_in(buffer))
    assert received == messages
    assert not buffer


def test_what_is_not_rtde_is_hung_up_on(rtde: Rtde) -> None:
    connection, wire = connected(rtde)
    connection.data_received(b"\x00\x01V")
    assert not wire.is_open


@given(st.binary(min_size=1, max_size=9).filter(lambda data: not b"\0\5V".startswith(data[:3])))
def test_who_does_not_begin_with_the_protocol_is_hung_up_on(
    controller: Controller, data: bytes
) -> None:
    connection, wire = Rtde(controller=controller, wake=lambda: None).connection(), Wire()
    asyncio.run(meets(connection, wire))
    connection.data_received(data)
    assert not wire.is_open


def test_the_handshake_answers_as_the_protocol_says(rtde: Rtde) -> None:
    connection, wire = connected(rtde)
    assert ask(connection, wire, "V", struct.pack(">H", 2)) == [b"\x01"]
    assert ask(connection, wire, "V", struct.pack(">H", 1)) == [b"\x00"]
    (version,) = ask(connection, wire, "v")
    assert struct.unpack(">4I", version)[:2] == (5, 12)


@given(st.lists(st.sampled_from(sorted(VARIABLES)), min_size=1, max_size=40))
def test_a_package_holds_the_variables_asked_for_in_their_order(
    controller: Controller, names: list[str]
) -> None:
    connection, wire = connected(Rtde(controller=controller, wake=lambda: None))
    recipe = struct.pack(">d", 500.0) + ",".join([*names, ""]).encode()
    (answer,) = ask(connection, wire, "O", recipe)
    types = answer[1:].decode().split(",")
    assert types == [VARIABLES[name][0] for name in names]
    reply, package = ask(connection, wire, "S")
    assert reply == b"\x01"  # before any package
    values = struct.unpack(">" + "".join(FORMATS[t] for t in types), package[1:])
    expected: list[float] = []
    for name in names:
        expected += np.ravel(VARIABLES[name][1](controller)).tolist()
    np.testing.assert_allclose(values, expected)


def test_an_unknown_variable_is_named_not_found_and_nothing_is_sent(rtde: Rtde) -> None:
    connection, wire = connected(rtde)
    names = b"timestamp,wheel_speed"
    assert ask(connection, wire, "O", struct.pack(">d", 500.0) + names) == [b"\0DOUBLE,NOT_FOUND"]
    ask(connection, wire, "S")
    rtde.publish(always=True)
    assert wire.messages() == []


def test_an_input_belongs_to_one_connection_until_it_is_gone(rtde: Rtde) -> None:
    (first, first_wire), (second, second_wire) = connected(rtde), connected(rtde)
    assert ask(first, first_wire, "I", b"input_int_register_0") == [b"\x01INT32"]
    assert ask(first, first_wire, "I", b"input_int_register_0,") == [b"\x02INT32"]
    assert ask(second, second_wire, "I", b"input_int_register_0") == [b"\x00IN_USE"]
    first.connection_lost(None)
    assert ask(second, second_wire, "I", b"input_int_register_0") == [b"\x01INT32"]


def test_what_a_client_writes_arrives_in_the_registers(rtde: Rtde) -> None:
    connection, wire = connected(rtde)
    ask(connection, wire, "I", b"input_int_register_5,input_double_register_7")
    ask(connection, wire, "U", struct.pack(">Bid", 1, -3, 0.25))
    assert rtde.controller.registers.in_int[5] == -3
    assert rtde.controller.registers.in_double[7] == 0.25
    ask(connection, wire, "I", b"speed_slider_mask,speed_slider_fraction")
    ask(connection, wire, "U", struct.pack(">BId", 2, 1, 0.5))
    assert rtde.controller.speed_slider == 0.5
    ask(connection, wire, "U", struct.pack(">BId", 2, 1, 1.0))


def test_a_lower_frequency_gets_fewer_packages(rtde: Rtde) -> None:
    connection, wire = connected(rtde)
    ask(connection, wire, "O", struct.pack(">d", 125.0) + b"timestamp")
    ask(connection, wire, "S")
    for _ in range(40):
        rtde.controller.tick()
        rtde.publish()
    assert len(wire.messages()) == 10


@given(
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(*[st.floats(-1.8, 1.8)] * 3),
)
def test_poses_and_transforms_are_each_others_inverse(
    position: tuple[float, ...], turn: tuple[float, ...]
) -> None:
    there = frames.transform((*position, *turn))
    np.testing.assert_allclose(frames.pose(there), (*position, *turn), atol=1e-7)
    np.testing.assert_allclose(there @ frames.inverse(there), np.eye(4), atol=1e-9)


def test_the_gripper_speaks_as_its_urcap_does() -> None:
    gripper = EmulatedGripper()
    assert gripper.answer("GET STA") == "STA 3\n"
    assert gripper.answer("GET OBJ") == "OBJ 2\n"  # it holds the peg
    assert gripper.answer("SET POS 0 SPE 255 FOR 10 GTO 1") == "ack"  # without a newline
    assert gripper.answer("GET OBJ") == "OBJ 0\n"
    for _ in range(500):
        gripper.step(0.002)
    assert gripper.answer("GET POS") == "POS 0\n"
    assert gripper.answer("GET OBJ") == "OBJ 3\n"
    for nonsense in ("", "SET", "SET POS", "SET POS 300", "GET LID", "SET POS -1"):
        assert gripper.answer(nonsense) == "nack"
    gripper.readable = False
    assert gripper.answer("GET POS") == "POS ?\n"


def test_a_gripper_that_loses_the_peg_closes_on_nothing() -> None:
    gripper = EmulatedGripper()
    gripper.lose()
    gripper.step(0.002)
    assert gripper.answer("GET OBJ") == "OBJ 0\n"
    for _ in range(500):
        gripper.step(0.002)
    assert gripper.answer("GET OBJ") == "OBJ 3\n"


def test_the_dashboard_answers_in_the_words_that_clients_compare(controller: Controller) -> None:
    dashboard = Dashboard(controller)
    assert dashboard.answer("stop") == "Stopped\n"
    assert dashboard.answer("is in remote control") == "true\n"
    assert dashboard.answer("get serial number").strip().isdigit()
    assert dashboard.answer("robotmode") == "Robotmode: RUNNING\n"
    assert dashboard.answer("make coffee") == "could not understand: 'make coffee'\n"


SCRIPT = """def rtde_control():
    def exec_move_path():
        # inject move path
\tsignal_async_progress(0)
\tmovel(p[0.5,0.1,0.4,3.1,0,1e-05],a=0.5,v=0.1,r=0)
\tmovej([1,2,3,4,5,6],a=1.4,v=1.05,r=0.02)

    end
    movel(p[9,9,9,9,9,9],a=1,v=1,r=0)
end
"""


def test_an_uploaded_path_is_read_from_the_script_that_carries_it() -> None:
    line, joints = path_in(SCRIPT)
    assert line.pose
    assert not line.joints
    assert line.target == (0.5, 0.1, 0.4, 3.1, 0.0, 1e-05)
    assert (line.acceleration, line.speed) == (0.5, 0.1)
    assert joints.joints
    assert joints.target == (1, 2, 3, 4, 5, 6)


def test_only_the_control_program_plays(controller: Controller) -> None:
    port = Scripts(controller, lambda: None)
    port.data_received(b"def dance():\n  movej([0,0,0,0,0,0])\nend\n")
    assert Dashboard(controller).answer("running") == "Program running: false\n"
    port.data_received(SCRIPT.encode()[:50])  # not all of it is here
    assert Dashboard(controller).answer("running") == "Program running: false\n"
    port.data_received(SCRIPT.encode()[50:])
    assert Dashboard(controller).answer("running") == "Program running: true\n"
    assert Dashboard(controller).answer("stop") == "Stopped\n"
    assert Dashboard(controller).answer("running") == "Program running: false\n"


def test_the_camera_reads_what_the_controller_wrote() -> None:
    mine = Block()
    other = Block(mine.name)
    try:
        setup = Setup(seed=0, friction=3.0, hole_y=-0.01, grasp_roll=0.02)
        mine.set_up("square", setup)
        mine.write(1.25, np.arange(10.0))
        mine.set_fault(CameraFault.FROZEN)
        state = other.read()
        assert (state.time_s, state.peg, state.setup) == (1.25, "square", setup)
        assert state.fault is CameraFault.FROZEN
        np.testing.assert_array_equal(state.qpos, np.arange(10.0))
        mine.writing().__enter__()
        with pytest.raises(TimeoutError):
            other.read()
    finally:
        other.close()
        mine.close()


def test_a_peg_with_too_long_a_name_is_refused() -> None:
    block = Block()
    try:
        with pytest.raises(InputError, match="at most"):
            block.set_up("p" * 600, Setup(seed=0))
    finally:
        block.close()
