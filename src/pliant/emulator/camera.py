"""The camera server: a process of its own that draws the plant's latest state when asked.

    GET /side.jpg, /side.png, /wide.jpg, /wide.png    the latest frame
    GET /side.mjpg                                    frames as they come, until the client leaves
    GET /cameras.json                                 the cameras' calibration to the task frame

A frame's header `X-Robot-Time` is the controller's time stamp [s] of what it shows.
"""

import ipaddress
import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection
from urllib.parse import urlsplit

import cv2
import mujoco
from pydantic import TypeAdapter

from pliant import pictures, signals
from pliant.cell import Camera
from pliant.emulator.block import Block, BlockState, CameraFault
from pliant.errors import InputError
from pliant.sim import model as m
from pliant.sim.render import CAMERAS, Cameras
from pliant.sim.setup import apply
from pliant.task import load_task
from pliant.ur5e.protocol import TIME_HEADER

_TYPES = {"jpg": "image/jpeg", "png": "image/png"}
_JPEG_QUALITY = 95
_START_S = 60.0
_BOUNDARY = "frame"
_UNAVAILABLE, _NOT_FOUND, _FORBIDDEN = 503, 404, 403


@dataclass(frozen=True, kw_only=True)
class CameraFrame:
    """An encoded picture and the controller's time [s] of what it shows."""

    time_s: float
    data: bytes


class Artist:
    """Draws states of the cell. Use it from one thread only: OpenGL belongs to a thread."""

    def __init__(self) -> None:
        self._peg = ""
        self._cameras: Cameras | None = None

    def draw(self, state: BlockState, camera: str, kind: str) -> CameraFrame:
        """Draw one frame of `camera`, as jpg or png."""
        cameras = self._for(state.peg)
        apply(self._model, state.setup)
        seen = cameras.image_at(camera, self._data, state.qpos)
        options = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if kind == "jpg" else []
        data = pictures.encoded(seen, kind, options)
        return CameraFrame(time_s=state.time_s, data=data)

    def calibrations(self, state: BlockState) -> list[Camera]:
        """Every camera's calibration."""
        cameras = self._for(state.peg)
        return [cameras.view(name, self._data, 0.0).camera for name in CAMERAS]

    def _for(self, peg: str) -> Cameras:
        if self._cameras is None or peg != self._peg:
            if self._cameras is not None:
                self._cameras.close()
            self._model = m.build(load_task(peg))
            self._data = mujoco.MjData(self._model)
            self._cameras = Cameras(self._model)
            self._peg = peg
        return self._cameras


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], block: Block) -> None:
        self.block, self.artist = block, Artist()
        self.drawing = ThreadPoolExecutor(1)  # OpenGL belongs to a thread
        self.kept: dict[tuple[str, str], CameraFrame] = {}
        super().__init__(address, _Handler)

    def frame(self, camera: str, kind: str) -> CameraFrame:
        """The latest frame; a frozen camera's is its last one before it froze."""
        state = self.block.read()
        key = (camera, kind)
        if state.fault is CameraFault.FROZEN and key in self.kept:
            return self.kept[key]
        self.kept[key] = self.drawing.submit(self.artist.draw, state, camera, kind).result()
        return self.kept[key]


def names_an_address(host: str) -> bool:
    """Whether an HTTP request's host, with its port or without, is an address and no name: a page
    of another site may have its own name lead to this machine."""
    name = urlsplit(f"//{host}").hostname or ""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name == "localhost"
    return True


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        if not names_an_address(self.headers.get("Host", "")):
            self._send(_FORBIDDEN, "text/plain", b"ask for it by its address\n")
            return
        fault = self.server.block.read().fault
        if fault is CameraFault.DEAD:
            self.close_connection = True
            return
        if fault is CameraFault.ERROR:
            self._send(_UNAVAILABLE, "text/plain", b"the camera is not available\n")
            return
        camera, _, kind = self.path.removeprefix("/").partition(".")
        if self.path == "/cameras.json":
            self._calibration()
        elif camera in CAMERAS and kind in _TYPES:
            frame = self.server.frame(camera, kind)
            self._send(200, _TYPES[kind], frame.data, frame.time_s)
        elif camera in CAMERAS and kind == "mjpg":
            self._stream(camera)
        else:
            self._send(_NOT_FOUND, "text/plain", b"try /side.jpg, /wide.png or /cameras.json\n")

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Log nothing: requests are not worth a line each."""

    def _calibration(self) -> None:
        server = self.server
        drawn = server.drawing.submit(server.artist.calibrations, server.block.read()).result()
        body = TypeAdapter(list[Camera]).dump_json(drawn)
        self._send(200, "application/json", body)

    def _send(self, status: int, kind: str, body: bytes, time_s: float | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        if time_s is not None:
            self.send_header(TIME_HEADER, f"{time_s:.6f}")
        self.end_headers()
        self.wfile.write(body)

    def _stream(self, camera: str) -> None:
        self.close_connection = True
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self.end_headers()
        try:
            while self.server.block.read().fault in (CameraFault.OK, CameraFault.FROZEN):
                frame = self.server.frame(camera, "jpg")
                self.wfile.write(
                    f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\n"
                    f"Content-Length: {len(frame.data)}\r\n"
                    f"{TIME_HEADER}: {frame.time_s:.6f}\r\n\r\n".encode()
                    + frame.data
                    + b"\r\n"
                )
        except (BrokenPipeError, ConnectionResetError):
            return  # the client has left


@contextmanager
def camera_process(host: str, port: int, block_name: str) -> Iterator[Callable[[], None]]:
    """Run the camera server as a process that ends with this context, or with this process. What
    it gives waits until the server has drawn its first frame, and raises InputError if it cannot
    serve."""
    context = multiprocessing.get_context("spawn")  # OpenGL does not outlive a fork
    ready, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(host, port, block_name, theirs), daemon=True)
    process.start()
    theirs.close()

    def wait() -> None:
        try:
            problem = ready.recv() if ready.poll(_START_S) else "it takes too long"
        except EOFError:
            problem = "it ended"
        if problem:
            raise InputError(f"the camera does not start: {problem}")

    try:
        yield wait
    finally:
        process.terminate()
        process.join()
        ready.close()


def _serve(host: str, port: int, block_name: str, ready: Connection) -> None:
    """Run the camera server until the parent process ends it or dies.

    `ready` gets an empty text once the first frame has been drawn, or what went wrong.
    """
    signals.work_for_parent()
    block = Block(block_name)
    try:
        server = _Server((host, port), block)
        server.frame(CAMERAS[0], "jpg")
    except (OSError, InputError) as error:
        ready.send(f"{error} (on {host}:{port})")
        return
    ready.send("")
    server.serve_forever()
