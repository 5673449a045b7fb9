"""The side camera: a RealSense (live or recorded), any OpenCV source, or pictures over HTTP.

Each gives a picture that was taken after a moment the caller names, never one that lay in a buffer.
A source that has none in time is a fault of the kind "camera".
"""

import contextlib
import http.client
import threading
import time
import urllib.error
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from pliant import pictures
from pliant.cell import View
from pliant.errors import InputError, RobotFault, installing
from pliant.network import open_directly
from pliant.pictures import Picture
from pliant.ur5e import configuration as c
from pliant.ur5e.protocol import TIME_HEADER

_RETRY_S = 0.02
_STAMP_S = 1e-5  # [s] of rounding in that header
_ENDING_S = 2.0


class CameraDevice(Protocol):
    """A source of pictures. Once it is not usable any more it has to be opened anew."""

    @property
    def is_usable(self) -> bool: ...

    def view(self, stamp_s: float, origin_s: float) -> View:
        """A picture taken after now, when the controller's time stamp is `stamp_s`. The view's time
        counts from `origin_s`.

        Raises:
            RobotFault: "camera": there is none in time, or it is not what was configured.
        """
        ...

    def close(self) -> None: ...


def open_camera(settings: c.CameraSettings, patience_s: float) -> CameraDevice:
    """Open the configured camera and see that it delivers.

    Raises:
        InputError: the RealSense library is missing, or the file is.
        RobotFault: "camera": it cannot be opened, or sends nothing.
    """
    match settings.source:
        case c.CameraSource.HTTP:
            return Http(settings, patience_s)
        case c.CameraSource.OPENCV:
            return Stream(settings, patience_s, partial(_OpenCv, settings, patience_s))
        case c.CameraSource.REALSENSE | c.CameraSource.FILE:
            return Stream(settings, patience_s, _realsense(settings, patience_s))


def _view(settings: c.CameraSettings, picture: Picture, time_s: float) -> View:
    height, width = picture.shape[:2]
    if (width, height) != (settings.width, settings.height):
        raise RobotFault(
            "camera",
            f"the camera sends {width} x {height} pixels, not the {settings.width} x"
            f" {settings.height} that it was calibrated for",
        )
    return View(camera=settings.calibration, time_s=time_s, image=picture)


# --- single pictures over HTTP -------------------------------------------------------------------


class Http:
    """A camera over HTTP, with a picture per request. A server that stamps its pictures is held to
    it; of another one a picture counts as taken when it was asked for."""

    is_usable = True  # nothing stays open

    def __init__(self, settings: c.CameraSettings, patience_s: float) -> None:
        self._settings, self._patience_s = settings, patience_s
        if not settings.where.startswith(("http://", "https://")):
            raise InputError(f"camera.where is '{settings.where}': source http needs a URL")

    def view(self, stamp_s: float, origin_s: float) -> View:
        give_up = time.monotonic() + self._patience_s
        while True:
            data, taken_s = self._fetch(give_up)
            if taken_s is None or taken_s >= stamp_s - _STAMP_S:
                break
            if time.monotonic() + _RETRY_S > give_up:
                raise RobotFault(
                    "camera", f"the camera's picture is {stamp_s - taken_s:.2f} s old: it is frozen"
                )
            time.sleep(_RETRY_S)
        try:
            picture = pictures.decoded(data)
        except ValueError as error:
            raise RobotFault(
                "camera", f"{self._settings.where} does not send pictures: what came {error}"
            ) from error
        time_s = (stamp_s if taken_s is None else taken_s) - origin_s
        return _view(self._settings, picture, time_s)

    def close(self) -> None:
        """Do nothing: nothing stays open."""

    def _fetch(self, give_up: float) -> tuple[bytes, float | None]:
        left_s = max(0.05, give_up - time.monotonic())
        try:
            with open_directly(self._settings.where, left_s) as answer:
                stamp = answer.headers.get(TIME_HEADER)
                data = answer.read(pictures.MOST_BYTES)
                return data, None if stamp is None else float(stamp)
        except (OSError, ValueError, http.client.HTTPException) as error:
            if isinstance(error, urllib.error.HTTPError):
                error.close()
            raise RobotFault(
                "camera", f"no picture from {self._settings.where}: {error}"
            ) from error


# --- sources that send by themselves -------------------------------------------------------------


class Stream:
    """Reads a source all the time, so that nothing old waits in a buffer, and hands out frames that
    arrived later than the moment asked for by the camera's latency."""

    def __init__(
        self,
        settings: c.CameraSettings,
        patience_s: float,
        opener: "Callable[[], _OpenCv | _RealSense]",
    ) -> None:
        self._settings, self._patience_s = settings, patience_s
        self._fresh = threading.Condition()
        self._latest: tuple[float, Picture] | None = None  # (arrived, frame)
        self._problem: Exception | None = None
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, args=(opener,), daemon=True)
        self._thread.start()
        self._after(0.0, max(patience_s, 10.0))

    @property
    def is_usable(self) -> bool:
        return self._problem is None

    def view(self, stamp_s: float, origin_s: float) -> View:
        taken = time.monotonic() + self._settings.latency_ms * 1e-3
        return _view(self._settings, self._after(taken, self._patience_s), stamp_s - origin_s)

    def close(self) -> None:
        self._is_closing = True
        self._thread.join(_ENDING_S)

    def _after(self, moment: float, patience_s: float) -> Picture:
        with self._fresh:
            self._fresh.wait_for(
                lambda: self._problem or (self._latest and self._latest[0] >= moment), patience_s
            )
            if self._latest is not None and self._latest[0] >= moment:
                return self._latest[1]
            if self._problem is not None:
                raise self._problem
            raise RobotFault("camera", f"the camera sent no new picture in {patience_s:.1f} s")

    def _run(self, opener: "Callable[[], _OpenCv | _RealSense]") -> None:
        try:
            source = opener()
        except (RobotFault, InputError) as error:
            self._tell(error)
            return
        try:
            while not self._is_closing:
                frame = source.read()
                with self._fresh:
                    self._latest = (time.monotonic(), frame)
                    self._fresh.notify_all()
        except RobotFault as fault:
            self._tell(fault)
        finally:
            source.close()

    def _tell(self, problem: Exception) -> None:
        with self._fresh:
            self._problem = problem
            self._fresh.notify_all()


class _OpenCv:
    """A device by number, or whatever else `cv2.VideoCapture` opens."""

    def __init__(self, settings: c.CameraSettings, patience_s: float) -> None:
        where, wait_ms = settings.where, int(patience_s * 1e3)
        self._where = where
        if where.isdigit():
            self._capture = cv2.VideoCapture(int(where))
        else:  # a stream that goes silent would otherwise hold the thread for half a minute
            waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, wait_ms]
            waits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, wait_ms]
            self._capture = cv2.VideoCapture(where, cv2.CAP_FFMPEG, waits)
        if not self._capture.isOpened():
            raise RobotFault("camera", f"OpenCV cannot open the camera '{where}'")
        if where.isdigit():
            self._configure(settings)

    def _configure(self, settings: c.CameraSettings) -> None:
        wanted: dict[int, float] = {
            cv2.CAP_PROP_FRAME_WIDTH: settings.width,
            cv2.CAP_PROP_FRAME_HEIGHT: settings.height,
            cv2.CAP_PROP_FPS: settings.fps,
            cv2.CAP_PROP_BUFFERSIZE: 1,
        }
        if settings.exposure_us is not None:
            wanted[cv2.CAP_PROP_AUTO_EXPOSURE] = 1  # V4L2: manual
            wanted[cv2.CAP_PROP_EXPOSURE] = settings.exposure_us / 100  # V4L2 counts 0.1 ms
        if settings.white_balance_k is not None:
            wanted[cv2.CAP_PROP_AUTO_WB] = 0
            wanted[cv2.CAP_PROP_WB_TEMPERATURE] = settings.white_balance_k
        for key, value in wanted.items():
            self._capture.set(key, value)

    def read(self) -> Picture:
        is_read, bgr = self._capture.read()
        if not is_read:
            raise RobotFault("camera", f"the camera '{self._where}' has stopped sending")
        return _rgb(bgr)

    def close(self) -> None:
        self._capture.release()


def _realsense(settings: c.CameraSettings, patience_s: float) -> "Callable[[], _RealSense]":
    """A function that opens the RealSense. Raises InputError here, in the caller's thread, for what
    the user can mend."""
    try:
        import pyrealsense2 as rs
    except ImportError as error:
        raise InputError(
            f"a RealSense camera needs the extra 'ur5e' ({error}): {installing('ur5e')}, and on"
            " Debian the package libusb-1.0-0"
        ) from error
    if settings.source is c.CameraSource.FILE and not Path(settings.where).is_file():
        raise InputError(f"camera.where: there is no recording '{settings.where}'")
    return lambda: _RealSense(rs, settings, patience_s)


class _RealSense:
    """The vendor's pipeline; it plays a recorded file (.db3) just as it plays a camera."""

    def __init__(self, rs: Any, settings: c.CameraSettings, patience_s: float) -> None:
        self._rs, self._wait_ms = rs, int(patience_s * 1e3)
        config = rs.config()
        if settings.source is c.CameraSource.FILE:
            # The formats are the file's: enabling a stream as well makes it refuse to play.
            config.enable_device_from_file(settings.where, repeat_playback=True)
        else:
            self._find(settings.where)
            if settings.where:
                config.enable_device(settings.where)
            config.enable_stream(
                rs.stream.color, settings.width, settings.height, rs.format.rgb8, settings.fps
            )
        self._pipeline = rs.pipeline()
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise RobotFault("camera", f"the RealSense camera does not start: {error}") from error
        if settings.source is c.CameraSource.REALSENSE:
            try:
                self._fix(profile.get_device().first_color_sensor(), settings)
            except RuntimeError as error:
                self.close()
                raise RobotFault(
                    "camera",
                    f"the RealSense camera does not take its exposure or white balance ({error}):"
                    " leave them out of the file, and see that its colours stay as they are",
                ) from error

    def _find(self, serial: str) -> None:
        """Find the camera before the pipeline starts, which waits for one for longer than anyone
        waits for it."""
        info = self._rs.camera_info.serial_number
        there = [device.get_info(info) for device in self._rs.context().query_devices()]
        if not there or (serial and serial not in there):
            wanted = f"with the serial number '{serial}' " if serial else ""
            raise RobotFault(
                "camera",
                f"the RealSense camera does not start: none {wanted}is connected"
                f" (connected: {', '.join(there) or 'none'})",
            )

    def _fix(self, sensor: Any, settings: c.CameraSettings) -> None:
        option = self._rs.option
        if settings.exposure_us is not None:
            sensor.set_option(option.enable_auto_exposure, 0)
            sensor.set_option(option.exposure, settings.exposure_us / 100)  # counts 0.1 ms
        if settings.white_balance_k is not None:
            sensor.set_option(option.enable_auto_white_balance, 0)
            sensor.set_option(option.white_balance, settings.white_balance_k)

    def read(self) -> Picture:
        try:
            frame = self._pipeline.wait_for_frames(self._wait_ms).get_color_frame()
        except RuntimeError as error:
            raise RobotFault("camera", f"the RealSense camera sends nothing: {error}") from error
        if not frame:
            raise RobotFault("camera", "the RealSense camera sends no colour frames")
        picture = np.asanyarray(frame.get_data())
        is_bgr = frame.get_profile().format() == self._rs.format.bgr8
        return _rgb(picture) if is_bgr else picture.copy()

    def close(self) -> None:
        with contextlib.suppress(RuntimeError):
            self._pipeline.stop()


def _rgb(bgr: Any) -> Picture:
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
