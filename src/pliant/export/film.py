"""Pictures of a replayed trial, as H.264: drawn, encoded, and joined without encoding again."""

import io
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.video.reformatter import Colorspace
from numpy.typing import NDArray

from pliant.sim import constants as c
from pliant.sim.replay import Replay

Picture = NDArray[np.uint8]  # (height, width, 3) RGB
KEYFRAME_EVERY, QUALITY, PIXELS = 2, 23, "yuv420p"  # short groups: any frame is quickly reached
_UNMOVED = 3e-4  # [rad, m] no joint further than this from its last picture: drawn already


def drawn(replay: Replay, camera: str) -> Iterator[Picture]:
    """A camera's picture of every sample, drawn again only where something has moved."""
    qpos = replay.trajectory.qpos
    at, picture = 0, replay.image(camera, 0)
    for sample in range(len(qpos)):
        if np.abs(qpos[sample] - qpos[at]).max() > _UNMOVED:
            at, picture = sample, replay.image(camera, sample)
        yield picture


def encoded(pictures: Iterable[Picture], fps: int) -> bytes:
    """An MP4 of the pictures."""
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.width, stream.height = c.IMAGE_SIZE
        stream.pix_fmt = PIXELS
        stream.codec_context.colorspace = Colorspace.ITU601  # as the pictures are converted
        stream.codec_context.thread_count = 1  # a film a core: more threads wait for each other
        stream.options = {
            "preset": "veryfast",
            "crf": str(QUALITY),
            "g": str(KEYFRAME_EVERY),
            "bf": "0",  # no frame waits for a later one
        }
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return file.getvalue()


class Reel:
    """A growing MP4 of joined films of the same size and rate, one after the other."""

    def __init__(self, path: Path, fps: int) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.frames = 0
        self.bytes = 0
        self._fps = fps
        self._container = av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
        self._stream: Any = None

    def add(self, film: bytes) -> int:
        """Append a film; return at which frame it begins."""
        begins = self.frames
        with av.open(io.BytesIO(film), "r") as source:
            stream = source.streams.video[0]
            if self._stream is None:
                self._stream = self._container.add_stream_from_template(stream)
            assert stream.time_base is not None, "an MP4 has a time base"
            offset = int(Fraction(begins, self._fps) / stream.time_base)
            for packet in source.demux(stream):
                if packet.pts is None or packet.dts is None:
                    continue  # the end of the stream
                packet.pts += offset
                packet.dts += offset
                packet.stream = self._stream
                self._container.mux(packet)
                self.frames += 1
        self.bytes += len(film)
        return begins

    def close(self) -> None:
        self._container.close()
