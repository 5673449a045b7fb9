"""The token that whoever commands an emulated cell must know; its emulator leaves it where only the
user who started it can read it.

A port on this machine can be reached by other users, and by every web page in a browser. They can
send, but not read a file.
"""

import os
import platform
import secrets
from pathlib import Path

from pliant import folders
from pliant.errors import InputError

VARIABLE = "PLIANT_EMULATOR_TOKEN"
"""Environment variable with the token, where emulator and client have no user or machine in common:
set it for both."""

_MOST = 200  # [bytes]
_ANY = "0.0.0.0"


def make(host: str, port: int) -> str:
    """The token of an emulator that begins; the environment's, or a new one in its file.

    Raises:
        InputError: the file cannot be written.
    """
    given = os.environ.get(VARIABLE)
    if given:
        return given
    token, path = secrets.token_hex(16), _file(host, port)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with folders.whole(path) as partial:
            partial.chmod(0o600)
            partial.write_text(token, encoding="ascii")
    except OSError as error:
        raise InputError(
            f"the emulator's token cannot be written to '{path}': {error.strerror}; or set"
            f" {VARIABLE} to a secret, for it and for its clients"
        ) from error
    return token


def remove(host: str, port: int) -> None:
    """Remove the token of an emulator that ends: nobody needs it."""
    _file(host, port).unlink(missing_ok=True)


def known(host: str, port: int) -> str:
    """The token of the emulator at an address, as far as this user knows one; else empty."""
    given = os.environ.get(VARIABLE)
    if given:
        return given
    for name in (host, _ANY):
        try:
            return folders.read(_file(name, port), _MOST).decode("ascii")
        except (OSError, UnicodeDecodeError):
            continue
    return ""


def _file(host: str, port: int) -> Path:
    """The token's file in the user's own folder, which may be the same on several machines."""
    address = "127.0.0.1" if host == "localhost" else host
    place = os.environ.get("XDG_RUNTIME_DIR") or Path.home() / ".cache"
    name = f"emulator-{platform.node()}-{address}-{port}"
    return Path(place) / "pliant" / "".join(c if c.isalnum() or c in "-._" else "_" for c in name)
