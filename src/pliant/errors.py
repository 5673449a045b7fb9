"""The errors a user meets.

    PliantError
    ├── InputError      something the user gave cannot be used: exit status 2, one line
    └── RobotFault      the cell failed during a trial: recorded as the trial's end reason

Anything else that is raised is a defect.
"""

from collections.abc import Iterable


class PliantError(Exception):
    """Every error that pliant raises on purpose."""


class InputError(PliantError, ValueError):
    """What was given, which value, what is valid and what to do, in one line."""


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
    names = ", ".join(str(v) for v in valid)
    return InputError(
        f"unknown {what} '{value}': valid are {names}{'; ' + advice if advice else ''}"
    )
