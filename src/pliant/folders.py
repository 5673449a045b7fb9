"""Folders and files that may be somebody else's: what lies in them is data, and bounded.

A link in such a folder could lead anywhere, to be read, written over or removed; a pipe is waited
for without end; a file can be larger than the memory. So a folder is looked through before it is
used (`refuse_links`), a file is read with a bound (`read`), and one that is written is new, under a
name that nobody knew before (`whole`).
"""

import os
import secrets
import shutil
import stat
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pliant.errors import InputError

_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)  # for a pipe's other end
_BINARY = getattr(os, "O_BINARY", 0)
_MOST_SAID = 300  # characters of an error that nobody thought of
_MODE = 0o666  # of a new file, less what the user's umask takes away


def refuse_links(folder: Path, *, but: Collection[str] = ()) -> None:
    """See that a folder holds files and folders of its own and nothing else, however deep. The
    folder itself may be a link: whoever named it chose it. What lies in its own folders named in
    `but` is not looked at.

    Raises:
        InputError: something in it is a link, a pipe or a device; or it cannot be looked through.
    """
    waiting = [folder]
    while waiting:
        looked_at = waiting.pop()
        try:
            with os.scandir(looked_at) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        if looked_at != folder or entry.name not in but:
                            waiting.append(Path(entry.path))
                    elif not entry.is_file(follow_symlinks=False):
                        raise _refused(entry.path, entry.is_symlink())
        except OSError as error:
            raise InputError(f"'{looked_at}' cannot be looked through: {error.strerror}") from error


def refuse_link(path: Path) -> None:
    """Raise InputError if a path is itself a link."""
    if path.is_symlink():
        raise _refused(str(path), True)


def _refused(path: str, is_link: bool) -> InputError:
    what = "a link" if is_link else "neither a file nor a folder"
    return InputError(
        f"'{path}' is {what}: results are files and folders of their own, and it is not followed;"
        " remove it, or put a copy in its place"
    )


def copy(folder: Path, target: Path) -> None:
    """Copy a folder's content, which can be written then, into a new or empty one.

    Raises:
        InputError: something in it is a link, a pipe or a device; the target holds something; or
            either cannot be used.
    """
    refuse_links(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
        if any(target.iterdir()):
            raise InputError(f"'{target}' is not empty: choose a new folder")
        for path in sorted(folder.rglob("*")):
            place = target / path.relative_to(folder)
            if path.is_dir():
                place.mkdir()
            else:
                shutil.copyfile(path, place, follow_symlinks=False)
    except OSError as error:
        raise InputError(
            f"'{folder}' cannot be copied to '{target}': {error.filename}: {error.strerror}; choose"
            " another folder"
        ) from error


def read(path: Path, most: int) -> bytes:
    """The whole of a file of at most `most` bytes.

    Raises:
        OSError: it cannot be read, is a link or no file, or is larger.
    """
    number = os.open(path, os.O_RDONLY | _NO_LINK | _NO_WAIT | _BINARY)
    with os.fdopen(number, "rb") as file:
        found = os.fstat(number)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(0, "it is not a file")
        content = file.read(most + 1) if found.st_size <= most else b""
        if max(found.st_size, len(content)) > most:
            raise OSError(0, f"it is larger than {most / 1e6:.0f} MB")
        return content


def append(path: Path, content: bytes) -> None:
    """Write at the end of a file that is there.

    Raises:
        OSError: it cannot be written, or is a link.
    """
    number = os.open(path, os.O_WRONLY | os.O_APPEND | _NO_LINK | _NO_WAIT | _BINARY)
    with os.fdopen(number, "ab") as file:
        file.write(content)


@contextmanager
def contained(what: str) -> Iterator[None]:
    """A block that works on data which may be somebody else's, wrong in a way that nobody thought
    of: whatever it raises is that data's loss, and says whose.

    Raises:
        InputError: anything was raised.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        said = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise InputError(
            f"{what} holds what pliant did not write ({said[:_MOST_SAID]}); use what pliant wrote"
        ) from error


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A new, empty file to write; it becomes `path` when the block ends well, and goes when it does
    not. Its folder is made. A file that was there hands on its mode; a link at `path` is replaced,
    not followed; a pipe or a device is left as it is.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not (path.is_file() or path.is_dir() or path.is_symlink()):
        raise OSError(0, "it is not a file")
    partial = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_LINK
    os.close(os.open(partial, flags, _MODE))
    try:
        yield partial
        if path.is_file() and not path.is_symlink():
            partial.chmod(stat.S_IMODE(path.stat().st_mode))
        partial.replace(path)
    finally:
        with suppress(FileNotFoundError):  # it has become `path`
            partial.unlink()
