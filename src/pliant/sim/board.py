"""The board: a block with a hole of the peg's shape, as convex prisms around the hole."""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pliant.sim.constants import ROUND_HOLE_SIDES
from pliant.task import BLOCK_SIZE, Hole, Peg

Polygon = NDArray[np.float64]  # (n, 2) [m], counter-clockwise around (0, 0)
Corners = NDArray[np.float64]  # (n, 3) [m]

_LEVEL = 1e-9  # sine of a bend: corners that bend less lie on a line
_NO_FACE = 1e-12  # [m2] of a triangle's edges: its vertices lie on a line
_FLAT = 1e-9  # [m]: vertices within it lie on a plane


@lru_cache(maxsize=16)
def hole_outline(peg: Peg, hole: Hole, *, grown: float = 0.0) -> Polygon:
    """The hole's outline, `grown` further on every side [m]. A round hole is a regular polygon
    around its circle, with flats at +-y."""
    margin = hole.clearance / 2 + grown
    if peg.radius is None:
        outline = np.array(peg.grown(margin))
    else:
        apothem = peg.radius + margin
        half = math.pi / ROUND_HOLE_SIDES
        angles = math.pi / 2 + half * (2 * np.arange(ROUND_HOLE_SIDES) + 1)
        corner = apothem / math.cos(half)
        outline = np.column_stack([corner * np.cos(angles), corner * np.sin(angles)])
    outline.setflags(write=False)  # it is kept for the next call
    return outline


def hole_prisms(peg: Peg, hole: Hole) -> list[Corners]:
    """Vertices of the convex pieces that fill the block around the hole, top at z = 0.

    Piece i lies outside the hole's edge i and between the rays from the centre through that edge's
    ends, so each is convex and none reaches into the hole. With a chamfer it bulges beyond those
    rays where a corner of the rim is off them. Beside a groove the hole may be there: so the
    chamfer of a hole with inward corners is pieces of its own, on a level of their own.
    """
    inner = hole_outline(peg, hole)
    rim = hole_outline(peg, hole, grown=hole.chamfer)
    bottom, foot = -BLOCK_SIZE[2], -hole.chamfer
    if hole.chamfer and len(convex_pieces(inner)) > 1:
        slopes = [
            np.array([*_edge(inner, foot, i), *_edge(rim, foot, i), *_edge(rim, 0.0, i)])
            for i in range(len(inner))
        ]
        return [*_around(inner, bottom, foot), *slopes, *_around(rim, foot, 0.0)]
    pieces = _around(inner, bottom, 0.0)
    if not hole.chamfer:
        return pieces
    for i, piece in enumerate(pieces):
        piece[2:4] = _edge(rim, 0.0, i)
    return [np.insert(p, 4, _edge(inner, foot, i), axis=0) for i, p in enumerate(pieces)]


def _around(outline: Polygon, low: float, high: float) -> list[Corners]:
    """The block from one height to another, less an outline: a prism for each edge of it."""
    pieces = []
    for i in range(len(outline)):
        outer = _block_outline_between(outline[i], outline[(i + 1) % len(outline)])
        vertices = [*_edge(outline, low, i), *_edge(outline, high, i)]
        vertices += [(x, y, z) for x, y in outer for z in (low, high)]
        pieces.append(np.array(vertices))
    return pieces


def _edge(outline: Polygon, z: float, i: int) -> list[tuple[float, float, float]]:
    """The ends of an outline's edge i, at a height."""
    return [(*outline[n % len(outline)], z) for n in (i, i + 1)]


def contains(outline: Polygon, point: Sequence[float]) -> bool:
    """Whether a point (x, y) lies inside a counter-clockwise outline, star-shaped around (0, 0)."""
    x, y = point
    corners = outline.tolist()
    return any(
        ax * y - ay * x >= 0
        and x * by - y * bx >= 0
        and (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
        for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True)
    )


def flat_mesh(faces: list[Corners]) -> tuple[Corners, NDArray[np.int32]]:
    """Vertices and triangles of a solid with these faces, no vertex shared between two of them:
    MuJoCo shades it flat, where it rounds off the edges of a hull that it makes itself."""
    triangles, first = [], 0
    for face in faces:
        triangles += [(first, first + i, first + i + 1) for i in range(1, len(face) - 1)]
        first += len(face)
    return np.vstack(faces), np.array(triangles, np.int32)


def prism_faces(polygon: Polygon, half: float) -> list[Corners]:
    """The faces of a convex polygon times 2 `half` [m], each counter-clockwise from outside."""
    top = np.column_stack([polygon, np.full(len(polygon), half)])
    bottom = top * (1, 1, -1)
    n = len(polygon)
    sides = [np.array([bottom[i - 1], bottom[i], top[i], top[i - 1]]) for i in range(n)]
    return [top, bottom[::-1], *sides]


def hull_faces(vertices: Corners) -> list[Corners]:
    """The faces of the convex hull of a few vertices, each counter-clockwise from outside."""
    triples = np.array(list(combinations(range(len(vertices)), 3)))
    a, b, c = (vertices[triples[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    keep = sizes > _NO_FACE
    normals, a = normals[keep] / sizes[keep, None], a[keep]
    normals, a = np.vstack([normals, -normals]), np.vstack([a, a])
    heights = normals @ vertices.T - np.sum(normals * a, axis=1, keepdims=True)
    faces: dict[tuple[int, ...], Corners] = {}
    for normal, height in zip(normals, heights, strict=True):
        on = np.flatnonzero(height > -_FLAT)
        if np.max(height) > _FLAT or tuple(on) in faces:
            continue
        spread = vertices[on] - vertices[on].mean(axis=0)
        angles = np.arctan2(spread @ np.cross(normal, spread[0]), spread @ spread[0])
        faces[tuple(on)] = vertices[on[np.argsort(angles)]]
    return list(faces.values())


def area(polygon: Polygon) -> float:
    """The area of a polygon [m2]."""
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def convex_pieces(outline: Polygon) -> list[Polygon]:
    """A star-shaped outline as convex polygons: itself, or sectors around (0, 0), the first from an
    inward corner on, each as wide as it can be."""
    bends = [_bend(*outline[[i - 1, i, (i + 1) % len(outline)]]) for i in range(len(outline))]
    if min(bends) > -_LEVEL:
        return [outline]
    ring = np.roll(outline, -int(np.argmin(bends)), axis=0)
    center = np.zeros(2)
    pieces = [[ring[0], ring[1]]]
    for corner in [*ring[2:], ring[0]]:
        first, before, last = pieces[-1][0], pieces[-1][-2], pieces[-1][-1]
        if _bend(before, last, corner) > -_LEVEL and _bend(corner, center, first) > 0:
            pieces[-1].append(corner)
        else:
            pieces.append([last, corner])
    return [np.array([center, *piece]) for piece in pieces]


def _bend(a: Polygon, b: Polygon, c: Polygon) -> float:
    """Sine of the angle by which the way from a over b to c turns left."""
    (ux, uy), (vx, vy) = b - a, c - b
    return float((ux * vy - uy * vx) / (math.hypot(ux, uy) * math.hypot(vx, vy)))


def _block_outline_between(start: Polygon, end: Polygon) -> list[tuple[float, float]]:
    """The points where the rays through two points leave the block, and the block's corners between
    them."""
    half = np.array(BLOCK_SIZE[:2]) / 2

    def leave(p: Polygon) -> tuple[float, float]:
        out = p * np.min(half / np.maximum(np.abs(p), 1e-12))
        return float(out[0]), float(out[1])

    first, last = math.atan2(start[1], start[0]), math.atan2(end[1], end[0])
    corners = [(sx * half[0], sy * half[1]) for sx in (-1, 1) for sy in (-1, 1)]
    span = (last - first) % math.tau
    between = [c for c in corners if 0 < (math.atan2(c[1], c[0]) - first) % math.tau < span]
    return [leave(start), *between, leave(end)]
