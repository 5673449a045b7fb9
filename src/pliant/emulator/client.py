"""The experiment's side of an emulator in another process: start it, and talk to its admin port."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import Any, Self

from pliant.errors import InputError
from pliant.ur5e.admin_port import ANSWER_S, EMULATOR, AdminConnection, EmulatorEnded
from pliant.ur5e.protocol import ADMIN_PORT

_STOP_S = 10.0
_ERROR = "pliant.emulator: "
_READY = r"ready: .* admin (\S+):(\d+);"


class Admin(AdminConnection):
    """A connection to the admin port. Its requests are the ones of docs/emulator.md.

    Raises:
        InputError: nobody answers there.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = ADMIN_PORT) -> None:
        try:
            super().__init__(host, port, ANSWER_S)
        except OSError as error:
            raise InputError(
                f"no emulator answers at {host}:{port} ({error.strerror}): start one with"
                f" '{EMULATOR}'"
            ) from error

    def ask(self, do: str, **fields: object) -> dict[str, Any]:
        """Send one request and return its answer.

        Raises:
            InputError: the emulator refuses, or is gone.
        """
        try:
            return super().ask(do, **fields)
        except EmulatorEnded as error:
            raise InputError(str(error)) from error
        except OSError as error:
            raise InputError(f"the emulator does not answer: {error}") from error

    def fault(self, kind: str, **fields: object) -> None:
        """Let a fault happen now."""
        self.ask("fault", fault={"kind": kind, **fields})

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def started(*arguments: str) -> Iterator[Admin]:
    """Start an emulator in a process of its own, which ends with this context or with this process.

    `arguments` are those of `python -m pliant.emulator`. The ports are fixed, the address is not:
    with `--host 127.0.0.2` a second one runs beside the first (on Linux).

    Raises:
        InputError: it did not start; the message is its own.
    """
    command = [sys.executable, "-m", "pliant.emulator", "--with-parent"]
    with TemporaryFile("w+", encoding="utf-8", errors="replace") as log:
        process = subprocess.Popen(
            [*command, *arguments],
            stdout=subprocess.PIPE,
            stderr=log,
            encoding="utf-8",
            errors="replace",  # it says its words as its terminal would have them
            start_new_session=True,  # Ctrl-C is for the client, which then ends it
        )
        assert process.stdout is not None
        try:
            ready = re.match(_READY, process.stdout.readline())
            if ready is None:
                process.wait(_STOP_S)
                log.seek(0)
                said = [line for line in log.read().splitlines() if line.startswith(_ERROR)]
                problem = said[-1].removeprefix(_ERROR) if said else f"see '{EMULATOR} --help'"
                raise InputError(f"the emulator did not start: {problem}")
            with Admin(ready[1], int(ready[2])) as admin:
                yield admin
        finally:
            process.terminate()
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()
