"""Star-shaped outlines to order: random ones, and those with keys, grooves and nearly straight
corners."""

import math

import numpy as np
from hypothesis import strategies as st

from pliant.polygon import Outline

_DEGREES = st.lists(st.integers(0, 359), min_size=4, max_size=16, unique=True)
Polar = list[tuple[float, float]]  # angle [rad], radius [m]


@st.composite
def outlines(draw: st.DrawFn, most: int = 100) -> Outline:
    """An outline that a peg may have; waves and fine grooves with `most` corners at most."""
    shapes = [_random(), _notched(), _wavy(most), _fine_groove(most - 10)]
    corners = draw(draw(st.sampled_from(shapes)))
    if draw(st.booleans()):
        corners = draw(_nearly_straight(corners))
    return _centred(corners)


def _cut_into_thirds(degrees: list[int]) -> list[float]:
    """With angles added so that no edge sees the axis under more than a third of a turn."""
    return sorted(math.radians(d) for d in {*degrees, 7, 123, 241})


@st.composite
def _random(draw: st.DrawFn) -> Polar:
    angles = _cut_into_thirds(draw(_DEGREES))
    return [(a, draw(st.integers(60, 250)) * 1e-4) for a in angles]


@st.composite
def _notched(draw: st.DrawFn) -> Polar:
    """A disc with grooves whose walls widen outward, and keys."""
    places = draw(st.lists(st.integers(0, 11), min_size=1, max_size=6, unique=True))
    corners: Polar = []
    for place in range(12):
        middle = math.radians(30 * place)
        if place not in places:
            corners.append((middle, 0.02))
            continue
        floor = draw(st.integers(0, 6)) * 1e-3  # 0: a V
        depth = draw(st.sampled_from([-0.006, 0.001, 0.004, 0.009]))  # below 0: a key
        inner, mouth = 0.02 - depth, math.radians(11)
        half = min(math.atan2(floor / 2, inner), 0.8 * mouth)
        around = [(-mouth, 0.02), (-half, inner), (half, inner), (mouth, 0.02)]
        corners += [(middle + a, r) for a, r in (around if half else [around[0], *around[2:]])]
    return corners


@st.composite
def _wavy(draw: st.DrawFn, most: int) -> Polar:
    """A closed wave with as many corners as a drawing program writes."""
    count, waves = draw(st.integers(20, most)), draw(st.integers(1, 9))
    height = draw(st.sampled_from([1e-6, 1e-4, 3e-3]))
    angles = [math.tau * n / count for n in range(count)]
    return [(a, 0.018 + height * math.cos(waves * a)) for a in angles]


@st.composite
def _fine_groove(draw: st.DrawFn, most: int) -> Polar:
    """A disc with a round groove of many corners, each of which hardly bends."""
    count, depth = draw(st.integers(15, most)), draw(st.sampled_from([1e-5, 2e-4, 2e-3]))
    width = 3 * depth / 0.02
    groove = [
        (width * (2 * n / count - 1), 0.02 - depth * math.cos(math.pi / 2 * (2 * n / count - 1)))
        for n in range(count + 1)
    ]
    return [*groove, *((math.radians(d), 0.02) for d in range(60, 330, 30))]


@st.composite
def _nearly_straight(draw: st.DrawFn, corners: Polar) -> Polar:
    """With a corner in the middle of some edges, in or out by next to nothing."""
    points = [(r * math.cos(a), r * math.sin(a)) for a, r in corners]
    more: Polar = []
    for n, (x, y) in enumerate(points):
        more.append((math.atan2(y, x), math.hypot(x, y)))
        if len(points) < 40 and draw(st.booleans()):
            nx, ny = points[(n + 1) % len(points)]
            mx, my = (x + nx) / 2, (y + ny) / 2
            off = draw(st.sampled_from([-1e-5, -1e-8, -1e-12, 0.0, 1e-12, 1e-8, 1e-5]))
            more.append((math.atan2(my, mx), math.hypot(mx, my) + off))
    return more


def _centred(corners: Polar) -> Outline:
    """As far to -y as to +y: one half is drawn out, which keeps the corners' order."""
    xy = np.array([(r * math.cos(a), r * math.sin(a)) for a, r in corners])
    low, high = -xy[:, 1].min(), xy[:, 1].max()
    xy[:, 1] *= np.where(xy[:, 1] > 0, math.sqrt(low / high), math.sqrt(high / low))
    return tuple((float(x), float(y)) for x, y in xy)
