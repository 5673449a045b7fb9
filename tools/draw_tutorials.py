"""Draw the pictures of docs/loop.md and of the tutorials, from trials and from the model.

    python tools/draw_tutorials.py [docs/images]      # a quarter of a minute

The drawing of the first peg is drawn from the file that its page shows.
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import yaml

from pliant import pictures
from pliant.conditions import Setup, condition
from pliant.experiment.one import Spec, perform
from pliant.pictures import Picture
from pliant.report import strip
from pliant.report.canvas import Colour, Point, text
from pliant.sim.cell import SimCell
from pliant.task import Task, load_task
from pliant.teaching import shipped

ROOT = Path(__file__).parent.parent
PAGE, PEG = ROOT / "docs/tutorials/first-peg.md", "keyed_plug.yaml"
INK: Colour = (30, 60, 110)
SCALE = 9  # [px] a millimetre
AXES = {"x": (200, 40, 40), "y": (30, 130, 50), "z": (40, 80, 200)}  # of the task frame
AXIS_M = 0.12  # [m] how long one is drawn


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", nargs="?", type=Path, default=ROOT / "docs/images")
    out = parser.parse_args().out
    source = PAGE.read_text(encoding="utf-8").split(f'title="{PEG}"\n')[1].split("```")[0]
    drawn = {
        "loop.png": trial_of(load_task("circle")),
        "first-peg.png": drawing(yaml.safe_load(source)),
        "own-robot.png": frames(),
    }
    with TemporaryDirectory() as folder:
        file = Path(folder) / PEG
        file.write_text(source, encoding="utf-8")
        drawn["first-peg-goes-in.png"] = trial_of(load_task(str(file)))
    for name, picture in drawn.items():
        (out / name).write_bytes(pictures.encoded(picture))


def trial_of(task: Task) -> Picture:
    """The strip of `pliant run` with that task."""
    spec = Spec(task=task, condition=condition("all"), seed=1, reasoner="rules")
    return strip.draw(perform(spec, SimCell(), shipped()).executions)


# --- the peg's drawing ---------------------------------------------------------------------------


def drawing(peg: dict[str, Any]) -> Picture:
    """The cross-section seen from above, and the peg from aside, with their dimensions [mm]."""
    picture = np.full((460, 1000, 3), 255, np.uint8)
    corners = np.array(peg["corners_mm"], float)
    middle = np.array([250.0, 215.0])
    outline = [(middle[0] + SCALE * y, middle[1] + SCALE * x) for x, y in corners]
    stroke(picture, [*outline, outline[0]], width=3)
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0), corners.max(axis=0)
    left, right = (middle[0] + SCALE * y for y in (low_y, high_y))
    top, bottom = (middle[1] + SCALE * x for x in (low_x, high_x))
    measure(picture, (left, top - 34), (right, top - 34), f"{high_y - low_y:g}")
    measure(picture, (left - 40, top), (left - 40, bottom), f"{high_x - low_x:g}")
    cut = [y for x, y in corners if x == high_x]
    measure(picture, (right - SCALE * (high_y - max(cut)), bottom + 34), (right, bottom + 34),
            f"{high_y - max(cut):g}")  # fmt: skip
    stroke(picture, [(middle[0] - 14, middle[1]), (middle[0] + 14, middle[1])])
    stroke(picture, [(middle[0], middle[1] - 14), (middle[0], middle[1] + 14)])
    text(picture, "from above; below: the camera's side", (60, 440), scale=0.6, colour=INK)
    length, scale = float(peg["length_mm"]), 3.2
    left, right = 640.0, 640.0 + (high_y - low_y) * scale
    top, bottom = 60.0, 60.0 + length * scale
    stroke(
        picture, [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], width=3
    )
    for y in cut:
        at = left + (y - low_y) * scale
        stroke(picture, [(at, top), (at, bottom)])
    measure(picture, (right + 46, top), (right + 46, bottom), f"{length:g}")
    text(picture, f"bore {peg['clearance_mm']:g} wider, rim {peg['chamfer_mm']:g} at 45 deg",
         (590, 440), scale=0.6, colour=INK)  # fmt: skip
    return picture


def measure(picture: Picture, begin: Point, end: Point, words: str) -> None:
    """A dimension's line with arrows, and its number beside it."""
    for a, b in ((begin, end), (end, begin)):
        cv2.arrowedLine(picture, rounded(a), rounded(b), INK, 1, cv2.LINE_AA, tipLength=0.08)
    middle = ((begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2)
    upright = begin[0] == end[0]
    at = (middle[0] - 10, middle[1] + 6) if upright else (middle[0], middle[1] - 8)
    at = (at[0] - 4, at[1]) if upright else at
    text(picture, words, at, scale=0.6, colour=INK, align="right" if upright else "center")


def stroke(picture: Picture, points: list[Point], *, width: int = 1) -> None:
    shifted = np.array([rounded(p) for p in points], np.int32)
    cv2.polylines(picture, [shifted], False, INK, width, cv2.LINE_AA)


def rounded(point: Point) -> tuple[int, int]:
    return round(point[0]), round(point[1])


# --- the cell's frame ----------------------------------------------------------------------------


def frames() -> Picture:
    """The cell from afar, with the task frame's axes at the hole."""
    with SimCell().prepare(load_task("circle"), Setup(seed=1)) as robot:
        view = robot.observe(("wide",)).views["wide"]
    picture = view.image.copy()
    zero = view.camera.project(np.zeros(3))
    for n, (name, colour) in enumerate(AXES.items()):
        tip = view.camera.project(AXIS_M * np.eye(3)[n])
        cv2.arrowedLine(picture, rounded(zero), rounded(tip), colour, 3, cv2.LINE_AA, tipLength=0.2)
        text(picture, name, (tip[0] + 6, tip[1] + 4), scale=0.7, colour=colour, weight=2)
    return picture


if __name__ == "__main__":
    main()
