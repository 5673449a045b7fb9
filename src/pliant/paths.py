"""Paths that people write: where they count from, and how they are shown.

A path given at the command line or in Python counts from the current folder; one that stands in a
file counts from that file's folder, and is looked for nowhere else. Both are made absolute as soon
as they are read, since a worker, on this machine or another, has a current folder of its own.
"""

import os
import re
from pathlib import Path

from pliant.errors import InputError

_ADDRESS = re.compile("[a-z][a-z0-9+.-]+:/", re.IGNORECASE)  # longer than a drive's letter


def located(path: str | Path, folder: Path | None = None) -> Path:
    """The absolute path of one that counts from `folder`, or without it from the current folder;
    `~` is the home folder. Links stay as they are written.

    Raises:
        InputError: it holds a zero byte, is an address such as s3://bucket/results, or counts
            from a current folder that is gone.
    """
    if "\0" in str(path):
        raise InputError(f"the path {str(path)!r} holds a zero byte: no file is named so")
    if address := _ADDRESS.match(str(path)):
        raise InputError(
            f"'{path}' is an address ({address[0]}), and pliant reads and writes files and folders"
            " only: name one on a disk, and copy what you want to keep afterwards"
        )
    home = os.path.expanduser(path)  # noqa: PTH111, unlike Path's it takes ~ without such a user
    place = Path(home) if folder is None else folder / home
    return place if place.is_absolute() else current_folder() / place


def expanded(word: str) -> str:
    """A word of a command line with the home folder for `~`, which shells leave as it is in
    `--out=~/runs`."""
    option, path = re.fullmatch(r"(--[\w-]+=)?(.*)", word, re.DOTALL).groups("")  # type: ignore[union-attr]
    return option + os.path.expanduser(path)  # noqa: PTH111, a word need not be a path


def current_folder() -> Path:
    """The current folder; raises InputError if it has been removed."""
    try:
        return Path.cwd()
    except OSError as error:
        raise InputError("the current folder does not exist any more: change to another") from error


def seen_from(path: Path, folder: Path) -> str:
    """A path as a file in `folder` names it, so that both can be moved together; absolute on
    another drive."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return str(path)


def shown(path: Path) -> Path:
    """A path as a person sees it: from the current folder where it lies below that."""
    try:
        return path.relative_to(Path.cwd())
    except (OSError, ValueError):
        return path


def shortened(text: str) -> str:
    """A message with its quoted paths as `shown`."""
    try:
        return text.replace(f"'{Path.cwd() / '_'}"[:-1], "'")
    except OSError:
        return text
