"""Pictures of the real cell: fresh, of the size that was calibrated, or a fault in time."""

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pliant.errors import InputError, RobotFault
from pliant.pictures import Picture
from pliant.ur5e.camera import open_camera
from pliant.ur5e.configuration import CameraSettings
from pliant.ur5e.protocol import TIME_HEADER

WIDTH, HEIGHT = 160, 120
PATIENCE_S = 1.0


def settings(**fields: Any) -> CameraSettings:
    place = {"focal_px": 500, "position_mm": (1200, 0, 0), "rotation_deg": (-90, 0, 90)}
    return CameraSettings(
        **{"width": WIDTH, "height": HEIGHT, "latency_ms": 0.0, **place, **fields}
    )


def painted(red: int, width: int = WIDTH) -> Picture:
    """A picture (height, width, 3), RGB, that can be told from others."""
    picture = np.zeros((HEIGHT, width, 3), np.uint8)
    picture[:, :, 0] = red
    picture[10:20, 30:60, 2] = 255
    return picture


# --- HTTP ----------------------------------------------------------------------------------------


class Server(ThreadingHTTPServer):
    """Sends one picture; tests change it, and its time stamp, between requests."""

    daemon_threads = True
    picture: Picture | bytes = painted(200)
    stamp: str | None = "7.5"
    silent_s = 0.0
    asked = 0


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        server = self.server
        server.asked += 1
        time.sleep(server.silent_s)
        picture = server.picture
        if not isinstance(picture, bytes):
            bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
            picture = cv2.imencode(".png", bgr)[1].tobytes()
        self.send_response(200)
        if server.stamp is not None:
            self.send_header(TIME_HEADER, server.stamp)
        self.end_headers()
        self.wfile.write(picture)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Not to the terminal."""


@pytest.fixture
def server() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def http(server: Server, patience_s: float = PATIENCE_S) -> Any:
    where = f"http://127.0.0.1:{server.server_address[1]}/side.png"
    return open_camera(settings(source="http", where=where), patience_s)


def test_a_picture_over_http_comes_with_its_time_and_calibration(server: Server) -> None:
    view = http(server).view(stamp_s=7.5, origin_s=2.0)
    np.testing.assert_array_equal(view.image, painted(200))
    assert view.time_s == pytest.approx(5.5)
    assert view.camera.focal_px == 500


def test_an_older_picture_is_asked_for_again_until_it_is_new(server: Server) -> None:
    server.stamp = "7.4"
    threading.Timer(0.2, lambda: setattr(server, "stamp", "7.6")).start()
    assert http(server, 10.0).view(stamp_s=7.5, origin_s=0.0).time_s == pytest.approx(7.6)
    assert server.asked > 1


def test_a_frozen_picture_is_a_camera_fault(server: Server) -> None:
    with pytest.raises(RobotFault, match=r"0\.50 s old: it is frozen") as caught:
        http(server, 0.2).view(stamp_s=8.0, origin_s=0.0)
    assert caught.value.kind == "camera"


def test_a_silent_server_is_a_camera_fault(server: Server) -> None:
    server.silent_s = 1.0
    with pytest.raises(RobotFault, match="timed out"):
        http(server, 0.2).view(stamp_s=7.5, origin_s=0.0)


def test_what_is_no_picture_or_of_another_size_is_a_camera_fault(server: Server) -> None:
    server.picture = b"not a picture"
    with pytest.raises(RobotFault, match="does not send pictures"):
        http(server).view(stamp_s=7.5, origin_s=0.0)
    server.picture = painted(1, width=80)
    with pytest.raises(RobotFault, match="80 x 120 pixels, not the 160 x 120"):
        http(server).view(stamp_s=7.5, origin_s=0.0)


def test_without_a_time_stamp_a_picture_is_of_when_it_was_asked_for(server: Server) -> None:
    server.stamp = None
    assert http(server).view(stamp_s=9.0, origin_s=1.0).time_s == pytest.approx(8.0)


def test_an_address_that_is_none_is_the_users_error() -> None:
    with pytest.raises(InputError, match=r"camera\.where is 'side'"):
        open_camera(settings(source="http", where="side"), PATIENCE_S)


# --- sources that send by themselves -------------------------------------------------------------


class Filming(ThreadingHTTPServer):
    """Sends frames without end, until the test ends them."""

    daemon_threads = True
    has_ended = False


class Film(BaseHTTPRequestHandler):
    server: Filming

    def do_GET(self) -> None:
        frame = cv2.imencode(".jpg", cv2.cvtColor(painted(200), cv2.COLOR_RGB2BGR))[1].tobytes()
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        while not self.server.has_ended:
            self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\n")
            self.wfile.write(b"Content-Length: %d\r\n\r\n%s\r\n" % (len(frame), frame))
            time.sleep(0.01)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Not to the terminal."""


@pytest.fixture
def film() -> Iterator[Filming]:
    with Filming(("127.0.0.1", 0), Film) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.has_ended = True
        server.shutdown()
        thread.join()


def to_the_end(camera: Any) -> None:
    while True:
        camera.view(stamp_s=3.0, origin_s=1.0)


def test_what_opencv_opens_is_a_camera_and_its_end_is_a_fault(film: Filming) -> None:
    where = f"http://127.0.0.1:{film.server_address[1]}/film.mjpeg"
    camera = open_camera(settings(source="opencv", where=where), 10.0)
    try:
        view = camera.view(stamp_s=3.0, origin_s=1.0)
        assert view.image.shape == (HEIGHT, WIDTH, 3)
        assert view.image[15, 40, 2] > 200
        assert view.time_s == 2.0
        assert camera.is_usable
        film.has_ended = True
        with pytest.raises(RobotFault, match="has stopped sending"):
            to_the_end(camera)
        assert not camera.is_usable
    finally:
        camera.close()


def test_a_device_that_is_not_there_is_a_camera_fault() -> None:
    with pytest.raises(RobotFault, match="cannot open the camera '/nowhere'") as caught:
        open_camera(settings(source="opencv", where="/nowhere"), PATIENCE_S)
    assert caught.value.kind == "camera"


def recorded(path: Path, frames: int) -> None:
    """A RealSense recording, as the vendor's library writes it."""
    import pyrealsense2 as rs

    device = rs.software_device()
    source = device.add_sensor("Color")
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fps, stream.bpp = rs.stream.color, 0, 1, 30, 3
    stream.width, stream.height, stream.fmt = WIDTH, HEIGHT, rs.format.rgb8
    profile = source.add_video_stream(stream).as_video_stream_profile()
    recorder = rs.recorder(str(path), device)
    sink = recorder.query_sensors()[0]
    sink.open(sink.get_stream_profiles()[0])
    sink.start(rs.frame_queue(frames))
    for k in range(frames):
        frame = rs.software_video_frame()
        frame.stride, frame.bpp = WIDTH * 3, 3
        frame.pixels = painted(4 * k).ravel()
        frame.timestamp, frame.frame_number = k * 33.3, k
        frame.domain, frame.profile = rs.timestamp_domain.system_time, profile
        source.on_video_frame(frame)
        time.sleep(0.005)
    sink.stop()
    sink.close()
    del recorder, sink  # which closes the file


@pytest.mark.system
@pytest.mark.skipif(find_spec("pyrealsense2") is None, reason="needs the extra 'ur5e'")
def test_a_recorded_realsense_plays_as_a_live_one(tmp_path: Path) -> None:
    path = tmp_path / "side.db3"
    recorded(path, 60)
    camera = open_camera(settings(source="file", where=str(path)), 5.0)
    try:
        reds = set()
        for _ in range(5):
            image = camera.view(stamp_s=1.0, origin_s=0.0).image
            np.testing.assert_array_equal(image, painted(int(image[0, 0, 0])))
            reds.add(int(image[0, 0, 0]))
        assert len(reds) > 1
    finally:
        camera.close()


@pytest.mark.system
@pytest.mark.skipif(find_spec("pyrealsense2") is None, reason="needs the extra 'ur5e'")
def test_without_a_realsense_the_fault_says_so(tmp_path: Path) -> None:
    with pytest.raises(RobotFault, match="does not start: none is connected") as caught:
        open_camera(settings(source="realsense"), PATIENCE_S)
    assert caught.value.kind == "camera"
    with pytest.raises(InputError, match="there is no recording"):
        open_camera(settings(source="file", where=str(tmp_path / "none.db3")), PATIENCE_S)
