"""HSV ranges of the peg and the block, from one pixel of each that a person picked.

Around the pixel grows a region of its colour; the ranges hold nearly all of that region, with room
for other light. Later pictures, with the peg elsewhere, widen them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Image
from pliant.errors import InputError
from pliant.vision.measure import Colours, Hsv, largest_contour, mask_of

Ranges = tuple[tuple[Hsv, Hsv], ...]

LEAST_PIXELS = 400  # of a region, as vision asks
LEAST_SATURATION = 60  # a grey has no hue
MOST_ELSEWHERE = 0.1  # of a mask's pixels outside its largest region
MOST_SHARED = 0.01  # of the smaller mask's pixels in both

_HUES = 180
_GROW = (6, 50, 50)  # of hue, saturation, value: how far the region may stray from the pixel
_HUE_MARGIN, _MARGIN = 4, 30
_TAIL = 1.0  # [%] left out at each end
_PATCH = 3  # pixels to each side of the picked one


@dataclass(frozen=True, kw_only=True)
class ColoursFound:
    """The colour ranges found, and how much of the pictures they take that is not the largest
    region."""

    colours: Colours
    peg_elsewhere: float  # share of the mask's pixels, the worst picture's
    block_elsewhere: float
    shared: float

    def problem(self) -> str | None:
        """Why the ranges are too poor to be used, and what to do; None: they are good."""
        for name, elsewhere in (("peg", self.peg_elsewhere), ("block", self.block_elsewhere)):
            if elsewhere > MOST_ELSEWHERE:
                return (
                    f"{elsewhere:.0%} of what has the {name}'s colour is elsewhere in the picture,"
                    f" more than {MOST_ELSEWHERE:.0%}: cover what has that colour, pick again, or"
                    " paint the part"
                )
        if self.shared > MOST_SHARED:
            return "peg and block have the same colour in the picture: pick again, or paint one"
        return None


def pick(image: Image, u: int, v: int, what: str) -> Ranges:
    """The ranges of the region around pixel (column `u`, row `v`).

    Raises:
        InputError: the pixel is not in the picture, is grey, or its region is small.
    """
    height, width = image.shape[:2]
    if not (0 <= u < width and 0 <= v < height):
        raise InputError(
            f"the {what}'s pixel {u},{v} is not in the picture, which has {width} columns and"
            f" {height} rows"
        )
    hsv = _hsv(image)
    patch = hsv[max(0, v - _PATCH) : v + _PATCH + 1, max(0, u - _PATCH) : u + _PATCH + 1]
    hue, saturation, value = _middle(patch.reshape(-1, 3))
    if saturation < LEAST_SATURATION:
        raise InputError(
            f"the {what}'s pixel {u},{v} is nearly grey (saturation {saturation:.0f} of 255, at"
            f" least {LEAST_SATURATION}): pick the part itself; where it is not coloured, paint it"
        )
    region = _near(hsv, (hue, saturation, value))
    _, labels = cv2.connectedComponents(region, connectivity=4)
    label = labels[v, u]
    inside = hsv[labels == label] if label else hsv[:0]
    if len(inside) < LEAST_PIXELS:
        raise InputError(
            f"around the {what}'s pixel {u},{v} only {len(inside)} pixels have its colour, at least"
            f" {LEAST_PIXELS} are needed: pick its middle"
        )
    return _ranges(inside)


def widen(images: Sequence[Image], ranges: Ranges) -> Ranges:
    """Widen the ranges to hold the largest region of each picture, too."""
    pixels = []
    for image in images:
        hsv = _hsv(image)
        contour = largest_contour(hsv, ranges)
        if contour is None:
            continue
        region = _filled(hsv, contour) & mask_of(hsv, ranges)
        pixels.append(hsv[region > 0])
    return _ranges(np.vstack(pixels)) if pixels else ranges


def evaluate(images: Sequence[Image], colours: Colours) -> ColoursFound:
    """Measure how well the ranges tell peg and block from everything else.

    Raises:
        InputError: a picture lacks one of them.
    """
    elsewhere: dict[str, float] = {"peg": 0.0, "block": 0.0}
    shared = 0.0
    for image in images:
        hsv = _hsv(image)
        masks = {"peg": mask_of(hsv, colours.peg), "block": mask_of(hsv, colours.block)}
        for name, ranges in (("peg", colours.peg), ("block", colours.block)):
            contour = largest_contour(hsv, ranges)
            if contour is None:
                raise InputError(
                    f"a picture shows no {name} of the picked colour: pick again, in a picture with"
                    " the light of the work"
                )
            count = int(np.count_nonzero(masks[name]))
            out = int(np.count_nonzero(masks[name] & ~_filled(hsv, contour)))
            elsewhere[name] = max(elsewhere[name], out / count)
        both = int(np.count_nonzero(masks["peg"] & masks["block"]))
        shared = max(shared, both / min(int(np.count_nonzero(m)) for m in masks.values()))
    return ColoursFound(
        colours=colours,
        peg_elsewhere=elsewhere["peg"],
        block_elsewhere=elsewhere["block"],
        shared=shared,
    )


def shown(image: Image, colours: Colours) -> Image:
    """The picture, grey but for the two masks, their largest regions outlined."""
    hsv = _hsv(image)
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    taken = (mask_of(hsv, colours.peg) | mask_of(hsv, colours.block)) > 0
    result = np.where(taken[..., None], image, grey // 2 + 96).astype(np.uint8)
    for ranges, colour in ((colours.peg, (17, 119, 51)), (colours.block, (136, 34, 85))):
        contour = largest_contour(hsv, ranges)
        if contour is not None:
            cv2.polylines(result, [np.floor(contour).astype(np.int32)], True, colour, 2)
    return result


# --- inside ---------------------------------------------------------------------------------------


def _hsv(image: Image) -> NDArray[np.uint8]:
    return cv2.cvtColor(image, cv2.COLOR_RGB2HSV).astype(np.uint8, copy=False)


def _filled(hsv: NDArray[np.uint8], contour: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The mask of the inside of a contour in a picture."""
    mask = np.zeros(hsv.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.floor(contour).astype(np.int32)], 255)
    return mask


def _middle(pixels: NDArray[np.uint8]) -> tuple[float, float, float]:
    """Median hue (around the circle), saturation and value of (n, 3) pixels."""
    saturation, value = (float(np.median(pixels[:, i])) for i in (1, 2))
    origin = _mean_hue(pixels)
    return (origin + float(np.median(_around(pixels, origin)))) % _HUES, saturation, value


def _mean_hue(pixels: NDArray[np.uint8]) -> float:
    angle = pixels[:, 0] * (2 * np.pi / _HUES)
    return float(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())) * _HUES / (2 * np.pi)


def _around(pixels: NDArray[np.uint8], origin: float) -> NDArray[np.float64]:
    """Hues relative to `origin`, -90 to 90."""
    hue = pixels[:, 0].astype(np.float64)
    return (hue - origin + _HUES / 2) % _HUES - _HUES / 2


def _near(hsv: NDArray[np.uint8], middle: tuple[float, float, float]) -> NDArray[np.uint8]:
    hue, saturation, value = middle
    pixels = hsv.reshape(-1, 3)
    near = np.abs(_around(pixels, hue)) <= _GROW[0]
    near &= np.abs(pixels[:, 1] - saturation) <= _GROW[1]
    near &= np.abs(pixels[:, 2] - value) <= _GROW[2]
    return near.reshape(hsv.shape[:2]).astype(np.uint8)


def _ranges(pixels: NDArray[np.uint8]) -> Ranges:
    """One range, or two where the hues lie around red."""
    origin = _mean_hue(pixels)
    hues = origin + np.percentile(_around(pixels, origin), (_TAIL, 100 - _TAIL))
    low, high = int(np.floor(hues[0])) - _HUE_MARGIN, int(np.ceil(hues[1])) + _HUE_MARGIN
    least = [int(np.percentile(pixels[:, i], _TAIL)) - _MARGIN for i in (1, 2)]
    most = [int(np.percentile(pixels[:, i], 100 - _TAIL)) + _MARGIN for i in (1, 2)]
    (s0, v0), (s1, v1) = (max(30, x) for x in least), (min(255, x) for x in most)
    last = _HUES - 1
    if high - low >= last:
        return (((0, s0, v0), (last, s1, v1)),)
    low, high = low % _HUES, high % _HUES
    if low <= high:
        return (((low, s0, v0), (high, s1, v1)),)
    return ((0, s0, v0), (high, s1, v1)), ((low, s0, v0), (last, s1, v1))
