"""A folder of pages served to browsers on this machine, and nothing but that folder."""

import re
import sys
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedIOBase
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote, urlsplit

from pliant.errors import InputError
from pliant.experiment.results import TRIALS_FILE
from pliant.store import JOURNAL

HOST = "127.0.0.1"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".jsonl": "text/plain; charset=utf-8",
    ".md": "text/plain; charset=utf-8",
    ".LICENSE": "text/plain; charset=utf-8",
    ".jpg": "image/jpeg",
    ".png": "image/png",
    ".mp4": "video/mp4",
}
_INDEX = "index.html"
REFRESH_S = 5
"""How often a browser asks again for the page of an experiment that still runs."""
_CHUNK = 1 << 16  # [bytes]
_PATIENCE_S = 30.0  # for a browser that has stopped talking


class Server:
    """A server of `folder` on the loopback address, read only. It answers a request for a part of a
    file, so that a video can be sought.

    Raises:
        InputError: there is no such folder, or the port cannot be used.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        if not folder.is_dir():
            raise InputError(f"'{folder}' is no folder: name a result folder")
        handler = type("Handler", (_Handler,), {"root": folder.resolve()})
        try:
            self._server = _Loopback((HOST, port), handler)
        except (OSError, OverflowError) as error:
            why = error.strerror if isinstance(error, OSError) else "it must be 0 to 65535"
            raise InputError(
                f"port {port} cannot be used: {why}; choose another, or 0 for a free one"
            ) from error

    @property
    def port(self) -> int:
        return self._server.server_port

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.port}/"

    def run(self) -> None:
        """Serve until `close`, or until it is interrupted."""
        try:
            self._server.serve_forever()
        finally:
            self._server.server_close()

    def close(self) -> None:
        """End `run`, from another thread."""
        self._server.shutdown()


class _Loopback(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Report an error, unless a browser went away in the middle: anything else is a defect."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Part:
    """Bytes `first` to before `end` of a file of `size` bytes."""

    first: int
    end: int
    size: int


class _Handler(BaseHTTPRequestHandler):
    root: Path
    protocol_version = "HTTP/1.1"
    server_version = "pliant"
    sys_version = ""
    timeout = _PATIENCE_S

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def log_message(self, *_: object, **__: object) -> None:
        """Do not show requests: the terminal is for what matters."""

    def _answer(self, *, with_body: bool) -> None:
        if not self._is_for_us():
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        asked = unquote(urlsplit(self.path).path, errors="replace")
        path = self._file(asked)
        if path is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif path.is_dir():
            self._redirect()
        else:
            try:
                file = path.open("rb")
            except OSError:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            with file:
                self._send(file, path, with_body=with_body)

    def _is_for_us(self) -> bool:
        """Whether a request names this machine. A page of another site may have its own name lead
        to it; it is not answered."""
        name, _, _ = self.headers.get("Host", "").rpartition(":")
        return name in (HOST, "localhost")

    def _file(self, asked: str) -> Path | None:
        """The file asked for, or the folder that lacks its final slash; None: there is none in the
        root."""
        if not asked.startswith("/") or "\0" in asked or "\\" in asked:
            return None
        path = self.root / asked.lstrip("/")
        if asked.endswith("/"):
            path = path / _INDEX
        try:
            real = path.resolve(strict=True)  # links are followed, and must end inside
        except (OSError, RuntimeError):
            return None
        inside = real.is_relative_to(self.root)
        return real if inside and (real.is_file() or real.is_dir()) else None

    def _redirect(self) -> None:
        path, _, query = self.path.partition("?")
        self.send_response(HTTPStatus.MOVED_PERMANENTLY)
        # One slash at the start: two would name another host.
        self.send_header("Location", f"/{path.lstrip('/')}/{'?' if query else ''}{query}")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def _send(self, file: BinaryIO, path: Path, *, with_body: bool) -> None:
        size = path.stat().st_size
        part = _part(self.headers.get("Range"), size)
        if part is None:
            self.send_response(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE)
            self.send_header("Content-Range", f"bytes */{size}")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        whole = part.end - part.first == size
        self.send_response(HTTPStatus.OK if whole else HTTPStatus.PARTIAL_CONTENT)
        self.send_header("Content-Type", _TYPES.get(path.suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(part.end - part.first))
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Cache-Control", "no-cache")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        if path == self.root / _INDEX and is_unfinished(self.root):
            self.send_header("Refresh", str(REFRESH_S))
        if not whole:
            self.send_header("Content-Range", f"bytes {part.first}-{part.end - 1}/{size}")
        self.end_headers()
        if with_body:
            _copy(file, self.wfile, part)


def is_unfinished(folder: Path) -> bool:
    """Whether trials of an experiment in the folder are still to come."""
    return (folder / JOURNAL).is_file() and not (folder / TRIALS_FILE).is_file()


def _part(asked: str | None, size: int) -> _Part | None:
    """The part of a file that is asked for: all unless one range is named; None: none of it is
    there."""
    found = re.fullmatch(r"bytes=(\d*)-(\d*)", (asked or "").replace(" ", ""))
    if found is None or found.groups() == ("", ""):
        return _Part(0, size, size)
    first, last = found.groups()
    if not first:  # the last so many bytes
        begin, end = max(0, size - int(last)), size
    else:
        begin, end = int(first), min(size, int(last) + 1) if last else size
    return _Part(begin, end, size) if begin < end else None


def _copy(source: BinaryIO, target: BufferedIOBase, part: _Part) -> None:
    source.seek(part.first)
    left = part.end - part.first
    while left and (piece := source.read(min(_CHUNK, left))):
        target.write(piece)
        left -= len(piece)
