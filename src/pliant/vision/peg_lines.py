"""Finds a peg of known size by its edges: two parallel side lines, its top, and its bottom where
the hole does not hide it. Searched for where the arm's pose lets it be, coarse to fine, and then
fitted."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import as_strided

from pliant.cell import Camera
from pliant.pose import Pose
from pliant.task import Peg, Place, Task
from pliant.vision.lines import (
    Floats,
    Points,
    Strip,
    averaged,
    fit_pair,
    in_order,
    level,
    middle_of,
    peaks,
    upright,
    weight,
)
from pliant.vision.offset import Offset, tip_in_line

_BESIDE = 0.020  # [m] of the tip, for a peg that is askew in the grasp
_REACH = 0.010  # [m] of the tip along, for a peg that has slid in the grasp
_ANY, _ANY_REACH = 0.005, 0.017  # [m] along, where the compression is not known
_TILT_REACH, _TILT_STEP = math.radians(21), math.radians(1.5)  # from half of the hand's roll
_MOST_TURN = math.radians(3)  # from the search's tilt to the fit's
_TRIED = 3  # tilts of the coarse search
_APART = 4  # [px] of its pictures of half the size, along: another top
_AS_GOOD = 0.03  # of the score
_FREE, _HELD = 0.47, 0.53  # of a peg's length from its tip, and beside the fingers
_TOP_AT = (-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6)  # of half the width: where the top is looked at
_FINGERS_X = 0.011  # [m] half the fingers' width: a silhouette behind that is theirs as well
_LEAST_SCORE, _LEAST_SUPPORT = 0.25, 1.0  # of at most 1 and at most 2


Candidate = tuple[float, Points, float]  # score, tip (2,) [px], tilt [rad]


@dataclass(frozen=True, kw_only=True)
class PegLines:
    """The peg's left and right line and its top [px], and its tilt [rad]."""

    left: Points  # (2,) a point on each
    right: Points
    top: Points  # (2,) where the axis meets the top edge
    tilt: float
    place_sd: float
    tilt_sd: float
    top_sd: float
    support: float  # of the weaker side and of the top, 0 to 1 each
    edges: tuple[Place, Place]  # which of the peg's the lines are, from its axis

    def tip(self, length: float) -> Points:  # (2,)
        return self.top + length * np.array([math.sin(self.tilt), math.cos(self.tilt)])


def peg_lines(
    picture: Floats,
    camera: Camera,
    task: Task,
    pose: Pose,
    offset: Offset,
    board_top: float,
    pressed: float | None,
) -> PegLines | None:
    """The peg in a picture from +x whose board has its top at that row [px]; None: not found.
    `pressed` is by how much the wrist is shorter than unloaded [m], if that was measured."""
    half_size = np.asarray(
        cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32
    )
    scale = 1.0 / camera.metres_per_pixel(task.peg.silhouette_x)
    length = task.peg.length * scale
    at, reach = (_ANY, _ANY_REACH) if pressed is None else (pressed, _REACH)
    window = [math.ceil((r + offset.reach) * scale / 2) for r in (_BESIDE, reach)]
    found = []
    for tilt in pose.roll / 2 + np.arange(-_TILT_REACH, _TILT_REACH + 1e-9, _TILT_STEP):
        tip = _tip_at(camera, task, pose, offset, float(tilt), at)
        column = float(tip[0]) - length / 2 * math.sin(tilt)
        (_, width), *_ = _edges(camera, task.peg, pose.yaw, column)
        found += _search(
            half_size, tip / 2, float(tilt), width / 2, length / 2, window, board_top / 2
        )
    held = 0.5 if task.peg.silhouette_x > _FINGERS_X else 0.0
    fits = []
    for _, place, tilt in _promising(found):
        edges = _edges(
            camera, task.peg, pose.yaw, 2 * float(place[0]) - length / 2 * math.sin(tilt)
        )
        finer = [
            _search(picture, 2 * place, float(t), edges[0][1], length, [4, 4], board_top)[0]
            for t in tilt + _TILT_STEP / 3 * np.arange(-2, 3)
        ]
        score, place, tilt = max(finer, key=lambda f: f[0])
        if score < _LEAST_SCORE:
            continue
        for pair in edges:
            fit = _fit_peg(picture, place, tilt, pair, length, board_top, held)
            if fit is not None:
                again = _fit_peg(picture, fit.tip(length), fit.tilt, pair, length, board_top, held)
                fits.append(again or fit)
    best = max(fits, key=lambda f: f.support, default=None)
    return None if best is None or best.support < _LEAST_SUPPORT else best


def _promising(found: list[Candidate]) -> list[Candidate]:
    """The best tilts; and a place elsewhere along the peg that is nearly as good, since another
    edge across its axis may be taken for its top."""
    ordered = sorted(found, key=lambda f: -f[0])
    score, (_, along), _ = ordered[0]
    near = [f for f in ordered if abs(f[1][1] - along) <= _APART]
    elsewhere = [f for f in ordered if abs(f[1][1] - along) > _APART and f[0] > score - _AS_GOOD]
    return near[:_TRIED] + elsewhere[:1]


def _edges(
    camera: Camera, peg: Peg, yaw: float, column: float
) -> list[tuple[tuple[Place, Place], float]]:
    """Two edges that may be the clearest of the peg whose axis is at that column, and how far apart
    they look [px]: its outermost, and those of the side that faces the camera."""
    y, _ = camera.on_plane_x(column, camera.height / 2, 0.0)
    slope = (y - camera.position[1]) / camera.position[0]
    outer, face = peg.silhouette(yaw, slopes=(slope, slope)), peg.face(yaw)
    found: list[tuple[tuple[Place, Place], float]] = []
    for edges in (outer, face):
        if edges is None or (found and edges == outer):
            continue
        left, right = (
            camera.project(np.array([x, y + aside, camera.position[2]]))[0] for aside, x in edges
        )
        found.append((edges, right - left))
    return found


def _tip_at(
    camera: Camera, task: Task, pose: Pose, offset: Offset, tilt: float, pressed: float
) -> Points:
    """The place in the picture (2,) [px] where the tip of a peg with that tilt is expected."""
    y, z = tip_in_line(task, pose, tilt, pressed)
    there = pose.x, y - offset.y.value, z - offset.z.value
    return np.array(camera.project(np.array(there)))


def _search(
    picture: Floats,
    tip: Points,
    tilt: float,
    width: float,
    length: float,
    window: list[int],
    board_top: float,
) -> list[Candidate]:
    """The best peg with that tilt, its tip within `window` (across, along) [px] of `tip`; and the
    best that is more than `_APART` from it along."""
    piece = max(4, round(length / 13))
    half, long = width / 2, round(length)
    wide = math.ceil(half) + window[0] + 4
    at = np.array([wide + 0.5, window[1] + long + 4 + 0.5])
    size = (2 * wide + 1, 2 * window[1] + long + 9)
    strip = Strip(picture, tip, tilt, size, at)
    sides = upright(strip.picture, piece=piece)
    sides = cv2.dilate(sides, np.ones((1, 3), np.uint8)).astype(np.float32, copy=False)
    across_axis = level(strip.picture, piece=max(3, round(half)))
    seen = (strip.rows() < board_top - 2).astype(np.float32)

    across = np.arange(-window[0], window[0] + 1)
    along = np.arange(-window[1], window[1] + 1)
    columns, rows = wide + across, window[1] + long + 4 + along  # of the tip

    def shifted(values: Floats, up: int, right: int) -> Floats:
        """The values that lie so far `up` and `right` from each place of the tip."""
        top, left = int(rows[0]) - up, int(columns[0]) + right
        return values[top : top + len(rows), left : left + len(columns)]

    # Along the peg, piece by piece, and from each place of the tip: (pieces, rows, columns).
    at_ups = np.arange(piece / 2, length, piece)
    tops, start = int(rows[0]) - np.round(at_ups).astype(int), int(columns[0])
    windows = [_windows(values, (len(rows), len(columns))) for values in (seen, sides)]
    counts = windows[0][tops, start]
    left, right = (windows[1][tops, start + aside] for aside in (-round(half), round(half)))
    counts = (
        np.where(at_ups < _FREE * length, np.float32(1.0), np.float32(0.5))[:, None, None] * counts
    )
    total = np.maximum(counts.sum(axis=0), 1e-6)
    weaker = np.minimum(*((counts * side).sum(axis=0) for side in (left, right))) / total
    ends, quarter = [], round(0.4 * half)
    for shift in (long, 0):
        ends.append(sum(shifted(across_axis, shift, o) for o in (-quarter, quarter)) / 2)
    bottom_seen = shifted(seen, 0, 0)
    score = (2 * weaker + ends[0] + bottom_seen * ends[1]) / (3 + bottom_seen)
    best: list[Candidate] = []
    for _ in range(2):
        n = int(np.argmax(score))
        row, column = divmod(n, len(columns))
        place = strip.back((columns[column] + 0.5, rows[row] + 0.5))
        best.append((float(score[row, column]), place, tilt))
        score[max(0, row - _APART) : row + _APART + 1] = 0.0
    return best


def _windows(values: Floats, size: tuple[int, int]) -> Floats:
    """Every window of that size in values (n, m), by its first row and column: `as_strided`, since
    NumPy's `sliding_window_view` takes ten times as long on so few."""
    shape = (*(n - k + 1 for n, k in zip(values.shape, size, strict=True)), *size)
    return as_strided(values, shape, values.strides * 2, writeable=False)


def _fit_peg(
    picture: Floats,
    tip: Points,
    tilt: float,
    pair_of: tuple[tuple[Place, Place], float],
    length: float,
    board_top: float,
    held: float,
) -> PegLines | None:
    """Lines through the edge points near a peg that the search has found. `held` is the weight of
    those beside the fingers, unless nothing else is left to see."""
    edges, width = pair_of
    half, margin = width / 2, 8
    wide, high = math.ceil(half) + margin, math.ceil(length) + 2 * margin
    at = np.array([wide + 0.5, length + margin])  # the tip, in the strip
    strip = Strip(picture, tip, tilt, (2 * wide + 1, high), at)
    seen = strip.rows()[:, wide] < board_top - 3
    piece = 6
    if not seen[min(high - 1, round(margin + _HELD * length) + 2 * piece)]:
        held = 0.5  # nothing else of it is left to see
    first = margin + 4
    starts = np.arange(first, round(length + margin) - piece, piece)
    hidden = np.flatnonzero(~seen[starts + piece - 1])
    starts = starts[: hidden[0]] if len(hidden) else starts
    shares = np.where(starts + piece / 2 > margin + _HELD * length, 1.0, held)
    profiles = averaged(strip.picture, first, len(starts), piece)
    lines = []
    for line, column in enumerate((wide - half, wide + half)):
        near = peaks(profiles, column, 4.0)
        at_row, counts = starts[near.profile] + piece / 2, shares[near.profile] * weight(near.step)
        lines.append(
            np.column_stack([np.full(len(at_row), line), near.place + 0.5, at_row, counts])
        )
    pair = fit_pair(in_order(lines), width, _MOST_TURN)
    if pair is None:
        return None
    middle = (pair.left + pair.right) / 2
    columns = np.array([round(middle + share * half) for share in _TOP_AT])
    over = strip.picture[: 3 * margin, columns[:, None] + np.arange(-2, 3)].mean(axis=2)
    near = peaks(over.transpose(1, 0, 2), margin - 0.5, 4.0)
    found = np.zeros(len(columns))
    np.maximum.at(found, near.profile, weight(near.step))
    middle_of_top = middle_of(near.place + 0.5, least_sd=0.1)
    if middle_of_top is None:
        return None
    top, top_sd = middle_of_top
    at_top = middle + pair.slope * (top - pair.at)
    return PegLines(
        left=strip.back((pair.left, pair.at)),
        right=strip.back((pair.right, pair.at)),
        top=strip.back((at_top, top)),
        tilt=tilt + math.atan(pair.slope),
        place_sd=pair.place_sd,
        tilt_sd=pair.slope_sd,
        top_sd=top_sd,
        support=pair.support / max(1.0, float(np.sum(shares))) + float(np.mean(found)),
        edges=edges,
    )
