"""Pictures of a replayed trial, as H.264: drawn, encoded, and joined without encoding again."""

import io
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import av
import numpy as np
from av.video.reformatter import Colorspace

from pliant.pictures import Picture
from pliant.sim.replay import Replay

KEYFRAME_EVERY, QUALITY, PIXELS = 2, 23, "yuv420p"  # short groups: any frame is quickly reached
UNMOVED = 3e-4  # [rad, m] no joint further than this from its last picture: drawn already
_STREAMED = {"movflags": "+faststart"}  # it plays before it is loaded


class Drawn:
    """A camera's pictures of a replayed trial, drawn again only where something has moved."""

    def __init__(self, replay: Replay, camera: str) -> None:
        self._replay = replay
        self._camera = camera
        self._sample = 0
        self._picture = replay.image(camera, 0)

    def at(self, sample: int, every: int = 1) -> Picture:
        """The picture of a sample, or of the one drawn less than `every` samples before it."""
        qpos = self._replay.trajectory.qpos
        is_due = sample % every == 0 or sample == len(qpos) - 1
        if is_due and np.abs(qpos[sample] - qpos[self._sample]).max() > UNMOVED:
            self._sample, self._picture = sample, self._replay.image(self._camera, sample)
        return self._picture

    def __iter__(self) -> Iterator[Picture]:
        """The picture of every sample."""
        return map(self.at, range(len(self._replay)))


def write(
    file: Path | BinaryIO,
    pictures: Iterable[Picture],
    fps: int,
    options: Mapping[str, str],
    *,
    threads: int | None = None,
) -> None:
    """Write the pictures as an MP4, encoded with x264's `options`."""
    pictures = iter(pictures)
    first = next(pictures)
    where, streamed = (str(file), _STREAMED) if isinstance(file, Path) else (file, {})
    with av.open(where, "w", format="mp4", options=streamed) as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = PIXELS
        stream.codec_context.colorspace = Colorspace.ITU601  # as the pictures are converted
        if threads is not None:
            stream.codec_context.thread_count = threads
        stream.options = dict(options)
        for picture in chain([first], pictures):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def encoded(pictures: Iterable[Picture], fps: int) -> bytes:
    """An MP4 of the pictures, which can be joined to others."""
    file = io.BytesIO()
    options = {
        "preset": "veryfast",
        "crf": str(QUALITY),
        "g": str(KEYFRAME_EVERY),
        "bf": "0",  # no frame waits for a later one
    }
    # A film a core: more threads wait for each other.
    write(file, pictures, fps, options, threads=1)
    return file.getvalue()


class Reel:
    """A growing MP4 of joined films of the same size and rate, one after the other."""

    def __init__(self, path: Path, fps: int) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.frames = 0
        self.bytes = 0
        self._fps = fps
        self._container = av.open(str(path), "w", format="mp4", options=_STREAMED)
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
