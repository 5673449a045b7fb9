"""Writes and reads pictures: those from files and from outside by their size before they are
decoded.

A picture of one colour is small as a file and as large as it says in memory: one that says too much
is refused by its header. PNG, JPEG and WebP are read, and nothing else that OpenCV knows.
"""

import hashlib
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant import folders

Picture = NDArray[np.uint8]  # (height, width, 3) RGB

MOST_PIXELS = 1 << 23  # of a picture: 3840 x 2160 is less
MOST_BYTES = 1 << 26  # of its file
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers with the picture's size
_LOSSLESS = b"VP8L"


def read(path: Path) -> Picture:
    """Read a picture's file, and decode it.

    Raises:
        OSError: it cannot be read, is a link or no file, or is larger than a picture can be.
        ValueError: it is no picture that may be decoded; it says why.
    """
    return decoded(folders.read(path, MOST_BYTES))


def decoded(data: bytes) -> Picture:
    """The picture in a PNG, JPEG or WebP.

    Raises:
        ValueError: it is none, is broken or has more than `MOST_PIXELS`.
    """
    width, height = size_of(data)
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"has {width} x {height} pixels, more than {MOST_PIXELS} or none")
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise ValueError("is broken") from error
    if bgr is None:
        raise ValueError("is broken")
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def encoded(picture: Picture, form: str = "png", options: Sequence[int] = ()) -> bytes:
    """A picture (height, width, 3), RGB, as PNG, or as the `form` jpg or webp, with OpenCV's
    `options`."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(f".{form}", bgr, [*options])
    assert done, "OpenCV encodes any 8-bit picture"
    return data.tobytes()


def name_of(picture: Picture) -> str:
    """The hash of a picture's pixels, by which it is named."""
    shape = "x".join(str(n) for n in picture.shape)
    return hashlib.sha256(shape.encode() + picture.tobytes()).hexdigest()[:16]


def kept(
    file: str, read: Callable[[], bytes], unreadable: tuple[type[Exception], ...] = (OSError,)
) -> Picture:
    """The picture in a file whose name begins with its `name_of`; `read` reads it, and raises one
    of `unreadable` where it cannot.

    Raises:
        ValueError: it is missing, broken or another one; it says why.
    """
    try:
        picture = decoded(read())
    except unreadable as error:
        raise ValueError(f"the picture {file} is missing or broken") from error
    except ValueError as error:
        raise ValueError(f"the picture {file} {error}") from error
    if name_of(picture) != file.partition(".")[0]:
        raise ValueError(f"the picture {file} is not the one that was stored")
    return picture


def shrunk(picture: Picture, width: int) -> Picture:
    """A picture made smaller, to `width` [px]."""
    height = round(picture.shape[0] * width / picture.shape[1])
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return small.astype(np.uint8, copy=False)


def size_of(data: bytes) -> tuple[int, int]:
    """Width and height [px] as a picture's header says.

    Raises:
        ValueError: it is not the beginning of a PNG, a JPEG or a WebP.
    """
    try:
        if data.startswith(_PNG) and data[12:16] == b"IHDR":
            width, height = struct.unpack_from(">II", data, 16)
            return width, height
        if data.startswith(_JPEG):
            return _size_of_jpeg(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _size_of_webp(data)
    except (struct.error, IndexError) as error:
        raise ValueError("is broken") from error
    raise ValueError("is no PNG, JPEG or WebP")


def _size_of_jpeg(data: bytes) -> tuple[int, int]:
    at = 2
    while True:
        while data[at] == 0xFF and data[at + 1] == 0xFF:  # filling
            at += 1
        prefix, marker, length = struct.unpack_from(">BBH", data, at)
        if prefix != 0xFF:
            raise ValueError("is broken")
        if marker in _JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        at += 2 + max(2, length)


def _size_of_webp(data: bytes) -> tuple[int, int]:
    """Width and height [px] of a still WebP, lossless or lossy; the extended form can hold a film,
    and is not read."""
    kind = data[12:16]
    if kind == _LOSSLESS:
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    raise ValueError("is a WebP of the extended form, which is not read")
