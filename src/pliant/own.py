"""A user's own reasoner, method or cell: a class in a file, by the name `path/to/file.py:Class`."""

import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pliant.errors import InputError, described, did_you_mean
from pliant.paths import located


def own_file(name: str, folder: Path | None = None) -> tuple[Path, str] | None:
    """The file, absolute, and the class that a name says; None: it is no name of a user's own. A
    relative path counts from `folder`, or without it from the current folder."""
    path, attribute = _parts(name)
    return (located(path, folder), attribute) if path else None


def located_own(name: str, folder: Path | None = None) -> str:
    """A name that says the same whatever the current folder is."""
    own = own_file(name, folder)
    return name if own is None else f"{own[0]}:{own[1]}"


def short_name(name: str) -> str:
    """A name as results have it: a user's file without its folder, so that results do not depend on
    where that is."""
    path, attribute = _parts(name)
    return f"{Path(path).name}:{attribute}" if path else name


def make_own(what: str, name: str, needs: Sequence[str], protocol: str) -> Any:
    """An object of a user's own class, which must have all that `needs` names.

    Raises:
        InputError: the file or the class cannot be used, or it lacks something.
    """
    own = own_file(name)
    assert own is not None, "the name says a file and a class"
    path, attribute = own
    spec = importlib.util.spec_from_file_location(f"pliant_user_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"{what} file '{path}' does not exist")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up there
    try:
        spec.loader.exec_module(module)
        made = getattr(module, attribute)() if hasattr(module, attribute) else None
    except (Exception, SystemExit) as error:  # a user's file may raise anything
        raise InputError(f"{what} '{name}' cannot be made: {described(error)}") from error
    if not hasattr(module, attribute):
        written = [n for n, v in vars(module).items() if getattr(v, "__module__", "") == spec.name]
        has = f"it has {', '.join(written)}" if written else "it has none"
        raise InputError(
            f"{what} file '{path}' has no class '{attribute}': {has}"
            f"{did_you_mean(attribute, written)}"
        )
    for member in needs:
        if not hasattr(made, member):
            raise InputError(f"{what} '{name}' lacks '{member}'; see {protocol}")
    return made


def _parts(name: str) -> tuple[str, str]:
    """The path and the class in the name of a user's own; of another, nothing."""
    path, _, attribute = name.rpartition(":")  # the last: a drive or a folder may hold one, too
    return (path, attribute) if path.endswith(".py") else ("", "")
