"""The screen of `pliant teach`: formations, pose, what the picture measures, the picture itself in
half blocks, and the keys. It fits 80 columns by 24 rows, and grows with the terminal."""

import math
from itertools import groupby

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.console import Group, RenderableType
from rich.style import Style
from rich.table import Table
from rich.text import Text

from pliant.cell import Observation, View
from pliant.commissioning.keys import HELP
from pliant.commissioning.session import Session
from pliant.formations import OWNED, Formation
from pliant.pose import Axis
from pliant.vision.scene import Scene

_LEFT = 43  # columns of what stands left of the picture
_BELOW = 8  # rows of what stands below and above it
_TIP, _HOLE = (255, 145, 220), (250, 250, 250)
_COARSE = 16  # colours are rounded to this, for less traffic
_DONE, _NOW, _WRONG = "#117733", "bold", "#882255"


def render(
    session: Session,
    observation: Observation,
    scene: Scene,
    *,
    title: str,
    size: tuple[int, int],
) -> RenderableType:
    """The whole screen of `pliant teach`, `size` (columns, rows)."""
    columns, rows = size
    left = Group(_formations(session), Text(), _pose(session, observation), _seen(scene))
    body = Table.grid(padding=(0, 1))
    body.add_column(width=_LEFT - 2)
    body.add_column()
    view = observation.views["side"]
    width = min(columns - _LEFT, (rows - _BELOW) * 2 * view.camera.width // view.camera.height)
    body.add_row(left, picture(view, scene, max(8, width)))
    note = Text(session.note or " ", style="reverse" if session.note else "", no_wrap=True)
    note.truncate(columns, overflow="ellipsis")
    return Group(
        Text(title, style="bold", no_wrap=True, overflow="ellipsis"), body, note, _help(columns)
    )


def picture(view: View, scene: Scene, columns: int) -> Text:
    """A picture `columns` wide, two pixels to a character; the measured tip and hole are dots."""
    marked = view.image.copy()
    if scene.hole is not None:
        _dot(marked, view, scene.hole.y.value, scene.hole.surface_z.value, _HOLE)
    if scene.peg is not None:
        _dot(marked, view, scene.peg.tip_y.value, scene.peg.tip_z.value, _TIP)
    rows = round(columns * view.camera.height / view.camera.width / 2)
    small = cv2.resize(marked, (columns, 2 * rows), interpolation=cv2.INTER_AREA)
    small = small // _COARSE * _COARSE + _COARSE // 2
    text = Text(no_wrap=True)
    for upper, lower in zip(small[0::2], small[1::2], strict=True):
        cells = np.hstack([upper, lower]).tolist()
        for colours, run in groupby(cells):
            above, below = Color.from_rgb(*colours[:3]), Color.from_rgb(*colours[3:])
            text.append("▀" * len(list(run)), Style(color=above, bgcolor=below))
        text.append("\n")
    text.right_crop()
    return text


def _dot(
    image: NDArray[np.uint8], view: View, y: float, z: float, colour: tuple[int, int, int]
) -> None:
    u, v = view.camera.project(np.array([0.0, y, z]))
    cv2.circle(image, (round(u), round(v)), 9, colour, -1)


def _formations(session: Session) -> Table:
    table = Table.grid(padding=(0, 1))
    records, stale = session.records, session.stale()
    for formation in Formation:
        is_now = formation is session.formation
        record = records.get(formation)
        said = Text(", ".join(OWNED[formation]), style="dim")
        if record is not None:
            values = (f"{a} {_tenth(a.to_report(record.goal[a]))}" for a in OWNED[formation])
            goal = "  ".join(values)
            said = Text(goal, style=_DONE)
            if formation in stale:
                said = Text(f"{goal}: again", style=_WRONG)
        table.add_row("▶" if is_now else " ", Text(formation, style=_NOW if is_now else ""), said)
    if session.formation is None:
        table.add_row("▶", Text("done", style=_NOW), Text("Enter writes the goals", style=_DONE))
    return table


def _pose(session: Session, observation: Observation) -> Table:
    table = Table.grid(padding=(0, 1))
    table.add_column(width=7)
    for width in (9, 9, 10):
        table.add_column(width=width, justify="right")
    table.add_row(*(Text(t, style="dim") for t in ("axis", "set", "measured", "step")))
    for axis in Axis:
        step = session.angle_deg if axis.is_angle else session.length_mm
        table.add_row(
            axis.value,
            _tenth(axis.to_report(session.at[axis])),
            f"{axis.to_report(observation.pose[axis]):.2f}",
            f"{step:g} {axis.report_unit}",
        )
    table.add_row("pressed", "", f"{observation.compression_m * 1e3:.2f}", "mm")
    return table


def _seen(scene: Scene) -> Text:
    parts = []
    if scene.peg is not None:
        peg = scene.peg
        y, z = _tenth(peg.tip_y.value * 1e3), _tenth(peg.tip_z.value * 1e3)
        parts.append(f"tip y {y} z {z} mm, tilt {_tenth(math.degrees(peg.tilt.value))} deg")
    if scene.hole is not None:
        parts.append(f"hole y {_tenth(scene.hole.y.value * 1e3)} mm")
    return Text("\n".join([*parts, *scene.problems]))


def _tenth(value: float) -> str:
    """A number to one decimal, without a minus before zero."""
    return f"{round(value, 1) + 0.0:.1f}"


def _help(columns: int) -> Text:
    """The keys of `pliant teach` in words, as many to a line as fit."""
    text, used = Text(), 0
    for key, meaning in HELP:
        length = len(key) + 1 + len(meaning) + 3
        if used and used + length > columns:
            text.append("\n")
            used = 0
        text.append(key, "bold").append(f" {meaning}   ", "dim")
        used += length
    return text
