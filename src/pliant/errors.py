"""The errors a user meets.

    PliantError
    ├── InputError      something the user gave cannot be used: exit status 2, one line
    └── RobotFault      the cell failed during a trial: recorded as the trial's end reason

Anything else that is raised is a defect.
"""

import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path

_LIBRARIES = (
    str(Path(__file__).parent) + os.sep,
    *(sysconfig.get_path(name) + os.sep for name in ("stdlib", "purelib", "platlib")),
    "<",  # made at run time, as dataclasses do
)


class PliantError(Exception):
    """Every error that pliant raises on purpose."""


class InputError(PliantError, ValueError):
    """The error for something a user gave: in one line what was given, which value, what is valid
    and what to do. `place` is where in a file's data the value stands: names of fields, and places
    in lists from 0."""

    place: tuple[str | int, ...] = ()


@contextmanager
def within(*place: str | int) -> Iterator[None]:
    """Say of an InputError raised inside that its place lies within this one."""
    try:
        yield
    except InputError as error:
        error.place = (*place, *error.place)
        raise


class RobotFault(PliantError):
    """The cell cannot go on. `kind` names why, in one word that the trial's end reason repeats."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind

    @property
    def end_reason(self) -> str:
        return f"fault:{self.kind}"


def unknown(what: str, value: object, valid: Iterable[object], advice: str = "") -> InputError:
    """The error for a name that is not among the valid ones."""
    names = [str(v) for v in valid]
    also = f"; {advice}" if advice else ""
    return InputError(
        f"unknown {what} '{value}': valid are {', '.join(names)}{also}{did_you_mean(value, names)}"
    )


def did_you_mean(name: object, valid: Iterable[object]) -> str:
    """The question whether a similar valid name was meant, for a name that is not among the valid
    ones; "" where nothing is near."""
    near = get_close_matches(str(name), [str(v) for v in valid], 1)
    return f"; did you mean '{near[0]}'?" if near else ""


def installing(extra: str) -> str:
    """The command that brings an extra to the environment in which this runs. One that `make` made
    in a checkout has no pip of its own: a shell would find the system's."""
    if find_spec("pip") is None and Path(sys.prefix, "..", ".tools", "bin", "uv").exists():
        return f".tools/bin/uv pip install -e '.[{extra}]' in the checkout"
    if extra == "local":  # needs another package of the checkout
        return "pip install 'pliant[local]' (in a checkout: make dist, then add --find-links dist)"
    return f"pip install '.[{extra}]' in a checkout"


def users_frames(error: BaseException) -> list[traceback.FrameSummary]:
    """The places where an exception passed through code that is neither pliant's nor an installed
    library's, outermost first."""
    frames = traceback.extract_tb(error.__traceback__)
    return [frame for frame in frames if not frame.filename.startswith(_LIBRARIES)]


def described(error: BaseException) -> str:
    """An exception in one line: its type, its message, and the last line of the user's own code
    that it passed; without such, the last line of all."""
    if isinstance(error, SyntaxError) and error.filename is not None:  # it passed through no code
        return f"{type(error).__name__}: {error.msg} ({line_of(error.filename, error.lineno)})"
    message = " ".join(str(error).split())
    frames = users_frames(error) or list(traceback.extract_tb(error.__traceback__))
    text = type(error).__name__ + (f": {message}" if message else "")
    return text + "".join(f" ({line_of(f.filename, f.lineno)})" for f in frames[-1:])


def line_of(file: str, line: int | None) -> str:
    """A line of a file, named as shortly as it can be from here."""
    path = Path(file)
    with suppress(OSError, ValueError):  # the current folder is gone, or it is not below it
        path = path.relative_to(Path.cwd())
    return f"{path}:{line}"
