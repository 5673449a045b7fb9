"""`python -m pliant.emulator`: serve an emulated UR5e cell until it is stopped."""

import asyncio
import selectors
import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from pliant.emulator.emulator import ADMIN_PORT, CAMERA_PORT, Emulator, Options
from pliant.emulator.pace import Pacing
from pliant.errors import InputError, PliantError


def emulate(
    *,
    peg: str = "circle",
    condition: str = "none",
    seed: int = 0,
    mode: Literal["real", "fast", "lockstep"] = "real",
    speed: float = 4.0,
    host: str = "127.0.0.1",
    admin_port: int = ADMIN_PORT,
    camera_port: int = CAMERA_PORT,
    force_limit: float = 150.0,
    force_noise: float = 0.0,
    faults: Path | None = None,
    with_parent: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """An emulated UR5e controller with a soft wrist, a gripper and a camera.

    Args:
        peg: circle, square, rectangle, or the path of a peg file (.yaml).
        condition: none, friction, pose or all: what the first trial draws at random.
        seed: decides what is drawn.
        mode: real, fast, or lockstep, where a client grants the ticks through the admin port.
        speed: times real time, in fast mode.
        host: the address to serve; others than loopback can be reached from elsewhere.
        admin_port: of the experiment's side.
        camera_port: of the camera's pictures, over HTTP.
        force_limit: external force [N] beyond which the controller stops by itself.
        force_noise: standard deviation [N] of the measured force.
        faults: a file of faults to come (.yaml).
        with_parent: end when the process that started this one does.
    """
    if not 0.0 < speed <= 100.0:
        raise InputError(f"speed {speed:g}: it must be above 0 and at most 100 times real time")
    options = Options(
        peg=peg,
        condition=condition,
        seed=seed,
        pacing=Pacing(mode),
        speed=speed,
        host=host,
        admin_port=admin_port,
        camera_port=camera_port,
        force_limit=force_limit,
        force_noise=force_noise,
        faults=faults,
        with_parent=with_parent,
    )
    if not options.is_loopback():
        print(
            f"warning: {host} can be reached from other machines, and nothing here asks for a"
            " password",
            file=sys.stderr,
        )
    # The default selector rounds waits up to milliseconds, which are most of a tick.
    with asyncio.Runner(
        loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())
    ) as runner:
        runner.run(_serve(options))


async def _serve(options: Options) -> None:
    await Emulator(options).run(lambda text: print(text, flush=True))


def main() -> None:
    """Exit status: 0 stopped, 2 wrong usage or a port that is taken."""
    try:
        tyro.cli(emulate, prog="python -m pliant.emulator")
    except PliantError as error:
        print(f"pliant.emulator: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
