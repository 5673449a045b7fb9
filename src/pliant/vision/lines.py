"""Edges of things of known size in a picture of any colours.

What counts is a step in any channel that keeps its sign along a piece of an edge, so that textures
and noise cancel; a pair of parallel edges is as good as the weaker.
"""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera

Floats = NDArray[np.float32]
Points = NDArray[np.float64]  # (n, 2) pixels, column and row
Steps = NDArray[np.float64]
"""Points on edges (n, 4): on which of two lines (0, 1), column, row, weight."""

STRETCH = 0.015  # of a width, where things or the camera are nearer or farther
_CLIP, _CLEAR = 30.0, 6.0  # [grey levels a pixel] steps count up to, and half at
_SAME_LINE = 0.9  # [px] from a line
_SLOPES = 41  # that are tried
_SUM = np.ones((1, 3), np.float32)  # of a colour's channels
_LEAST_STEP, _NOT_MUCH_WEAKER = 0.8, 0.4  # [grey levels a pixel]; share of the strongest


def upright(picture: Floats, *, piece: int) -> Floats:
    """The strength of an upright edge around each pixel, over `piece` rows: 0 to 1."""
    return strength(cv2.blur(derivative(picture, 1, 0), (1, piece)))


def level(picture: Floats, *, piece: int) -> Floats:
    """The strength of a level edge around each pixel, over `piece` columns: 0 to 1."""
    return strength(cv2.blur(derivative(picture, 0, 1), (piece, 1)))


def derivative(picture: Floats, across: int, down: int) -> Floats:
    """A derivative in grey levels a pixel, `across` or `down`; steep steps count no more than clear
    ones."""
    steps = np.asarray(cv2.Scharr(picture, cv2.CV_32F, across, down, scale=1 / 32), np.float32)
    return np.clip(steps, -_CLIP, _CLIP, out=steps)


def strength(mean: NDArray[Any]) -> Floats:
    """The strength, 0 to 1, of an edge whose derivative has this mean along a piece (h, w, 3)."""
    step = cv2.sqrt(cv2.transform(cv2.multiply(mean, mean), _SUM))
    return np.asarray(step / (step + np.float32(_CLEAR)), np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class Peaks:
    """Steps that were found in profiles, one by one (n,): in which profile, at which index, to a
    part of a pixel, and how strong [grey levels a pixel]."""

    profile: NDArray[np.intp]
    place: Points
    step: Points


def peaks(profiles: Floats, around: float, reach: float) -> Peaks:
    """The steps in profiles (n, m, channels) near an index: in each all that are not much weaker
    than its strongest. Profile by profile, and along it."""
    rises = np.empty_like(profiles)  # np.gradient takes three times as long on so few values
    rises[:, 1:-1] = (profiles[:, 2:] - profiles[:, :-2]) / 2
    rises[:, 0], rises[:, -1] = profiles[:, 1] - profiles[:, 0], profiles[:, -1] - profiles[:, -2]
    steps = np.sqrt(np.einsum("nij,nij->ni", rises, rises))
    low, high = (
        max(1, math.ceil(around - reach)),
        min(steps.shape[1] - 2, math.floor(around + reach)),
    )
    here, before, after = (steps[:, low + by : high + 1 + by] for by in (0, -1, 1))
    tops = (here >= before) & (here > after) & (here > _LEAST_STEP)
    strongest = np.max(here, axis=1, initial=0.0, where=tops)
    which, along = np.nonzero(tops & (here > _NOT_MUCH_WEAKER * strongest[:, None]))
    left, middle, right = (values[which, along] for values in (before, here, after))
    shift = 0.5 * (left - right) / (left + right - 2 * middle)
    return Peaks(profile=which, place=low + along + shift, step=middle.astype(np.float64))


def averaged(picture: Floats, first: int, pieces: int, piece: int) -> Floats:
    """The profiles (pieces, width, channels) of so many pieces of `piece` rows each from a row
    on."""
    rows = picture[first : first + pieces * piece]
    return np.asarray(rows.reshape(pieces, piece, *picture.shape[1:]).mean(axis=1))


def in_order(lines: list[Steps]) -> Steps:
    """The points of several lines, row by row."""
    points = np.concatenate(lines)
    return points[np.argsort(points[:, 2], kind="stable")]


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two parallel lines x = middle -+ width / 2 + slope * (y - y0) [px], fitted to points."""

    left: float
    right: float
    slope: float
    at: float  # y0
    place_sd: float  # [px] of the middle
    slope_sd: float
    support: float  # sum of weights on the weaker line


def fit_pair(points: Steps, width: float, most_slope: float) -> Pair | None:
    """Lines through edge points: which line (0, 1), x, y, weight. First the most points that two
    lines just so far apart share, then the best fit to these. None: too few agree, or they are not
    that far apart."""
    if len(points) < 4:
        return None
    side, x, y, counts = points.T
    y0 = (float(np.min(y)) + float(np.max(y))) / 2
    slopes = np.linspace(-most_slope, most_slope, _SLOPES)
    middles = (x + np.where(side == 0, 0.5, -0.5) * width) - slopes[:, None] * (y - y0)
    grid = np.arange(np.min(middles), np.max(middles) + 0.5, 0.5)
    near = np.abs(middles[:, None, :] - grid[:, None]) < _SAME_LINE + STRETCH * width / 2
    lines, counted = (side == 0, side == 1), near.astype(np.float64)
    votes = np.minimum(*(counted @ (counts * on) for on in lines))
    steepness, place = np.unravel_index(int(np.argmax(votes)), votes.shape)
    used = np.where(near[steepness, place], counts, 0.0)
    matrix = np.column_stack([*lines, y - y0]).astype(float)
    off = np.zeros(len(x))
    solution = np.zeros(3)
    for _ in range(5):
        if not all(_has_length(y[(used > 0) & on]) for on in lines):
            return None
        root = np.sqrt(used)
        solution = np.linalg.lstsq(matrix * root[:, None], x * root, rcond=None)[0]
        off = np.abs(x - matrix @ solution)
        used = np.where(off < _SAME_LINE, counts / np.maximum(1.0, off / (_SAME_LINE / 3)), 0.0)
    left, right, slope = (float(s) for s in solution)
    if abs(right - left - width) > 1.0 + STRETCH * width:
        return None
    kept = used > 0
    if np.linalg.matrix_rank(matrix[kept]) < matrix.shape[1]:  # the last step left too few
        return None
    noise = max(0.1, float(np.sqrt(np.mean(off[kept] ** 2))))
    covariance = np.linalg.inv(matrix[kept].T @ matrix[kept]) * noise**2
    return Pair(
        left=left,
        right=right,
        slope=slope,
        at=y0,
        place_sd=float(np.sqrt((covariance[0, 0] + covariance[1, 1] + 2 * covariance[0, 1]) / 4)),
        slope_sd=float(np.sqrt(covariance[2, 2])),
        support=float(min(np.sum(counts[kept & on]) for on in lines)),
    )


def _has_length(along: NDArray[np.float64]) -> bool:
    """Whether points at these places (n,) along it make a line."""
    return len(along) > 0 and bool(np.min(along) < np.max(along))


def weight(step: Points) -> Points:
    """The weight with which each step counts, 0 to 1."""
    return step / (step + _CLEAR)


def unrolled(camera: Camera, points: Points, roll: float) -> Points:
    """Pixels as they would be if the camera were not rolled."""
    centre = np.array([camera.width / 2, camera.height / 2])
    return centre + (points - centre) @ turn(-roll).T


def turn(tilt: float) -> Points:
    """The axes (2, 2) of a picture turned by `tilt` [rad], in columns: across and down."""
    cos, sin = math.cos(tilt), math.sin(tilt)
    return np.array([[cos, sin], [-sin, cos]])


def cut(
    picture: NDArray[Any], centre: Points, axes: Points, at: Points, size: tuple[int, int]
) -> NDArray[Any]:
    """A piece of a picture along these axes: `centre` (2,) in the picture comes to `at` (2,)."""
    matrix = np.column_stack([axes, centre - 0.5 - axes @ (at - 0.5)])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(picture, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)


def middle_of(places: Points, least_sd: float) -> tuple[float, float] | None:
    """The (place, sd) [px] of a line across an axis from where its points are found along that, as
    their median; None: they are too few."""
    if len(places) < 3:
        return None
    middle = float(np.median(places))
    spread = 1.5 * float(np.median(np.abs(places - middle)))
    return middle, max(least_sd, 1.25 * spread / math.sqrt(len(places)))


class Strip:
    """A picture turned by a tilt about a point, so that the peg's sides stand upright in it."""

    def __init__(
        self, picture: Floats, centre: Points, tilt: float, size: tuple[int, int], at: Points
    ) -> None:
        """Turn a picture by `tilt`: `centre` (2,) in it comes to `at` (2,), both in pixels."""
        self._turn, self._centre, self._at = turn(tilt), centre, at
        self.picture: Floats = np.asarray(cut(picture, centre, self._turn, at, size), np.float32)

    def rows(self) -> Floats:
        """The picture's row [px] at each of the strip's pixels."""
        height, width = self.picture.shape[:2]
        across, down = np.arange(width), np.arange(height)[:, None]
        off = self._turn[1, 0] * (across + 0.5 - self._at[0])
        return np.asarray(
            self._centre[1] + off + self._turn[1, 1] * (down + 0.5 - self._at[1]), np.float32
        )

    def back(self, point: tuple[float, float]) -> Points:
        """The picture's pixel at a point of the strip."""
        return np.asarray(self._centre + self._turn @ (np.array(point) - self._at))
