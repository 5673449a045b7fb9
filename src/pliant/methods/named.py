"""Methods by name: the paper's, ours, or a user's own as `my_method.py:Mine`."""

from collections.abc import Callable, Mapping

from pliant.errors import InputError, unknown
from pliant.methods import Method
from pliant.methods.guided import Guided
from pliant.methods.planar import Planar
from pliant.own import make_own, own_file

METHODS: Mapping[str, Callable[[], Method]] = {"planar": Planar, "guided": Guided}
_NEEDS = (
    *("name", "plannable", "follows_belief", "words", "presses_on", "plan"),
    *("cameras", "retakes", "sight", "skill", "prober", "believe", "check"),
)


def method(name: str) -> Method:
    """Make a method. `guided-dither-ease` goes without two of its mechanisms.

    Raises:
        InputError: the name is unknown, or the file or class it points to cannot be used.
    """
    if own_file(name) is not None:
        made: Method = make_own("method", name, _NEEDS, "pliant.methods.Method")
        return made
    kind, *lacking = name.split("-")
    if kind not in METHODS:
        raise unknown("method", name, METHODS, "or your own as path/to/file.py:Class")
    if not lacking:
        return METHODS[kind]()
    if METHODS[kind] is not Guided:
        raise InputError(f"method {name}: only guided can go without a mechanism")
    return Guided(frozenset(lacking))
