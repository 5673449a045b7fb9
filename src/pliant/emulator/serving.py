"""The emulator's process: it opens the ports of one emulated cell and serves them until it is
stopped."""

import asyncio
import contextlib
import errno
import gc
import os
import signal
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from pliant import tokens
from pliant.conditions import condition
from pliant.emulator import admin, faults
from pliant.emulator.block import Block
from pliant.emulator.camera import camera_process
from pliant.emulator.emulator import Emulator, Options
from pliant.emulator.gripper import REFUSED
from pliant.emulator.plant import Plant
from pliant.emulator.ports import GREETING, NOT_UNDERSTOOD, Dashboard, Lines, Scripts
from pliant.errors import InputError
from pliant.task import load_task
from pliant.ur5e.protocol import DASHBOARD_PORT, GRIPPER_PORT, RTDE_PORT, SCRIPT_PORT, Pacing

_PARENT = os.getppid()  # as it began: it may be gone before the ports are open
_PARENT_CHECK_S = 0.2


async def serve(options: Options, say: Callable[[str], None]) -> None:
    """Serve an emulated cell until it is stopped; `say` gets a line when it is ready.

    Raises:
        InputError: an option cannot be used, a port is taken, or there is no OpenGL.
    """
    options.check()
    schedule = faults.load(options.faults) if options.faults is not None else []
    task, setup = load_task(options.peg), condition(options.condition).draw(options.seed)
    with contextlib.closing(Block()) as block:
        block.set_up(options.peg, setup)
        with camera_process(options.host, options.camera_port, block.name) as drawn:
            emulated = Emulator(options, Plant(task, setup), block, schedule)  # side by side
            await _run(emulated, drawn, say)


async def _run(emulator: Emulator, drawn: Callable[[], None], say: Callable[[str], None]) -> None:
    loop, options = asyncio.get_running_loop(), emulator.options
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, emulator.stop)
    await _open(emulator)
    emulator.token = tokens.make(options.host, options.admin_port)
    try:
        await _serve(emulator, drawn, say)
    finally:
        tokens.remove(options.host, options.admin_port)


async def _serve(emulator: Emulator, drawn: Callable[[], None], say: Callable[[str], None]) -> None:
    await asyncio.to_thread(drawn)
    gc.freeze()  # models and libraries: nothing that the collector need visit again
    tasks = [asyncio.create_task(job) for job in _jobs(emulator)]
    say(_greeting(emulator))
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            raise result


def _jobs(emulator: Emulator) -> Iterator[Coroutine[Any, Any, object]]:
    yield emulator.pace.run()
    yield emulator.until_stopped()
    if emulator.options.with_parent:
        yield _until_orphaned()


async def _open(emulator: Emulator) -> None:
    controller, host = emulator.controller, emulator.options.host
    dashboard, loop = Dashboard(controller), asyncio.get_running_loop()
    factories: dict[int, Callable[[], asyncio.BaseProtocol]] = {
        RTDE_PORT: emulator.rtde.connection,
        SCRIPT_PORT: lambda: Scripts(controller, emulator.pace.wake),
        DASHBOARD_PORT: lambda: Lines(dashboard.answer, NOT_UNDERSTOOD, GREETING),
        GRIPPER_PORT: lambda: Lines(controller.gripper.answer, REFUSED),
    }
    ports = [*factories.items(), (emulator.options.admin_port, lambda: admin.protocol(emulator))]
    for port, factory in ports:
        try:
            await loop.create_server(factory, host, port)
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise InputError(
                    f"host {host} is no address of this machine: give one that is, as 127.0.0.2"
                ) from error
            raise InputError(
                f"port {port} on {host} cannot be opened ({os.strerror(error.errno or 0)}):"
                " end the program that has it, or give another --host, as 127.0.0.2"
            ) from error


def _greeting(emulator: Emulator) -> str:
    options, pace = emulator.options, emulator.pace
    pacing = f"{pace.pacing} at {pace.speed:g}×" if pace.pacing is Pacing.FAST else pace.pacing
    return (
        f"ready: UR5e at {options.host}, {pacing};"
        f" admin {options.host}:{options.admin_port};"
        f" camera http://{options.host}:{options.camera_port}/side.jpg"
    )


async def _until_orphaned() -> None:
    while os.getppid() == _PARENT:
        await asyncio.sleep(_PARENT_CHECK_S)
