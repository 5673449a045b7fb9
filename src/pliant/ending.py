"""How a program ends that cannot go on: with one line on stderr, and an exit status."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

from pliant import signals
from pliant.console import complain
from pliant.errors import PliantError
from pliant.paths import shortened


@contextmanager
def in_a_line(program: str) -> Iterator[None]:
    """Do what is inside as `program`, and exit where it cannot be done. Status 2: something is
    wrong with what was given, or the machine is in the way; 1: whoever read the output has gone;
    where a signal ended it, that of the signal."""
    try:
        try:
            yield
        finally:  # what cannot be shown is found out here, and not as the program ends
            sys.stdout.flush()
    except PliantError as error:
        _leave(program, 2, shortened(str(error)))
    except UnicodeEncodeError as error:  # the streams replace, so it is a file's name
        _leave(
            program,
            2,
            f"a file's name has {error.object[error.start : error.end]!r}, which the locale's"
            f" encoding, {error.encoding}, lacks: set PYTHONUTF8=1",
        )
    except BrokenPipeError:  # whoever reads, such as head, has seen enough
        _silence()
        sys.exit(1)
    except OSError as error:  # a full disk or terminal, a folder that may not be read
        _silence()
        what = f"'{error.filename}'" if error.filename else "the output"
        _leave(program, 2, f"{what} cannot be used: {error.strerror or error}")
    except MemoryError:
        _leave(program, 2, "out of memory: end other programs, or raise the limit (ulimit -v)")
    except KeyboardInterrupt as stop:
        signals.ignore()  # who presses Ctrl-C again is not to take the exit status away
        said = shortened(": ".join(["interrupted", *map(str, stop.args)]))
        _leave(program, signals.exit_status(), said)


def _leave(program: str, status: int, said: str) -> NoReturn:
    with suppress(OSError):
        complain(f"{program}: {said}")
    sys.exit(status)


def _silence() -> None:
    """Write nothing more to standard output, also not as the program ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
