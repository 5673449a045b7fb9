"""The code that is run and the models that are asked because an experiment file names them.

Such a file may be somebody else's. What a person names at the command line or in Python they have
chosen; what stands in the file alone must be agreed to.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pliant.errors import InputError

ADVICE = "read it first, then --trust agrees to it"


@dataclass(frozen=True, kw_only=True)
class Named:
    """The code and models that a file itself names: `code` as an absolute path and a class,
    `servers` of models by address, or by provider and model."""

    code: tuple[str, ...] = ()
    servers: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """A line for each thing that would be done; none: the file is data."""
        code = [f"code that will be run: {name}" for name in self.code]
        asked = "a model that will be asked, and shown the cell's pictures"
        return [*code, *(f"{asked}: {server}" for server in self.servers)]


Agree = Callable[[Named], None]
"""A function that is told what a file names; raises InputError where that is not agreed to."""


def refuse(named: Named) -> None:
    """Agree to a file of data alone.

    Raises:
        InputError: the file names code or a model.
    """
    if named.lines:
        raise InputError(f"it names {'; '.join(named.lines)}: {ADVICE}")
