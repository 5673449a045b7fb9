"""The paper's strip of snapshots: one picture per execution, its formation's name above it on green
where the verdict was success and on purple where it was failure."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from pliant.pictures import Picture
from pliant.records import Execution
from pliant.report.canvas import text, text_width, tick, verdict_colour

_ROW = 8  # most snapshots side by side
_TILE = 240  # [px] side of a snapshot
_HEADER = 40  # [px]
_GAP = 6  # [px]
_WORDS = 0.75
_CROP = (slice(0, 390), slice(125, 515))  # rows, columns of a 640x480 picture: peg, fingers, hole


def draw(executions: Sequence[Execution]) -> Picture:
    """The strip as one picture, RGB, on white; rows of equal length where it is long."""
    rows = max(1, math.ceil(len(executions) / _ROW))
    columns = max(1, math.ceil(len(executions) / rows))
    height, width = _HEADER + _TILE + _GAP, _TILE + _GAP
    picture = np.full((rows * height - _GAP, columns * width - _GAP, 3), 255, np.uint8)
    for n, execution in enumerate(executions):
        row, column = divmod(n, columns)
        top, left = row * height, column * width
        picture[top : top + _HEADER + _TILE, left : left + _TILE] = _tile(execution)
    return picture


def snapshot(execution: Execution) -> Picture:
    """The execution's last side picture, RGB."""
    return execution.outcome.looks[-1].observation.views["side"].image


def _tile(execution: Execution) -> Picture:
    name, success = str(execution.formation).capitalize(), execution.verdict.success
    tile = np.zeros((_HEADER + _TILE, _TILE, 3), np.uint8)
    tile[:_HEADER] = verdict_colour(success)
    left = (_TILE - text_width(name, _WORDS) - 26) / 2
    tick(tile, (left + 8, _HEADER / 2), success, size=13)
    text(tile, name, (left + 26, _HEADER / 2 + 8), scale=_WORDS)
    shown = snapshot(execution)
    if shown.shape[:2] == (480, 640):
        shown = shown[_CROP]
    tile[_HEADER:] = cv2.resize(shown, (_TILE, _TILE), interpolation=cv2.INTER_AREA)
    return tile
