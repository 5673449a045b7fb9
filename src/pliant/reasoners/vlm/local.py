"""The model that comes with pliant, or one tuned from it, behind a server of this process's own.

llama.cpp serves it in a process beside this one (`llama`), to nobody but this machine. That process
ends with the one that started it, however that ends: its standard input does.
"""

import atexit
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from threading import Timer

from pliant.errors import InputError, installing
from pliant.reasoners.vlm import llama
from pliant.reasoners.vlm.settings import LOCAL, Settings
from pliant.reasoners.vlm.words import one_line

MODEL, PROJECTOR = "model.gguf", "mmproj.gguf"
_PACKAGE = "pliant_vlm"
_LIBRARIES = ("pydantic_ai", "openai", "xllamacpp")
_UP_S, _DOWN_S = 120.0, 10.0  # at most


@dataclass(frozen=True, kw_only=True)
class Weights:
    """The files of a model, and the name under which it is served."""

    model: Path
    projector: Path
    name: str


def weights_of(settings: Settings) -> Weights | None:
    """The files of the model that settings name, which need not be there; None: it is not served
    here, or the package with its files is not installed."""
    folder = settings.folder or _shipped() if settings.is_local else None
    if folder is None:
        return None
    return Weights(model=folder / MODEL, projector=folder / PROJECTOR, name=str(settings.name))


def installed(settings: Settings) -> Weights:
    """The files of the model that settings name, which pliant is to serve.

    Raises:
        InputError: they or what serves them are missing.
    """
    weights = weights_of(settings)
    if settings.folder is not None and weights is not None:
        _check(weights)
        _needs(*_LIBRARIES)
        return weights
    _needs(*_LIBRARIES, _PACKAGE)
    assert weights is not None, "the package is there"
    if absent := _absent(weights):
        raise _missing(f"{_PACKAGE}/{absent.name}")
    return weights


def tuned(model: Path, projector: Path) -> Weights:
    """The files of a model by their own names.

    Raises:
        InputError: they or what serves them are missing.
    """
    name = model.parent.name if model.name == MODEL else model.stem
    weights = Weights(model=model, projector=projector, name=f"{LOCAL}:{name}")
    _check(weights)
    _needs("xllamacpp")
    return weights


def _check(weights: Weights) -> None:
    if absent := _absent(weights):
        raise InputError(
            f"model '{weights.name}': '{absent}' is not there; a tuned model is a folder with"
            f" {MODEL} and {PROJECTOR}"
        )


def _absent(weights: Weights) -> Path | None:
    files = (weights.model, weights.projector)
    return next((path for path in files if not path.is_file()), None)


def _needs(*packages: str) -> None:
    for package in packages:
        if find_spec(package) is None:
            raise _missing(package)


def _missing(what: str) -> InputError:
    return InputError(
        f"pliant's own model needs the extra 'local' ({what} is missing):"
        f" {installing('local')}; or name another model with --model, such as openai:gpt-4o"
    )


class Server:
    """A server with its process, ready when this is made. Port 0 is any that is free.

    Raises:
        InputError: it did not start; its log says why.
    """

    def __init__(self, weights: Weights, port: int = 0) -> None:
        self.weights, self.started_by = weights, os.getpid()
        self._log = TemporaryFile()  # noqa: SIM115, as long as the server
        command = [sys.executable, "-P", llama.__file__, "--port", str(port)]
        command += ["--model", str(weights.model), "--projector", str(weights.projector)]
        self._process = subprocess.Popen(
            [*command, "--name", weights.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            start_new_session=True,  # Ctrl-C is not for it
        )
        assert self._process.stdout is not None
        watchdog = Timer(_UP_S, self._process.kill)
        watchdog.start()
        try:
            address = self._process.stdout.readline().decode().strip()
            if not address:
                self._process.wait()
                raise InputError(
                    f"the server of model '{weights.name}' did not start: {self._said()}"
                )
        except BaseException:
            self.close()
            raise
        finally:
            watchdog.cancel()
        self.base_url = f"{address}/v1"

    def check(self) -> None:
        """Raise InputError where it ended by itself."""
        if self._process.poll() is not None:
            raise InputError(
                f"the server of model '{self.weights.name}' ended by itself: {self._said()}"
            )

    def wait(self) -> None:
        """Wait for it to end by itself, which is an InputError."""
        self._process.wait()
        self.check()

    def close(self) -> None:
        """End it, and wait for that."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        try:
            self._process.wait(_DOWN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()
        self._log.close()

    def _said(self) -> str:
        """Its errors, or else the last that it said, and how it ended."""
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").splitlines()
        errors = [line.partition(": ")[2] for line in lines if " E " in line]
        told = "; ".join(errors[:2] or lines[-1:]) or "it said nothing"  # the cause comes first
        return f"{one_line(told)} (exit status {self._process.returncode})"


@contextmanager
def serving(weights: Weights, port: int = 0) -> Iterator[Server]:
    """A server that ends with the context. Raises InputError as `Server`."""
    server = Server(weights, port)
    try:
        yield server
    finally:
        server.close()


_own: Server | None = None


def base_url(settings: Settings) -> str:
    """The address of this process's server of the model that settings name. It is started when it
    is first asked for, and ends with this process or when another model is.

    Raises:
        InputError: something is missing, or the server did not start, or ended by itself.
    """
    global _own
    weights = installed(settings)
    if _own is not None and (_own.started_by != os.getpid() or _own.weights != weights):
        close()
    if _own is None:
        _own = Server(weights)
    _own.check()
    return _own.base_url


@atexit.register
def close() -> None:
    """End this process's server, if it has one."""
    global _own
    if _own is not None and _own.started_by == os.getpid():  # else a fork's parent has it
        _own.close()
    _own = None


def _shipped() -> Path | None:
    spec = find_spec(_PACKAGE)
    return None if spec is None or spec.origin is None else Path(spec.origin).parent
