"""A segmentation of your own. This one learns the colours of a peg and a board that nobody
configured from the first picture, in which the arm knows about where both are; a network that
labels pixels takes its place. What it finds is painted in the shipped colours, and measured as
ever."""

import math
from dataclasses import replace

import cv2
import numpy as np

from pliant.cell import Observation, View
from pliant.conditions import Setup
from pliant.methods.planar import Planar
from pliant.reasoners.rules import Rules
from pliant.sim.cell import SimCell
from pliant.task import BLOCK_SIZE, load_task
from pliant.teaching import shipped
from pliant.trial import Run
from pliant.vision.scene import Scene
from pliant.vision.sight import ByColour

TASK, TAUGHT = load_task("circle"), shipped()
PEG, BLOCK = (0, 200, 200), (200, 0, 0)  # RGB that the shipped colours take for them
BINS = 22  # of each of red, green and blue


def area(view: View, y: float, bottom: float, top: float, half: float) -> np.ndarray:
    """The pixels (h, w) of a rectangle [m] in the plane of insertion."""
    corners = [(y - half, bottom), (y + half, bottom), (y + half, top), (y - half, top)]
    pixels = [view.camera.project(np.array([0.0, a, b])) for a, b in corners]
    found = np.zeros(view.image.shape[:2], np.uint8)
    cv2.fillConvexPoly(found, np.round(pixels).astype(np.int32), 1)
    return found.astype(bool)


def codes(image: np.ndarray) -> np.ndarray:
    """Which of all colours each pixel has (h, w)."""
    return (image // (256 // BINS + 1)).astype(int) @ (BINS**2, BINS, 1)


class Learned:
    """Pixels whose colour is more frequent where the thing surely is than where it cannot be."""

    colours = None  # nobody tells it any

    def __init__(self) -> None:
        self._measured = ByColour(TASK)
        self._is: dict[str, np.ndarray] = {}  # whether each colour is the peg's, the block's

    def __call__(self, observation: Observation) -> Scene:
        view, pose = observation.views["side"], observation.pose
        tip, lean = pose.z - TASK.tip_below_hinge, 0.5 * pose.roll
        y, half = pose.y + TASK.tip_below_hinge * math.sin(lean), TASK.peg.half_extents[1]
        near = {
            "block": area(view, 0.0, -0.10, 0.004, BLOCK_SIZE[1] / 2 + 0.03),
            "peg": area(view, y, max(0.0, tip - 0.015), tip + 0.095, half + 0.022),
        }
        if not self._is:
            sure = {
                "block": area(view, 0.0, -0.06, -0.01, BLOCK_SIZE[1] / 2 - 0.03),
                "peg": area(view, y - 0.05 * lean, tip + 0.03, tip + 0.07, half / 2),
            }
            for name, here in sure.items():
                inside, outside = (
                    np.bincount(codes(view.image)[part], minlength=BINS**3) / part.sum()
                    for part in (here, ~near[name])
                )
                self._is[name] = inside > outside
        image = np.zeros_like(view.image)
        for name, colour in (("block", BLOCK), ("peg", PEG)):
            mask = (near[name] & self._is[name][codes(view.image)]).astype(np.uint8)
            image[cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((9, 9))) > 0] = colour
        return self._measured(replace(observation, views={"side": replace(view, image=image)}))


cell, setup = SimCell(), Setup(seed=4, hole_y=0.006, looks=1.0)  # random colours and textures
for name, sight in (("the shipped colours", ByColour(TASK)), ("learned", Learned())):
    robot = cell.prepare(TASK, setup)
    run = Run(
        robot=robot, task=TASK, teaching=TAUGHT, reasoner=Rules(), method=Planar(), sight=sight
    )
    executions = list(run)
    unseen = sum(e.outcome.scene.peg is None or e.outcome.scene.hole is None for e in executions)
    print(f"{name}: {run.end_reason} after {len(executions)} executions, {unseen} of them unseen")
