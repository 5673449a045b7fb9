"""Drawing on pictures (RGB arrays) with OpenCV: anti-aliased, dark-rimmed, to a sub-pixel."""

from collections.abc import Sequence

import cv2
import numpy as np

from pliant.pictures import Picture

Colour = tuple[int, int, int]
Point = tuple[float, float]  # column, row [px]

SUCCESS: Colour = (0x11, 0x77, 0x33)
FAILURE: Colour = (0x88, 0x22, 0x55)
NEUTRAL: Colour = (0x55, 0x58, 0x5E)
WHITE: Colour = (255, 255, 255)
DARK: Colour = (20, 20, 24)

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_BITS = 4  # of sub-pixel accuracy
_RIM = 2  # [px] of dark around a line


def verdict_colour(success: bool) -> Colour:
    return SUCCESS if success else FAILURE


def lines(
    picture: Picture,
    points: Sequence[Point],
    colour: Colour,
    *,
    width: int = 2,
    closed: bool = True,
    rim: bool = True,
) -> None:
    """Draw a line through points, on a dark rim unless it is drawn without."""
    shifted = np.array([[_fixed(u), _fixed(v)] for u, v in points], np.int32)
    for c, w in [(DARK, width + _RIM)] * rim + [(colour, width)]:
        cv2.polylines(picture, [shifted], closed, c, w, cv2.LINE_AA, _BITS)


def dot(picture: Picture, at: Point, colour: Colour, *, radius: float = 7.0) -> None:
    centre = (_fixed(at[0]), _fixed(at[1]))
    for c, r in ((DARK, radius + _RIM), (colour, radius)):
        cv2.circle(picture, centre, _fixed(r), c, cv2.FILLED, cv2.LINE_AA, _BITS)


def cross(picture: Picture, at: Point, colour: Colour, *, size: float = 11.0) -> None:
    u, v = at
    for du, dv in ((size, size), (size, -size)):
        lines(picture, [(u - du, v - dv), (u + du, v + dv)], colour, width=3, closed=False)


def tick(
    picture: Picture, at: Point, success: bool, *, size: float, colour: Colour = WHITE
) -> None:
    """Draw a tick or a cross in a square of `size` with its centre at `at`."""
    u, v, h = at[0], at[1], size / 2
    strokes = (
        [[(u - h, v), (u - h / 4, v + 0.8 * h), (u + h, v - 0.8 * h)]]
        if success
        else [[(u - h, v - h), (u + h, v + h)], [(u - h, v + h), (u + h, v - h)]]
    )
    for stroke in strokes:
        lines(picture, stroke, colour, width=3, closed=False, rim=False)


def text(
    picture: Picture,
    words: str,
    at: Point,
    *,
    scale: float = 0.8,
    colour: Colour = WHITE,
    align: str = "left",
    rim: bool = False,
    weight: int = 1,
) -> None:
    """Write text with its baseline's left, centre or right end at `at`. OpenCV draws ASCII only."""
    plain = ascii_only(words)
    width = text_width(plain, scale, weight)
    left = at[0] - {"left": 0.0, "center": width / 2, "right": width}[align]
    u, v = round(left), round(at[1])
    around = [(a, b) for a in (-2, 0, 2) for b in (-2, 0, 2)] if rim else []
    for du, dv in around:
        cv2.putText(picture, plain, (u + du, v + dv), _FONT, scale, DARK, weight, cv2.LINE_AA)
    cv2.putText(picture, plain, (u, v), _FONT, scale, colour, weight, cv2.LINE_AA)


def text_width(words: str, scale: float, weight: int = 1) -> int:
    return cv2.getTextSize(ascii_only(words), _FONT, scale, weight)[0][0]


def shortened(words: str, width: float, scale: float) -> str:
    """The beginning of `words` that fits in `width` [px]."""
    plain = " ".join(ascii_only(words).split())
    if text_width(plain, scale) <= width:
        return plain
    while plain and text_width(f"{plain}...", scale) > width:
        plain = plain[:-1]
    return f"{plain.rstrip()}..."


def ascii_only(words: str) -> str:
    plain = words.replace("\N{MINUS SIGN}", "-").replace("\N{DEGREE SIGN}", " deg")
    return plain.encode("ascii", "replace").decode()


def _fixed(value: float) -> int:
    return round(value * (1 << _BITS))
