"""Draw the moving picture at the head of the README: a trial that fails, and recovers.

    python tools/draw_recovery.py [docs/images/recovery.gif]      # half a minute

The trial is `pliant run --peg square --condition all --seed 4`, drawn again from its joint
positions, from aside and a little above. The board's front half is cut away so that the hole and
the peg in it are seen; the three springs of the wrist are the yellow ones at the top.
"""

import argparse
import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import av.filter
import cv2
import mujoco
import numpy as np

from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.pictures import Picture
from pliant.records import Trial
from pliant.report.canvas import (
    DARK,
    NEUTRAL,
    shortened,
    text,
    text_width,
    tick,
    verdict_colour,
)
from pliant.report.video import FRAMES_PER_S, Shot, storyboard
from pliant.sim import constants as c
from pliant.sim import model as m
from pliant.sim.cell import SimCell, Trajectory
from pliant.sim.render import Cameras
from pliant.sim.setup import apply
from pliant.task import BLOCK_SIZE, Task, load_task
from pliant.teaching import shipped

PEG, CONDITION, SEED = "square", "all", 4
CAMERA = "oblique"  # the model's own, moved
FPS, COLOURS, SMOOTHED = 10, 128, 2  # drawn that many times as wide and high, and shrunk
WIDTH, HEIGHT, CAPTION = 560, 420, 58  # [px] of the picture, and of the caption below it
BEHIND = ("base", "shoulder_link", "upper_arm_link", "forearm_link")  # of the arm, left out
SPRINGS_TO_HOLE = 0.115  # [m] above the board: the middle of what is to be seen
INSIDE = (0.45, 0.03, 0.03, 1.0)  # the hole's far wall, darker than the faces of the cut


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", nargs="?", type=Path, default=Path("docs/images/recovery.gif"))
    out = parser.parse_args().out
    task, cell = load_task(PEG), SimCell()
    spec = Spec(task=task, condition=condition(CONDITION), seed=SEED, reasoner="rules")
    trial = perform(spec, cell, shipped())
    written(out, pictures(task, trial, cell.trajectory()))
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")


def pictures(task: Task, trial: Trial, trajectory: Trajectory) -> Iterator[Picture]:
    """The frames in order: the trial in its own time, halted at each verdict."""
    model = m.build(task)
    apply(model, trajectory.setup)
    cut(model, task)
    aim(model)
    size = model.vis.global_
    size.offwidth, size.offheight = (SMOOTHED * side for side in c.IMAGE_SIZE)
    data, cameras = mujoco.MjData(model), Cameras(model, enlarged=SMOOTHED)
    drawn, picture = -1, np.zeros((0, 0, 3), np.uint8)
    for shot in storyboard(trial, trajectory)[:: round(FRAMES_PER_S / FPS)]:
        if shot.sample != drawn:
            data.qpos[:] = trajectory.qpos[shot.sample]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            large = cameras.image(CAMERA, data)
            small = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
            picture = small.astype(np.uint8, copy=False)
            drawn = shot.sample
        yield np.vstack([picture, caption(trial, shot)])


def cut(model: mujoco.MjModel, task: Task) -> None:
    """Leave of the board what is behind its middle: three boxes around a rectangular hole, in the
    compiled model's own arrays. They are only to be seen; nothing is simulated with them."""
    x, y = (half + task.hole.clearance / 2 for half in task.peg.half_extents)
    far, wide, high = BLOCK_SIZE[0] / 2, BLOCK_SIZE[1] / 2, BLOCK_SIZE[2]
    boxes = [(-far, -x, -wide, wide), (-x, 0.0, -wide, -y), (-x, 0.0, y, wide)]
    board = model.body(m.BOARD)
    geoms = range(int(board.geomadr[0]), int(board.geomadr[0]) + int(board.geomnum[0]))
    for geom in geoms:
        model.geom_rgba[geom, 3] = 0.0
    for geom, (back, front, left, right) in zip(geoms, boxes, strict=False):
        model.geom_type[geom], model.geom_dataid[geom] = mujoco.mjtGeom.mjGEOM_BOX, -1
        model.geom_size[geom] = [(front - back) / 2, (right - left) / 2, high / 2]
        model.geom_pos[geom] = [(back + front) / 2, (left + right) / 2, -high / 2]
        model.geom_quat[geom] = [1.0, 0.0, 0.0, 0.0]
        model.geom_aabb[geom] = [0.0, 0.0, 0.0, *model.geom_size[geom]]
        model.geom_rgba[geom] = c.BLOCK_RGBA if front == 0.0 else INSIDE
    for body in ("world", *BEHIND):
        model.geom_rgba[model.geom_bodyid == model.body(body).id, 3] = 0.0


def aim(model: mujoco.MjModel) -> None:
    """Have the camera look at peg, hole and springs, from the side of the cut."""
    camera = model.camera(CAMERA)
    turned, raised, away = math.radians(24), math.radians(14), 1.6
    level = np.array([math.cos(turned), math.sin(turned), 0.0])
    back = math.cos(raised) * level + [0.0, 0.0, math.sin(raised)]
    right = np.array([-math.sin(turned), math.cos(turned), 0.0])
    camera.pos[:] = away * back + [0.0, 0.0, SPRINGS_TO_HOLE]
    camera.fovy[0] = 15.0
    frame = np.column_stack([right, np.cross(back, right), back])
    mujoco.mju_mat2Quat(camera.quat, frame.ravel())


def caption(trial: Trial, shot: Shot) -> Picture:
    """Two lines: which formation is tried, and, once it stands, what the reasoner says of it."""
    picture = np.full((CAPTION, WIDTH, 3), DARK, np.uint8)
    execution = shot.execution
    if execution is None:
        text(picture, trial.end_reason, (52, 24), scale=0.62)
        return picture
    verdict, step = execution.verdict, execution.outcome.step
    picture[:, :40] = verdict_colour(verdict.success) if shot.judged else NEUTRAL
    name = f"{execution.index + 1} {str(step.formation).capitalize()}"
    text(picture, name, (52, 23), scale=0.62, weight=2)
    if not shot.judged:
        return picture
    tick(picture, (20, CAPTION / 2), verdict.success, size=18)
    words = "as it should be" if verdict.success else verdict.reason
    beside = 52 + text_width(name, 0.62, 2) + 14
    text(picture, shortened(words, WIDTH - beside - 8, 0.5), (beside, 23), scale=0.5)
    if execution.recovery is not None:
        how = f"recovery: {execution.recovery.analysis.how}"
        text(picture, shortened(how, WIDTH - 60, 0.5), (52, 47), scale=0.5)
    return picture


def written(path: Path, frames: Iterable[Picture]) -> None:
    """Write the frames as an animation that repeats for ever, with one palette for all of them."""
    width, height, beat = WIDTH, HEIGHT + CAPTION, Fraction(1, FPS)
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=width, height=height, format=av.VideoFormat("rgb24"), time_base=beat
    )
    split, sink = graph.add("split"), graph.add("buffersink")
    palette = graph.add("palettegen", f"max_colors={COLOURS}")
    use = graph.add("paletteuse", "dither=none:diff_mode=rectangle")
    for one, other, ends in (
        (source, split, (0, 0)),
        (split, use, (0, 0)),
        (split, palette, (1, 0)),
        (palette, use, (0, 1)),
        (use, sink, (0, 0)),
    ):
        one.link_to(other, *ends)
    graph.configure()
    for n, picture in enumerate(frames):
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts, frame.time_base = n, beat
        source.push(frame)
    source.push(None)
    with av.open(str(path), "w", options={"loop": "0"}) as container:
        stream = container.add_stream("gif", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = width, height, "pal8"
        with suppress(av.EOFError):  # how the graph says that there are no more
            while True:
                shown = sink.pull()
                assert isinstance(shown, av.VideoFrame)
                container.mux(stream.encode(shown))
        container.mux(stream.encode())


if __name__ == "__main__":
    main()
