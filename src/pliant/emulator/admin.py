"""The admin port: the experiment's side of the emulated cell. One JSON object per line, both ways.

A request names what to `do`; the answer has `ok` true and the result, or `ok` false and `error`.
docs/emulator.md lists the requests; those that change something need the emulator's token.
"""

import asyncio
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from pliant import tokens
from pliant.conditions import PAPER_RANGES, Condition, Setup, condition
from pliant.emulator.emulator import Emulator
from pliant.emulator.faults import Fault, first_problem
from pliant.emulator.pace import MOST_SPEED
from pliant.errors import InputError, PliantError
from pliant.files import Fields
from pliant.ur5e.protocol import Pacing

_MOST_LINE = 1 << 16  # [bytes]


class _Request(Fields):
    token: str = ""


class Describe(_Request):
    """Ask for frames, tool and payload: what a client's configuration needs."""

    do: Literal["describe"]


class State(_Request):
    """Ask for the controller's state now."""

    do: Literal["state"]


class SetUp(_Request):
    """Begin a trial: hole, friction and grasp drawn by a condition, or given; the arm at home."""

    do: Literal["setup"]
    peg: str | None = None  # None: as it is
    condition: str | None = None
    seed: int = Field(default=0, ge=0)
    friction: float | None = None
    hole_y: float | None = None  # [m]
    grasp_roll: float | None = None  # [rad]

    def setup(self) -> Setup:
        """The setup that the request asks for: drawn by a condition, or given.

        Raises:
            InputError: the condition is unknown, a value is out of range, or both are given.
        """
        values = {name: getattr(self, name) for name in PAPER_RANGES}
        given = {name: (value, value) for name, value in values.items() if value is not None}
        if self.condition is not None and given:
            raise InputError(f"give a condition or {', '.join(given)}, not both")
        drawn = Condition(name="given", ranges=given)
        return (condition(self.condition) if self.condition is not None else drawn).draw(self.seed)


class Truth(_Request):
    """Ask for the ground truth now."""

    do: Literal["truth"]


class Grant(_Request):
    """Let a controller in lockstep go on by so many ticks of 2 ms; answered when it has."""

    do: Literal["grant"]
    ticks: int = Field(gt=0, le=500_000)


class ChangePace(_Request):
    """Change the pace from now on."""

    do: Literal["pace"]
    mode: Pacing
    speed: float = Field(default=1.0, gt=0.0, le=MOST_SPEED)


class Suffer(_Request):
    """Let a fault happen now."""

    do: Literal["fault"]
    fault: Fault


class Restore(_Request):
    """Undo every fault, as a technician would. No program runs afterwards."""

    do: Literal["restore"]


class Guide(_Request):
    """Lead the arm by hand, in freedrive: the tool's centre point to a pose, in a straight line."""

    do: Literal["guide"]
    pose: Annotated[list[float], Field(min_length=6, max_length=6)]  # base frame
    speed: float = Field(default=0.1, gt=0.0, le=1.0)  # [m/s]


class Trajectory(_Request):
    """Store the trial's joint trajectory in a folder, to draw it again."""

    do: Literal["trajectory"]
    folder: Path


class Stop(_Request):
    """End the emulator."""

    do: Literal["stop"]


Request = Annotated[
    Describe
    | State
    | SetUp
    | Truth
    | Grant
    | ChangePace
    | Suffer
    | Restore
    | Guide
    | Trajectory
    | Stop,
    Field(discriminator="do"),
]
_ANYBODYS = (Describe, State, Truth)
"""Requests that change nothing, and need no token."""

_REQUEST: TypeAdapter[Request] = TypeAdapter(Request)
_ANSWER: TypeAdapter[dict[str, Any]] = TypeAdapter(dict[str, Any])


def protocol(emulator: Emulator) -> asyncio.BaseProtocol:
    """The protocol that serves one client's connection."""

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while (line := await reader.readline()).startswith(b"{"):  # else it is not ours
                writer.write(_ANSWER.dump_json(await _reply(emulator, line)) + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError):
            return  # the client has left, or what it sends are not lines
        finally:
            writer.close()

    reader = asyncio.StreamReader(limit=_MOST_LINE)
    return asyncio.StreamReaderProtocol(reader, talk)


async def _reply(emulator: Emulator, line: bytes) -> dict[str, Any]:
    try:
        request = _REQUEST.validate_json(line)
        if not isinstance(request, _ANYBODYS) and not emulator.is_token(request.token):
            raise InputError(
                "the token is not this emulator's: only the user who started it knows it, or set"
                f" {tokens.VARIABLE} for both"
            )
        return {"ok": True, **await perform(emulator, request)}
    except ValidationError as error:
        return {"ok": False, "error": first_problem(error)}
    except PliantError as error:
        return {"ok": False, "error": str(error)}


async def perform(emulator: Emulator, request: Request) -> dict[str, Any]:
    """Do what is asked, and return the answer's fields.

    Raises:
        PliantError: it cannot be done.
    """
    match request:
        case Describe():
            return emulator.describe()
        case State():
            return emulator.state()
        case SetUp():
            setup = request.setup()
            await emulator.set_up(request.peg, setup)
            return {"setup": asdict(setup), "time_s": emulator.controller.time_s}
        case Truth():
            return {"truth": asdict(emulator.plant.truth())}
        case Grant():
            pacing = emulator.pace.pacing
            if pacing is not Pacing.LOCKSTEP:
                raise InputError(f"the pace is {pacing}: ticks are granted in lockstep only")
            await emulator.pace.grant(request.ticks)
            return {"time_s": emulator.controller.time_s}
        case ChangePace():
            emulator.pace.set(request.mode, request.speed)
        case Suffer():
            emulator.suffer(request.fault)
        case Restore():
            emulator.restore()
        case Guide():
            emulator.guide(request.pose, request.speed)
        case Trajectory():
            emulator.plant.save_trajectory(request.folder)
        case Stop():
            emulator.stop()
    return {}
