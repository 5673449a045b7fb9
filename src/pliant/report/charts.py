"""Small charts as SVG in the page's own colours: bars with intervals, a difference, a histogram.

Every chart says in words what it shows, for those who cannot see it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pliant.html import Html, tag

_WIDTH, _ROW, _MARGIN = 170, 13, 6  # [px] of a bar chart, of a bar, and left and right of it


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A bar of a chart: a share [%] with its interval [%], and the paper's where it has one; `kind`
    is its style."""

    percent: float | None
    low: float | None = None
    high: float | None = None
    paper: float | None = None
    kind: str = "success"


def bars(shown: Sequence[Bar], described: str) -> Html:
    """A chart of bars one above the other from 0 to 100 %: whiskers for intervals, a diamond for
    the paper."""
    height = _ROW * len(shown) + 4
    parts = [_line(x, 0, x, height, "grid") for x in _ticks()]
    for n, bar in enumerate(shown):
        top, middle = n * _ROW + 3, n * _ROW + 3 + _ROW / 2 - 1
        if bar.percent is not None:
            parts.append(_rectangle(_x(0), top, _x(bar.percent) - _x(0), _ROW - 3, bar.kind))
        if bar.low is not None and bar.high is not None:
            parts.append(_whisker(_x(bar.low), _x(bar.high), middle))
        if bar.paper is not None:
            parts.append(_diamond(_x(bar.paper), middle))
    return _chart(_WIDTH, height, parts, described)


def difference(value: float, low: float, high: float, described: str) -> Html:
    """A chart of a difference of shares, from −100 to 100 points, with its interval."""
    height = _ROW + 4

    def x(v: float) -> float:
        return _x((v + 100) / 2)

    parts = [_line(at, 0, at, height, "grid") for at in (x(-100), x(100))]
    parts += [
        _line(x(0), 0, x(0), height, "zero"),
        _whisker(x(low), x(high), height / 2),
        tag("circle", cx=f"{x(value):.1f}", cy=f"{height / 2:.1f}", r="4", class_="point"),
    ]
    return _chart(_WIDTH, height, parts, described)


@dataclass(frozen=True, kw_only=True)
class Bin:
    """A bin of a histogram: trials whose drawn quantity lies between two values, and the share that
    was inserted. `link` leads to them."""

    begin: float
    end: float
    bar: Bar
    link: str
    described: str


def histogram(bins: Sequence[Bin], failures: Sequence[float], label: str, described: str) -> Html:
    """A chart of the share of success in each bin over the drawn quantity; below, a stroke per
    failure."""
    width, height, left, bottom = 330, 170, 34, 44
    low, high = bins[0].begin, bins[-1].end
    plot_width, plot_height = width - left - 8, height - bottom - 8

    def x(value: float) -> float:
        return left + plot_width * (value - low) / (high - low)

    def y(percent: float) -> float:
        return 8 + plot_height * (1 - percent / 100)

    parts = []
    for percent in (0, 50, 100):
        parts.append(_line(left, y(percent), width - 8, y(percent), "grid"))
        parts.append(_text(left - 5, y(percent) + 4, f"{percent}", "end"))
    for shown in bins:
        parts.append(_column(shown, x(shown.begin) + 1, x(shown.end) - 1, y))
    strokes = "".join(f"M{x(v):.1f} {height - bottom + 3}v9" for v in sorted(failures))
    if strokes:
        parts.append(tag("path", d=strokes, class_="rug"))
    for edge in (low, (low + high) / 2, high):
        anchor = "start" if edge == low else "end" if edge == high else "middle"
        parts.append(_text(x(edge), height - bottom + 26, f"{edge:g}".replace("-", "−"), anchor))
    parts.append(_text((left + width) / 2, height - 4, label, "middle"))
    return _chart(width, height, parts, described, group=True)


def _column(shown: Bin, left: float, right: float, y: Callable[[float], float]) -> Html:
    """One bin's column of a histogram, linked to its trials."""
    bar, middle = shown.bar, (left + right) / 2
    parts = [tag("title", shown.described)]
    # The whole column can be chosen, however low its bar is.
    parts.append(_rectangle(left, y(100), right - left, y(0) - y(100), "ground"))
    if bar.percent is not None:
        parts.append(
            _rectangle(left, y(bar.percent), right - left, y(0) - y(bar.percent), bar.kind)
        )
    if bar.low is not None and bar.high is not None:
        path = f"M{middle:.1f} {y(bar.low):.1f}V{y(bar.high):.1f}"
        path += "".join(f"M{middle - 4:.1f} {y(v):.1f}h8" for v in (bar.low, bar.high))
        parts.append(tag("path", d=path, class_="whisker"))
    return tag("a", *parts, href=shown.link, aria_label=shown.described)


def _x(percent: float) -> float:
    return _MARGIN + (_WIDTH - 2 * _MARGIN) * percent / 100


def _ticks() -> list[float]:
    return [_x(percent) for percent in (0, 50, 100)]


def _chart(
    width: float, height: float, parts: Sequence[Html], described: str, *, group: bool = False
) -> Html:
    return tag(
        "svg",
        *parts,
        viewBox=f"0 0 {width:g} {height:g}",
        width=f"{width:g}",
        height=f"{height:g}",
        role="group" if group else "img",
        aria_label=described,
        class_="chart",
    )


def _line(x1: float, y1: float, x2: float, y2: float, kind: str) -> Html:
    path = f"M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"
    return tag("path", d=path, class_=kind)


def _rectangle(x: float, y: float, width: float, height: float, kind: str) -> Html:
    return tag(
        "rect",
        x=f"{x:.1f}",
        y=f"{y:.1f}",
        width=f"{max(0.0, width):.1f}",
        height=f"{max(0.0, height):.1f}",
        class_=kind,
    )


def _whisker(low: float, high: float, y: float) -> Html:
    ends = "".join(f"M{x:.1f} {y - 3:.1f}v6" for x in (low, high))
    return tag("path", d=f"M{low:.1f} {y:.1f}H{high:.1f}{ends}", class_="whisker")


def _diamond(x: float, y: float) -> Html:
    return tag("path", d=f"M{x - 5:.1f} {y:.1f}l5 -5l5 5l-5 5z", class_="paper")


def _text(x: float, y: float, words: str, anchor: str) -> Html:
    return tag("text", words, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor)
