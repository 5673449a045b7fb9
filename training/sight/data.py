"""Makes labelled pictures: states of real trials, dressed anew for every picture, and around peg
and block what the network is shown. Truth comes from the simulator, through the camera as it really
is.

    python data.py states.npz out --pictures 2000 --processes 2
"""

import argparse
import math
import multiprocessing
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import mujoco
import numpy as np
import states
from numpy.typing import NDArray

from pliant.cell import Camera
from pliant.pose import Pose, rotation_matrix
from pliant.sim import constants as c
from pliant.sim.cell import SimRobot
from pliant.sim.looks import Looks, looks_of, noisy
from pliant.sim.setup import apply, place
from pliant.task import Task
from pliant.vision import expected
from pliant.vision.expected import Outlined, Pictures, Silhouette
from pliant.vision.surround import _QUARTER, quarter_turned

FIRST, LAST = 300_000, 599_999  # seeds of looks that are trained on
PER_THING = 3  # small pictures of one thing in a picture
SAG_M = 0.0088  # of the tool's weight
LEAST_EACH = 12  # pictures of a trial, whose cell takes a second to make
WITHIN = 58.0  # [small px] farther off a thing counts as not there
LABELS = 5  # across, along [small px], turn [rad], visible, first look


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A picture and the truth: peg and block as they are, and how the camera really sees them."""

    image: NDArray[np.uint8]
    camera: Camera  # nominal
    pose: Pose
    pressed: float
    peg: Outlined
    block: Outlined
    true_peg: Silhouette
    true_block: Silhouette
    task: Task
    peg_there: bool
    block_there: bool = True


def true_camera(camera: Camera, looks: Looks, name: str) -> Camera:
    """The camera where it really is."""
    if name not in looks.shifts:
        return camera
    shift = looks.shifts[name]
    flip = np.diag([1.0, -1.0, -1.0])
    axes = camera.rotation @ flip  # right, up, back
    turned = axes @ rotation_matrix(*shift.angles.tolist())
    return replace(camera, position=camera.position + axes @ shift.offset, rotation=turned @ flip)


class Scenes:
    """Draws the states of recorded trials, each picture with looks of its own."""

    def __init__(self, trials: list[states.Recorded]) -> None:
        self._trials = trials
        self._robot: SimRobot | None = None

    def take(self, n: int) -> "Scenes":
        """Make a trial's cell ready."""
        self.trial = self._trials[n]
        if self._robot is not None:
            self._robot.cameras.close()
        self._robot = SimRobot(self.trial.task)
        return self

    def picture(
        self,
        row: int,
        name: str,
        seed: int,
        *,
        looks: bool,
        occluder: bool,
        missing: bool = False,
    ) -> Picture:
        """The picture of a camera in a state, with the looks that a seed gives."""
        robot, trial = self._robot, self.trial
        assert robot is not None
        setup = replace(
            trial.setup,
            seed=seed,
            looks=float(looks),
            occluder=float(occluder),
            peg_missing=float(missing),
        )
        time_s = float(trial.time_s[row])
        mujoco.mj_resetData(robot.model, robot.data)
        apply(robot.model, setup, time_s)
        place(robot.model, setup, time_s)
        robot.setup = setup
        robot.data.qpos[:] = trial.qpos[row]
        mujoco.mj_forward(robot.model, robot.data)
        robot.cameras.dress(setup)
        dressed = looks_of(setup)
        image = robot.cameras.image(name, robot.data)
        image = noisy(dressed, image, np.random.default_rng([seed, 3]))
        nominal = robot.cameras._calibrations[name]
        really = true_camera(nominal, dressed, name)
        pose = robot.pose()
        tip = robot.data.site_xpos[robot.tip_site].copy()
        peg = robot.data.xmat[robot.peg_body].reshape(3, 3)
        hole = robot.data.xpos[robot.board_body].copy()
        board = robot.data.xmat[robot.board_body].reshape(3, 3)
        if name == "front":
            nominal, really = quarter_turned(nominal), quarter_turned(really)
            tip, hole, peg, board = (
                _QUARTER @ tip,
                _QUARTER @ hole,
                _QUARTER @ peg,
                _QUARTER @ board,
            )
            pose = Pose(
                x=pose.y,
                y=-pose.x,
                z=pose.z,
                roll=pose.pitch,
                pitch=-pose.roll,
                yaw=pose.yaw - math.pi / 2,
            )
        axis = peg[:, 2]
        true_peg = expected.outlined_peg(
            trial.task.peg,
            x=tip[0],
            y=tip[1],
            z=tip[2],
            tilt=math.atan2(-axis[1], axis[2]),
            lean=axis[0] / axis[2],
            yaw=math.atan2(peg[1, 0], peg[0, 0]),
        )
        block = expected.outlined_block(
            x=hole[0],
            y=hole[1],
            z=hole[2],
            tilt=0.0,
            lean=0.0,
            yaw=_mod_quarter(math.atan2(board[1, 0], board[0, 0])),
        )
        return Picture(
            image=image,
            camera=nominal,
            pose=pose,
            pressed=float(trial.compression_m[row]) - SAG_M,
            peg=true_peg,
            block=block,
            true_peg=true_peg.seen(really),
            true_block=block.seen(really),
            task=trial.task,
            peg_there=not missing,
        )


def _mod_quarter(yaw: float) -> float:
    """A square block turned by a quarter looks the same."""
    return (yaw + math.pi / 4) % (math.pi / 2) - math.pi / 4


def expectations(
    picture: Picture, random: np.random.Generator, *, first: bool
) -> tuple[Outlined, Outlined]:
    """Where peg and block are expected: before anything was seen, or about where they are."""
    knows_depth = random.uniform() < 0.6
    peg, block, pose = picture.peg, picture.block, picture.pose
    x = peg.x + 0.001 * random.standard_normal() if knows_depth else pose.x
    lean = peg.lean + 0.008 * random.standard_normal() if knows_depth else 0.0
    board_x = block.x + 0.0015 * random.standard_normal() if knows_depth else 0.0
    turned = random.uniform() < 0.7
    yaw = block.yaw + math.radians(0.4) * random.standard_normal() if turned else 0.0
    if first:
        pressed = 0.005 if random.uniform() < 0.15 else picture.pressed
        expected_peg = expected.hanging_peg(picture.task, pose, pressed, x=x, lean=lean)
        offset = 0.003 * random.standard_normal(2)
        expected_block = replace(block, x=board_x, y=offset[0], z=offset[1], tilt=0.0, yaw=yaw)
        jitter = random.standard_normal(3) * (0.004, 0.002, math.radians(1.5))
        expected_peg = replace(
            expected_peg,
            y=expected_peg.y + jitter[0],
            z=expected_peg.z + jitter[1],
            tilt=expected_peg.tilt + jitter[2],
        )
        return expected_peg, expected_block
    about = []
    for thing, seen, sd_turn in (
        (replace(peg, x=x, lean=lean, yaw=pose.yaw), picture.true_peg, math.radians(1.5)),
        (replace(block, x=board_x, yaw=yaw), picture.true_block, math.radians(0.3)),
    ):
        spread = float(random.choice([0.3, 1.0, 3.0]))
        at = expected.moved(thing, picture.camera, seen.foot, 0.0)
        jitter = spread * random.standard_normal(3) * (0.0015, 0.0012, sd_turn)
        about.append(replace(at, y=at.y + jitter[0], z=at.z + jitter[1], tilt=at.tilt + jitter[2]))
    return about[0], about[1]


def samples(
    picture: Picture, random: np.random.Generator, *, first: bool
) -> Iterator[tuple[NDArray[np.uint8], list[float]]]:
    """What the network is shown of peg and block, with the labels."""
    peg, block = expectations(picture, random, first=first)
    seen_peg, seen_block = peg.seen(picture.camera), block.seen(picture.camera)
    pictures = Pictures.of(picture.image)
    for thing, other, true, frame, there in (
        (
            seen_peg,
            seen_block,
            picture.true_peg,
            expected.peg_frame(picture.camera, peg, seen_peg, first=first),
            picture.peg_there,
        ),
        (
            seen_block,
            seen_peg,
            picture.true_block,
            expected.block_frame(picture.camera, block, seen_block, first=first),
            picture.block_there,
        ),
    ):
        away = random.uniform() < 0.04
        if away:  # somewhere else: what is expected is not there
            far = random.uniform(0, math.tau)
            step = np.array([math.cos(far), math.sin(far)]) * random.uniform(90, 200) * frame.scale
            frame = replace(frame, centre=frame.centre + step)
            thing = replace(thing, foot=thing.foot + step, hull=thing.hull + step)
            other = replace(other, foot=other.foot + step, hull=other.hull + step)
        step = frame.way_in(true.foot - thing.foot)
        visible = there and bool(np.all(np.abs(step) < WITHIN))
        shown = expected.shown(pictures, frame, thing, other)
        yield shown, [step[0], step[1], true.tilt - thing.tilt, float(visible), float(first)]


def nothing(random: np.random.Generator) -> NDArray[np.uint8]:
    """A picture with nothing in it: plain, or noise."""
    level, sd = random.uniform(0, 255, 3), random.choice([0.0, 2.0, 8.0, 30.0])
    image = level + sd * random.standard_normal((c.IMAGE_SIZE[1], c.IMAGE_SIZE[0], 3))
    return np.clip(image, 0, 255).astype(np.uint8)


def make(
    path: Path, out: Path, worker: int, processes: int, pictures: int, seconds: float, first: int
) -> None:
    """One worker's part, as files that training reads: pictures (n, CHANNELS, SIZE, SIZE) and
    labels (n, LABELS)."""
    began = time.monotonic()
    cv2.setNumThreads(1)
    trials = states.load(path)
    mine = [n for n in range(len(trials)) if n % processes == worker]
    random = np.random.default_rng([first, worker])
    random.shuffle(mine)
    mine = mine[: max(1, pictures // LEAST_EACH)]
    scenes = Scenes(trials)
    n_rows = 2 * PER_THING * pictures
    shown = np.lib.format.open_memmap(
        out / f"shown-{worker}.npy",
        "w+",
        np.uint8,
        (n_rows, expected.CHANNELS, expected.SIZE, expected.SIZE),
    )
    labels = np.zeros((n_rows, LABELS), np.float32)
    rows = done = 0
    for turn, n in enumerate(mine):
        scenes.take(n)
        until, left = (turn + 1) / len(mine), seconds - (time.monotonic() - began)
        end = time.monotonic() + left / (len(mine) - turn)
        while done < until * pictures and time.monotonic() < end:
            seed = FIRST + (worker + processes * done + first) % (LAST - FIRST + 1)
            picture = scenes.picture(
                int(random.integers(len(scenes.trial.time_s))),
                "side" if random.uniform() < 0.6 else "front",
                seed,
                looks=random.uniform() < 0.93,
                occluder=random.uniform() < 0.35,
                missing=random.uniform() < 0.02,
            )
            if random.uniform() < 0.01:
                blank = nothing(random)
                picture = replace(picture, image=blank, peg_there=False, block_there=False)
            for k in range(PER_THING):
                for small, label in samples(picture, random, first=k == 0):
                    shown[rows], labels[rows] = small, label
                    rows += 1
            done += 1
    shown.flush()
    np.save(out / f"labels-{worker}.npy", labels[:rows])
    print(f"worker {worker}: {done} pictures in {time.monotonic() - began:.0f} s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("states", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pictures", type=int, default=60_000)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seconds", type=float, default=1e9, help="stop after that long")
    parser.add_argument("--first", type=int, default=0, help="of the seeds of looks, from 300000")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    each = math.ceil(given.pictures / given.processes)
    context = multiprocessing.get_context("spawn")
    workers = [
        context.Process(
            target=make,
            args=(given.states, given.out, n, given.processes, each, given.seconds, given.first),
        )
        for n in range(given.processes)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    if failed := [n for n, worker in enumerate(workers) if worker.exitcode]:
        raise SystemExit(f"workers {failed} failed")


if __name__ == "__main__":
    main()
