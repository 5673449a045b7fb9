"""Other users and every web page can send to the emulator's ports: they command nothing there."""

import asyncio
import json
import stat
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from pliant import tokens
from pliant.emulator import __main__ as program
from pliant.emulator import admin
from pliant.emulator.camera import names_an_address
from pliant.emulator.ports import NOT_UNDERSTOOD, Lines, Scripts, begins
from pliant.errors import InputError

PAGE = b"POST / HTTP/1.1\r\nHost: evil.example\r\nContent-Length: 99\r\n\r\n"
PORT = 30100


class Wire(asyncio.Transport):
    """The server's end of a connection."""

    def __init__(self) -> None:
        super().__init__()
        self.sent, self.is_open = b"", True

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.sent += bytes(data)

    def close(self) -> None:
        self.is_open = False

    abort = close


def received(protocol: asyncio.Protocol, *pieces: bytes) -> Wire:
    wire = Wire()
    protocol.connection_made(wire)
    wire.sent = b""  # without a greeting
    for piece in pieces:
        if wire.is_open:
            protocol.data_received(piece)
    return wire


def test_a_web_pages_request_reaches_no_command_of_a_line_port() -> None:
    asked: list[str] = []

    def answer(line: str) -> str:
        asked.append(line)
        return "Powering off\n" if line == "power off" else f"{NOT_UNDERSTOOD}: '{line}'\n"

    assert not received(Lines(answer, NOT_UNDERSTOOD), PAGE + b"power off\n").is_open
    assert asked == ["POST / HTTP/1.1"]
    assert received(Lines(answer, NOT_UNDERSTOOD), b"power", b" off\n").is_open


def test_a_web_pages_request_plays_no_script() -> None:
    played: list[object] = []
    controller = SimpleNamespace(play=played.append, time_s=0.0)

    def scripts() -> Scripts:
        return Scripts(cast(Any, controller), lambda: None)

    script = b"def rtde_control():\n  pass\nend\n"
    assert not received(scripts(), PAGE + script).is_open
    assert not played
    whole = received(scripts(), b"d", script[1:9], script[9:])
    assert whole.is_open
    assert len(played) == 1


@pytest.mark.parametrize(
    "text", ["", "\n", "# a\n\n# b", "# c\n" * 5000, "de", "def f():\n", "  sec g():\n", "se"]
)
def test_a_script_may_begin_with_comments(text: str) -> None:
    assert begins(text)


@pytest.mark.parametrize("text", ["GET / HTTP/1.1", "\x16\x03\x01", "defy", "movej(", "secret"])
def test_what_begins_otherwise_is_no_script(text: str) -> None:
    assert not begins(text)


# --- the admin port ------------------------------------------------------------------------------


class Emulated:
    """What the admin port commands."""

    def __init__(self) -> None:
        self.is_stopped = False

    def is_token(self, token: str) -> bool:
        return token == "secret"

    def state(self) -> dict[str, Any]:
        return {"time_s": 1.0}

    def stop(self) -> None:
        self.is_stopped = True


def answers(emulator: Emulated, *lines: bytes) -> list[dict[str, Any]]:
    async def talk() -> bytes:
        loop, protocol = asyncio.get_running_loop(), partial(admin.protocol, cast(Any, emulator))
        server = await loop.create_server(protocol, "127.0.0.1", 0)
        async with server:
            reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
            writer.write(b"".join(lines))
            writer.write_eof()
            said = await reader.read()
            writer.close()
            await writer.wait_closed()
            return said

    return [json.loads(line) for line in asyncio.run(talk()).splitlines()]


def test_what_changes_something_needs_the_token() -> None:
    emulator = Emulated()
    asked = [b'{"do":"state"}\n', b'{"do":"stop"}\n', b'{"do":"stop","token":"guess"}\n']
    state, *refused = answers(emulator, *asked)
    assert state["ok"]
    assert all(not r["ok"] and "token is not this emulator's" in r["error"] for r in refused)
    assert not emulator.is_stopped
    answers(emulator, b'{"do":"stop","token":"secret"}\n')
    assert emulator.is_stopped


def test_a_web_pages_request_is_hung_up_on() -> None:
    emulator = Emulated()
    assert answers(emulator, PAGE, b'{"do":"stop","token":"secret"}\n') == []
    assert not emulator.is_stopped


# --- the token -----------------------------------------------------------------------------------


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv(tokens.VARIABLE, raising=False)
    return tmp_path


def test_the_token_is_new_and_for_its_user_alone(own: Path) -> None:
    first, other = tokens.make("127.0.0.1", PORT), tokens.make("127.0.0.2", PORT)
    assert tokens.known("localhost", PORT) == first != other == tokens.known("127.0.0.2", PORT)
    (place,) = own.iterdir()
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert {stat.S_IMODE(file.stat().st_mode) for file in place.iterdir()} == {0o600}
    tokens.remove("127.0.0.1", PORT)
    assert tokens.known("127.0.0.1", PORT) == ""
    tokens.make("127.0.0.1", PORT)
    assert tokens.known("127.0.0.1", PORT) != first


def test_it_can_be_given_where_no_file_is_shared(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(tokens.VARIABLE, "ours")
    assert tokens.make("0.0.0.0", PORT) == tokens.known("10.0.0.7", PORT) == "ours"
    assert not list(own.iterdir())


def test_a_token_that_cannot_be_kept_is_refused_in_a_line(own: Path) -> None:
    (own / "pliant").touch()
    with pytest.raises(InputError, match=tokens.VARIABLE):
        tokens.make("127.0.0.1", PORT)


@pytest.mark.parametrize("host", ["127.0.0.1:30101", "localhost:1", "[::1]:80", "192.168.0.3"])
def test_pictures_are_asked_for_by_an_address(host: str) -> None:
    assert names_an_address(host)


@pytest.mark.parametrize(
    "host", ["evil.example:30101", "", "127.0.0.1.evil.example", "localhost.", ":"]
)
def test_a_name_that_leads_here_gets_no_pictures(host: str) -> None:
    assert not names_an_address(host)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--host", "0.0.0.0", "--peg", "pentagon"), "unknown peg 'pentagon'"),
        (("--host", "127.0.0.1", "--host", "127.0.0.2"), "--host is given twice"),
        (("--host", "192.0.2.1"), "host 192.0.2.1 is no address of this machine"),
    ],
)
def test_what_cannot_be_served_is_one_line_without_a_warning(
    words: tuple[str, ...], says: str
) -> None:
    command = [sys.executable, "-m", "pliant.emulator", *words]
    said = subprocess.run(command, capture_output=True, encoding="utf-8")
    assert said.returncode == 2
    (error,) = said.stderr.splitlines()
    assert error.startswith(f"pliant.emulator: {says}")


def test_an_address_that_others_reach_is_warned_of_once_it_is_served(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def ready(options: object, say: Callable[[str], None]) -> None:
        say("ready")

    monkeypatch.setattr(program, "serve", ready)
    for host, warnings in (("0.0.0.0", 1), ("127.0.0.1", 0)):
        monkeypatch.setattr(sys, "argv", ["pliant.emulator", "--host", host])
        program.main()
        printed, said = capsys.readouterr()
        assert printed == "ready\n"
        assert said.count(f"warning: {host} can be reached from other machines") == warnings
