"""The three ways in which a process is asked to end: Ctrl-C (SIGINT), `kill` (SIGTERM), and a
terminal that is closed (SIGHUP).

All end what is going on as Ctrl-C does, by KeyboardInterrupt: the arm is halted by its driver, and
what was done is kept. They often come to a whole group of processes at once, so those that work for
another one ignore them (`ignore`, `work_for_parent`), and end with the one they work for.
"""

import multiprocessing
import os
import signal
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from types import FrameType

from pliant.errors import RobotFault

_WORDS = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "SIGHUP, the terminal was closed"}
_ENDING = tuple(getattr(signal, name) for name in _WORDS if hasattr(signal, name))
_STANDARD = (0, 1, 2)  # input, output, errors
_heard: list[signal.Signals] = []


def heed() -> None:
    """Let each of the three signals raise KeyboardInterrupt in the main thread from now on. One
    that was to be ignored, as with `nohup`, still is."""
    for number in _ENDING:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _interrupt)


def ignore() -> None:
    """Ignore the three signals from now on: this process is ending already, or works for another,
    which is asked to end as well and ends it in good order."""
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)


def work_for_parent() -> None:
    """Have this process work for its parent and end with it, however that ends. Ctrl-C and a closed
    terminal are the parent's to answer; SIGTERM is how it ends its workers."""
    for number in _ENDING:
        if number != signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def cause() -> str:
    """The cause of the last KeyboardInterrupt, in words."""
    return _WORDS[_heard[-1].name] if _heard else _WORDS["SIGINT"]


def interrupted() -> RobotFault:
    """The fault with which a trial ends that one of the three signals interrupted."""
    return RobotFault("interrupted", f"interrupted by {cause()}; the arm is halted")


def exit_status() -> int:
    """The exit status of a process that one of the three signals ended, as shells have it."""
    return 128 + (_heard[-1] if _heard else signal.SIGINT)


@contextmanager
def once(within_s: float) -> Iterator[None]:
    """Count a request to end that comes several times within so many seconds as one, in this block:
    who presses Ctrl-C again, while the arm is halted and the trial is written, must not stop that.
    A terminal that is closed is followed by other signals, too."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _ENDING}
    heard_s = -within_s

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal heard_s
        handler = before[signal.Signals(number)]
        if callable(handler) and (now := time.monotonic()) - heard_s >= within_s:
            heard_s = now
            handler(number, frame)

    for number, handler in before.items():
        if callable(handler):
            signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            if callable(handler):
                signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _heard.append(signal.Signals(number))
    if _heard[-1].name == "SIGHUP":
        _let_go_of_the_terminal()
    raise KeyboardInterrupt


def _let_go_of_the_terminal() -> None:
    """Send what is said from now on nowhere: writing to a terminal that is gone is an error, and
    would stop what has to be done still."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for file in _STANDARD:
        with suppress(OSError):  # it is closed already
            if stat.S_ISCHR(os.fstat(file).st_mode):
                os.dup2(nowhere, file)
    os.close(nowhere)
