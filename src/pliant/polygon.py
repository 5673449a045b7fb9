"""Polygons around the origin: the outline of a peg, checked, grown and turned."""

import math
from collections.abc import Iterator

Corner = tuple[float, float]  # x, y [m]
Outline = tuple[Corner, ...]

_LEAST_DISTANCE = 0.0005  # [m] of a peg's faces from its axis
_LEAST_EDGE = 1e-6  # [m]: corners closer than that are one
_MOST_CORNERS = 200  # each is a piece of the simulated board


def fault_of(outline: Outline) -> str | None:
    """The reason why corners are no outline around the origin; None: they are one."""
    if len(outline) < 3:
        return f"an outline of {len(outline)} corners; it must have at least 3"
    if len(outline) > _MOST_CORNERS:
        return f"an outline of {len(outline)} corners; it must have at most {_MOST_CORNERS}"
    if all(x * ny - y * nx < 0 for (x, y), (nx, ny) in edges(outline)):
        return "its corners go clockwise; list them in the opposite order"
    turning = 0.0
    for (x, y), (nx, ny) in edges(outline):
        cross = x * ny - y * nx
        if math.hypot(nx - x, ny - y) < _LEAST_EDGE:
            return f"its corner {spoken(x, y)} mm is given twice in a row; give it once"
        if not cross >= _LEAST_DISTANCE * math.hypot(nx - x, ny - y) > 0:
            return (
                f"its edge from {spoken(x, y)} to {spoken(nx, ny)} mm does not go"
                " counter-clockwise around the axis at (0, 0), nowhere nearer to it than"
                f" {_LEAST_DISTANCE * 1e3:g} mm, as every edge must"
            )
        turning += math.atan2(cross, x * nx + y * ny)
    if not math.isclose(turning, math.tau):
        return f"its corners go {turning / math.tau:.0f} times around the axis; it must be once"
    return None


def grown(outline: Outline, margin: float) -> Outline:
    """An outline with every edge moved outward by `margin` [m], and as long as it then must be to
    meet the next."""
    normals = []
    for (ax, ay), (bx, by) in edges(outline):
        length = math.hypot(bx - ax, by - ay)
        normals.append(((by - ay) / length, (ax - bx) / length))
    grown = []
    for i, (x, y) in enumerate(outline):
        (px, py), (nx, ny) = normals[i - 1], normals[i]
        scale = margin / (1 + px * nx + py * ny)
        grown.append((x + (px + nx) * scale, y + (py + ny) * scale))
    return tuple(grown)


def reversed_edge(outline: Outline, grown: Outline) -> tuple[Corner, Corner] | None:
    """The first edge that vanished when the outline grew."""
    for (a, b), (ga, gb) in zip(edges(outline), edges(grown), strict=True):
        if (b[0] - a[0]) * (gb[0] - ga[0]) + (b[1] - a[1]) * (gb[1] - ga[1]) <= 0:
            return a, b
    return None


def edges(outline: Outline) -> Iterator[tuple[Corner, Corner]]:
    """Each edge's two corners, in order."""
    return zip(outline, (*outline[1:], *outline[:1]), strict=True)


def turned(outline: Outline, yaw: float) -> Outline:
    cos, sin = math.cos(yaw), math.sin(yaw)
    return tuple((cos * x - sin * y, sin * x + cos * y) for x, y in outline)


def spoken(x: float, y: float) -> str:
    return f"({x * 1e3:g}, {y * 1e3:g})"
