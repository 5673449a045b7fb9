"""`pliant calibrate`: the camera, the wrist and the colours of a cell, found by the cell itself."""

import math
import sys
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
import tyro
from rich.text import Text

from pliant import conditions, files, pictures
from pliant.calibration import camera as camera_calibration
from pliant.calibration import colours as colour_calibration
from pliant.calibration import file, tour
from pliant.calibration import wrist as wrist_calibration
from pliant.calibration.outline import peg_points, project
from pliant.cell import Camera, Image, Robot
from pliant.cli.cells import opened, where
from pliant.conditions import Setup
from pliant.console import Console
from pliant.envelope import Guarded
from pliant.errors import InputError, PliantError, RobotFault
from pliant.experiment.where import Where
from pliant.paths import shown
from pliant.pose import angles_from
from pliant.task import Task, load_task
from pliant.vision.measure import Colours

What = Literal["all", "camera", "wrist", "colours"]

_COLOUR_STOPS = (1, 6, 8, 13)  # of the tour: the peg at other places, in other light
_MOST_COLUMNS = 96  # columns of the picture in a terminal, at most


class _Refused(PliantError):
    """The error that a calibration is too poor to be used."""


Pixel = Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="COLUMN ROW")]


def calibrate(
    what: Annotated[What, tyro.conf.Positional] = "all",
    *,
    cell: str = "sim",
    peg: str = "circle",
    peg_at: Pixel = None,
    block_at: Pixel = None,
    condition: str = "none",
    seed: int = 1,
    write: bool = True,
    out: Path = Path("runs/calibration"),
) -> int:
    """Calibrate a cell and write what was found into its file; too poor a result is refused.

    The arm moves: above the board for the camera and the colours, onto it for the wrist.

    Args:
        what: camera, wrist, colours, or all of them.
        cell: sim, or the path of a cell's file.
        peg: the peg in the gripper: circle, square, rectangle, or the path of a peg file (.yaml).
        peg_at: column and row of a pixel of the peg in the first picture; default: asks.
        block_at: the same, of the block with the hole.
        condition: none, friction, pose or all: what is drawn at random in a simulated or emulated
            cell, which calibration does not know. A real cell is calibrated as nominally set up.
        seed: decides every drawn quantity.
        write: put what was found into the cell's file.
        out: the folder for the pictures to look at.
    """
    from pliant.commissioning.attending import AtTerminal

    task, chosen = load_task(peg), where(cell)
    setup = _setup(chosen, condition, seed)
    if what in ("all", "colours") and not sys.stdin.isatty() and not (peg_at and block_at):
        raise InputError(
            "colours are picked in a terminal, and this is none: give --peg-at and --block-at, each"
            " with a column and a row of the picture"
        )
    console = Console(highlight=False, soft_wrap=True)
    session = _Session(console=console, chosen=chosen, task=task, write=write, out=out)
    try:
        with opened(chosen, AtTerminal(console)) as workcell:
            console.print("preparing the cell ...")
            with workcell.prepare(task, setup) as robot:
                session.run(what, robot, peg_at, block_at)
    except RobotFault as fault:
        console.print(f"{fault.end_reason}: {fault}")
        return 1
    except _Refused as refusal:
        console.print(f"refused: {refusal}")
        return 1
    return 0


def _setup(chosen: Where, condition: str, seed: int) -> Setup:
    drawn = conditions.condition(condition)
    if chosen.kind == "ur5e" and drawn.quantities:
        raise InputError(
            f"--condition {condition} draws what a real cell has as it is: leave it out, and set"
            " the hole and the peg up as nominal"
        )
    return drawn.draw(seed)


class _Session:
    """One call of the command: what is found is told, judged and written, part by part."""

    def __init__(
        self, *, console: Console, chosen: Where, task: Task, write: bool, out: Path
    ) -> None:
        self._console, self._chosen, self._task = console, chosen, task
        self._write, self._out = write, out
        self._colours = chosen.colours

    def run(
        self,
        what: What,
        robot: Robot,
        peg_at: tuple[int, int] | None,
        block_at: tuple[int, int] | None,
    ) -> None:
        guarded = Guarded(robot, self._chosen.limits)
        if what in ("all", "colours"):
            self._find_colours(guarded, peg_at, block_at)
        if what in ("all", "camera"):
            self._find_camera(guarded)
        if what in ("all", "wrist"):
            self._find_wrist(guarded)

    # --- colours ---------------------------------------------------------------------------------

    def _find_colours(
        self, robot: Guarded, peg_at: tuple[int, int] | None, block_at: tuple[int, int] | None
    ) -> None:
        self._say("colours: pick the peg and the block in the first picture")
        images = [robot.observe().views["side"].image]
        if not (peg_at and block_at):
            _print_picture(self._console, images[0])
        peg = self._picked(images[0], peg_at, "peg")
        block = self._picked(images[0], block_at, "block")
        for at in _COLOUR_STOPS:
            robot.move_to(
                tour.stops(self._task)[at],
                speed_m_s=tour.SPEED_M_S,
                stop_at_compression_m=tour.LIMIT_M,
            )
            robot.settle(1.0)
            images.append(robot.observe().views["side"].image)
        colours = Colours(
            peg=colour_calibration.widen(images, peg),
            block=colour_calibration.widen(images, block),
        )
        found = colour_calibration.evaluate(images, colours)
        for name, ranges, elsewhere in (
            ("peg", colours.peg, found.peg_elsewhere),
            ("block", colours.block, found.block_elsewhere),
        ):
            words = " and ".join(f"{low} to {high}" for low, high in ranges)
            self._say(f"  {name}: HSV {words}; {elsewhere:.1%} of the mask is elsewhere")
        self._keep("colours.png", colour_calibration.shown(images[-1], colours))
        self._judge("colours", found.problem())
        self._colours = colours
        self._put({"colours": {"peg": colours.peg, "block": colours.block}})

    def _picked(
        self, image: Image, at: tuple[int, int] | None, what: str
    ) -> colour_calibration.Ranges:
        while at is None:
            try:
                return colour_calibration.pick(image, *_asked(self._console, image, what), what)
            except InputError as error:
                self._say(f"  {error}")
        return colour_calibration.pick(image, *at, what)

    # --- camera ----------------------------------------------------------------------------------

    def _find_camera(self, robot: Guarded) -> None:
        self._say("camera: the arm carries the peg around above the board")
        taken = tour.travel(robot, self._task, self._colours, self._tell_picture)
        shots = [t.shot for t in taken if t.shot is not None]
        if not shots:
            raise InputError(
                "no picture shows the whole peg: turn the camera to the board, or pick the colours"
                " again (pliant calibrate colours)"
            )
        former = taken[0].view.camera
        found = camera_calibration.calibrate(shots, self._task, (former.width, former.height))
        self._tell_camera(found, former)
        worst = int(np.argmax(found.left_out_px))
        views = [t.view for t in taken if t.shot is not None]
        self._keep("camera.png", _with_outline(views[worst].image, shots[worst], found, self._task))
        self._judge("camera", found.problem())
        self._put(
            {
                "camera": {
                    "focal_px": round(found.camera.focal_px, 2),
                    "position_mm": [round(float(v) * 1e3, 2) for v in found.camera.position],
                    "rotation_deg": [
                        round(math.degrees(v), 4) for v in angles_from(found.camera.rotation)
                    ],
                }
            }
        )

    def _tell_picture(self, taken: tour.Taken) -> None:
        p = taken.pose
        at = f"y {p.y * 1e3:6.1f}, z {p.z * 1e3:6.1f} mm, roll {math.degrees(p.roll):6.1f} deg"
        self._say(f"  {at}: {taken.problem or 'measured'}")

    def _tell_camera(self, found: camera_calibration.CameraFound, former: Camera) -> None:
        camera, hang = found.camera, found.hang
        place = ", ".join(f"{v * 1e3:.1f}" for v in camera.position)
        turn = ", ".join(f"{math.degrees(v):.2f}" for v in angles_from(camera.rotation))
        y, z = (sd * 1e3 for sd in found.sd_at_hole_m)
        self._say(f"  focal length {camera.focal_px:.1f} px, at ({place}) mm, turned ({turn}) deg")
        self._say(
            f"  {len(found.rms_px)} pictures, outlines off by {found.total_rms_px:.2f} px (worst"
            f" {max(found.rms_px):.2f}); one left out, by at most {max(found.left_out_px):.2f} px"
        )
        self._say(f"  at the hole: y to {y:.2f} mm, z to {z:.2f} mm (one standard deviation)")
        self._say(
            f"  the peg: {math.degrees(hang.grasp_roll):.2f} deg in the grasp, its tip"
            f" {hang.reach * 1e3:+.1f} mm beyond nominal; the wrist sags {hang.sag * 1e3:.1f} mm"
        )
        whose = "the simulator's own" if self._chosen.kind == "sim" else "the one before"
        self._say(f"  {whose} differs by at most {_difference(camera, former)}")

    # --- wrist -----------------------------------------------------------------------------------

    def _find_wrist(self, robot: Guarded) -> None:
        given = self._chosen.configuration
        believed = (
            self._task.wrist.stiffness_z if given is None else given.wrist.stiffness_n_mm * 1e3
        )
        self._say("wrist: the arm presses the peg on the board beside the hole, three times")
        found = wrist_calibration.evaluate(wrist_calibration.press(robot, self._task), believed)
        self._say(
            f"  {found.stiffness_n_m * 1e-3:.3f} ± {found.sd_n_m * 1e-3:.3f} N/mm (believed"
            f" {believed * 1e-3:.3f})"
        )
        self._say(
            f"  off a line by {found.bend:.1%} of the force, pressing and releasing"
            f" {found.hysteresis:.1%} apart; it touches with the hinge at {found.touch_m * 1e3:.1f}"
            f" mm, {(found.touch_m - self._task.tip_below_hinge) * 1e3:+.1f} mm from nominal"
        )
        self._judge("wrist", found.problem())
        self._put({"wrist": {"stiffness_n_mm": round(found.stiffness_n_m * 1e-3, 4)}})

    # --- what becomes of it ----------------------------------------------------------------------

    def _judge(self, name: str, problem: str | None) -> None:
        if problem is not None:
            raise _Refused(f"{name}: {problem}")

    def _put(self, fields: file.Fields) -> None:
        path = self._chosen.file
        if path is None or not self._write:
            return
        for line in file.put(path, fields):
            self._say(f"  {line}")
        self._say(f"  written to {shown(path)}")

    def _keep(self, name: str, image: Image) -> None:
        path = self._out / name
        before = ", in the place of the one before" if path.exists() else ""
        files.write_bytes(path, pictures.encoded(image))
        self._say(f"  look at {path}{before}")

    def _say(self, text: str) -> None:
        self._console.print(Text(text))


def _difference(camera: Camera, other: Camera) -> str:
    """The greatest difference between two calibrations [px, mm], in words, over the space above the
    board where the peg goes."""
    grid = np.array(
        [
            (x, y, z)
            for x in (-0.02, 0.02, 0.06)
            for y in (-0.06, 0.0, 0.06)
            for z in (0.0, 0.05, 0.1)
        ]
    )
    off = np.linalg.norm(project(camera, grid) - project(other, grid), axis=1)
    most = float(np.max(off))
    return f"{most:.2f} px, {most * camera.metres_per_pixel(0.0) * 1e3:.2f} mm, above the board"


def _with_outline(
    image: Image,
    shot: camera_calibration.CalibrationShot,
    found: camera_calibration.CameraFound,
    task: Task,
) -> Image:
    """The picture, four times as large, with the outline that the calibration expects."""
    scale = 4
    result = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    corners = project(found.camera, peg_points(task, shot.pose, found.hang)).astype(np.float32)
    hull = np.round(cv2.convexHull(corners) * scale).astype(np.int32)
    cv2.polylines(result, [hull], True, (255, 255, 0), 1)
    return result.astype(np.uint8)


# --- the picture in a terminal -------------------------------------------------------------------


def _cells(console: Console, image: Image) -> tuple[int, int]:
    """Columns and rows of the picture in the terminal; a row is two pixels high."""
    columns = max(32, min(_MOST_COLUMNS, console.width - 4))
    height, width = image.shape[:2]
    return columns, max(1, round(columns * height / width / 2))


def _print_picture(console: Console, image: Image) -> None:
    columns, rows = _cells(console, image)
    small = cv2.resize(image, (columns, 2 * rows), interpolation=cv2.INTER_AREA)
    tens = "".join(f"{10 * i:<10d}" for i in range(columns // 10 + 1))[:columns]
    console.print(Text(f"   {tens}"))
    for row in range(rows):
        line = Text(f"{row:2d} ")
        for column in range(columns):
            upper, lower = (
                "#{:02x}{:02x}{:02x}".format(*small[2 * row + i, column]) for i in (0, 1)
            )
            line.append("▀", style=f"{upper} on {lower}")
        console.print(line)


def _asked(console: Console, image: Image, what: str) -> tuple[int, int]:
    """The pixel that a person names by the printed picture's column and row."""
    columns, rows = _cells(console, image)
    try:
        answer = console.input(f"middle of the {what}: column,row = ")
        column, row = (int(part) for part in answer.replace(",", " ").split())
    except EOFError as error:
        raise KeyboardInterrupt from error
    except ValueError as error:
        raise InputError(
            f"two numbers are needed, 0 to {columns - 1} and 0 to {rows - 1}, not '{answer}'"
        ) from error
    height, width = image.shape[:2]
    return int((column + 0.5) * width / columns), int((row + 0.5) * height / rows)
