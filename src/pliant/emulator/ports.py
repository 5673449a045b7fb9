"""The line-based ports: dashboard (29999), script upload (30003), gripper (63352)."""

import asyncio
import re
from collections.abc import Callable
from functools import partial

from pliant.emulator.controller import Controller, Runtime, Safety, note
from pliant.emulator.motion import Waypoint
from pliant.emulator.program import Program
from pliant.emulator.rtde import VERSION
from pliant.ur5e.protocol import STOPPED, Mode

_SERIAL_NUMBER = "20235500001"
_MOST_LINE = 4096  # [bytes]
_MOST_SCRIPT = 1 << 20  # [bytes]
_CONTROL_PROGRAM = "rtde_control"
_DEFINITION = re.compile(r"^\s*def\s+(\w+)\s*\(", re.MULTILINE)
_FIRST_WORDS = ("def ", "sec ")
_PATH_MARK = "# inject move path\n"
_NUMBER = r"[-+0-9.eE]+"
_MOVE = re.compile(
    rf"move(?P<kind>[jlp])\((?P<pose>p?)\[(?P<target>{_NUMBER}(?:,{_NUMBER}){{5}})\],"
    rf"a=(?P<a>{_NUMBER}),v=(?P<v>{_NUMBER}),r={_NUMBER}\)"
)


class _Port(asyncio.Protocol):
    """One client's connection."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport


class Lines(_Port):
    """Answers each line that a client sends; hangs up on the first that is none of its own, whose
    answer begins with `refusal`: a web page's request may hold, further down, one that is."""

    def __init__(self, answer: Callable[[str], str], refusal: str, greeting: str = "") -> None:
        self._answer, self._refusal, self._greeting = answer, refusal, greeting
        self._buffer = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if self._greeting:
            self._transport.write(self._greeting.encode())

    def data_received(self, data: bytes) -> None:
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for line in lines:
            answer = self._answer(line.decode("utf-8", "replace").strip())
            self._transport.write(answer.encode())
            if answer.startswith(self._refusal):
                self._transport.close()
                return
        if len(self._buffer) > _MOST_LINE:
            self._transport.abort()


# --- dashboard -----------------------------------------------------------------------------------

NOT_UNDERSTOOD = "could not understand"
GREETING = "Connected: Universal Robots Dashboard Server\n"


class Dashboard:
    """The dashboard's commands, in PolyScope's words."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: "URSoftware " + ".".join(map(str, VERSION)),
            "get serial number": lambda: _SERIAL_NUMBER,
            "get robot model": lambda: "UR5",
            "is in remote control": lambda: "true",
            "robotmode": lambda: f"Robotmode: {controller.mode.name}",
            "safetymode": lambda: f"Safetymode: {controller.safety.name}",
            "safetystatus": lambda: f"Safetystatus: {controller.safety.name}",
            "running": lambda: f"Program running: {str(self._plays()).lower()}",
            "programstate": lambda: "PLAYING script" if self._plays() else "STOPPED No program",
            "get loaded program": lambda: "No program loaded",
            "isprogramsaved": lambda: "true /",
            "stop": _after(partial(controller.end_program, "stopped at the dashboard"), STOPPED),
            "play": lambda: "Failed to execute: play",
            "pause": lambda: "Failed to execute: pause",
            "unlock protective stop": controller.unlock,
            "close safety popup": lambda: "closing safety popup",
            "close popup": lambda: "closing popup",
            "restart safety": self._restart_safety,
            "power on": _after(controller.power_on, "Powering on"),
            "power off": _after(controller.power_off, "Powering off"),
            "brake release": self._release,
            "quit": lambda: "Disconnected",
        }

    def answer(self, line: str) -> str:
        words = line.lower()
        if words.startswith("popup "):
            return "showing popup\n"
        if words.startswith("addtolog "):
            return "Added log message\n"
        answer = self._answers.get(words)
        return (answer() if answer else f"{NOT_UNDERSTOOD}: '{line}'") + "\n"

    def _plays(self) -> bool:
        return self._c.runtime is Runtime.PLAYING

    def _restart_safety(self) -> str:
        if self._c.safety is Safety.ROBOT_EMERGENCY_STOP:
            return "Failed to execute: restart safety"
        return "Restarting safety"

    def _release(self) -> str:
        if self._c.mode is Mode.POWER_OFF:
            self._c.power_on()
        self._c.release_brakes()
        return "Brake releasing"


def _after(act: Callable[[], None], said: str) -> Callable[[], str]:
    """An answer that is given once something has been done."""

    def answer() -> str:
        act()
        return said

    return answer


# --- scripts -------------------------------------------------------------------------------------


class Scripts(_Port):
    """Takes uploaded scripts; a script ends with `end` at the start of a line.

    Only ur_rtde's control program is known: it is not interpreted, the emulator has it built in.
    """

    def __init__(self, controller: Controller, wake: Callable[[], None]) -> None:
        self._controller, self._wake = controller, wake
        self._buffer = ""

    def data_received(self, data: bytes) -> None:
        self._buffer += data.decode("utf-8", "replace")
        if not begins(self._buffer):
            self._transport.abort()  # no script: a web page's request may hold one further down
            return
        while "\nend\n" in self._buffer:
            script, self._buffer = self._buffer.split("\nend\n", 1)
            self._play(script + "\n")
        if len(self._buffer) > _MOST_SCRIPT:
            self._transport.abort()

    def _play(self, script: str) -> None:
        named = _DEFINITION.search(script)
        name = named.group(1) if named else "?"
        if name != _CONTROL_PROGRAM:
            note(self._controller, f"script '{name}' is not ur_rtde's control program: ignored")
            return
        self._controller.play(partial(Program, path=path_in(script)))
        self._wake()


def begins(script: str) -> bool:
    """Whether a text is a script, or may become one when more of it has come: after empty lines and
    comments it defines a program."""
    for line in script.splitlines():
        words = line.strip()
        if words and not words.startswith("#"):
            return words.startswith(_FIRST_WORDS) or any(w.startswith(words) for w in _FIRST_WORDS)
    return True


def path_in(script: str) -> tuple[Waypoint, ...]:
    """The moves that the client put into the control program for `moveL(path)` and its like."""
    _, mark, rest = script.partition(_PATH_MARK)
    body = rest.partition("\n    end")[0] if mark else ""
    return tuple(
        Waypoint(
            joints=move["kind"] == "j",
            pose=bool(move["pose"]),
            target=tuple(float(v) for v in move["target"].split(",")),
            speed=float(move["v"]),
            acceleration=float(move["a"]),
        )
        for move in _MOVE.finditer(body)
    )
