"""The task, which is what is inserted into what: nominal, so that a method may know all of it."""

import math
import os
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import NoReturn

from pliant import files, peg_file, polygon
from pliant.errors import InputError, unknown, within
from pliant.levels import INSERTED_DEPTH_M, Level, load_level
from pliant.paths import located
from pliant.peg_file import LENGTHS_MM
from pliant.polygon import Outline

_SQUARE_ON = 0.9  # cosine of how far a flat side may be turned from the camera
BLOCK_SIZE = (0.12, 0.12, 0.14)  # x, y, z [m]; the published board is a block with the hole in it
_CENTRED_MM = 0.05  # of a peg's middle along y from its axis
_WIDEST = (0.1, 0.085)  # x, y [m] of a peg: the fingers, which close along y, open 85 mm
_FINGERS_BELOW_GRASP = 0.038  # [m] at most, however wide the peg is
_LEAST_CLEARANCE = 0.0001  # [m]: simulated contacts give way by up to a tenth of a millimetre

Place = tuple[float, float]
"""The place of an edge of the peg, y and x from its axis [m]."""


@dataclass(frozen=True, kw_only=True)
class Peg:
    """A straight peg: a disc of `radius`, or a polygon `outline`, times `length` [m].

    The outline is in the peg's frame, x away from the robot and y along the insertion plane,
    counter-clockwise around the peg's axis at the origin. It is convex, or else every ray from the
    axis crosses it once. The fingers close along y, evenly around the axis, so it reaches as far to
    either side.

    Raises:
        InputError: the outline is not such a polygon, or a size cannot be built.
    """

    name: str
    radius: float | None = None
    outline: Outline = ()
    length: float = 0.09

    def __post_init__(self) -> None:
        if (self.radius is None) == (not self.outline):
            raise InputError(f"peg '{self.name}': give either a radius or an outline")
        if self.radius is not None and not 0.001 <= self.radius <= _WIDEST[1] / 2:
            self._refuse(
                "radius",
                f"radius {self.radius * 1e3:g} mm; it must be 1 to {_WIDEST[1] / 2 * 1e3:g} mm,"
                " which the fingers open to",
            )
        if not LENGTHS_MM[0] * 1e-3 <= self.length <= LENGTHS_MM[1] * 1e-3:
            least, most = LENGTHS_MM
            told = f"length {self.length * 1e3:g} mm; it must be {least} to {most} mm"
            self._refuse("length", told)
        if self.outline and (fault := polygon.fault_of(self.outline)):
            self._refuse("outline", fault)
        for axis, half, widest in zip("xy", self.half_extents, _WIDEST, strict=True):
            if not 0.002 <= 2 * half <= widest:
                told = f"{2e3 * half:g} mm along {axis}; it must be 2 to {1e3 * widest:g} mm"
                self._refuse(axis, told + (", which the fingers open to" if axis == "y" else ""))
        if self.outline:
            ys = [1e3 * y for _, y in self.outline]
            if abs(min(ys) + max(ys)) > _CENTRED_MM:
                self._refuse(
                    "outline",
                    f"its corners lie from {min(ys):g} to {max(ys):g} mm along y; the fingers close"
                    f" evenly around the axis: add {-(min(ys) + max(ys)) / 2:g} mm to every y",
                )

    def _refuse(self, place: str, problem: str) -> NoReturn:
        with within(place):
            raise InputError(f"peg '{self.name}': {problem}")

    def grown(self, margin: float) -> Outline:
        """The polygon's corners with every edge moved outward by `margin` [m]."""
        return polygon.grown(self.outline, margin)

    @property
    def half_extents(self) -> tuple[float, float]:
        """The distances [m] that the peg reaches from its axis along x and y."""
        if self.radius is not None:
            return self.radius, self.radius
        xs, ys = zip(*self.outline, strict=True)
        return max(map(abs, xs)), max(map(abs, ys))

    @property
    def silhouette_x(self) -> float:
        """The x [m] of the peg's outline as the side camera sees it, halfway between its two edges:
        a cylinder's is at its axis, a box's at its front face."""
        (_, left), (_, right) = self.silhouette()
        return (left + right) / 2

    def silhouette(
        self, yaw: float = 0.0, *, slopes: tuple[float, float] = (0.0, 0.0)
    ) -> tuple[Place, Place]:
        """Places (y, x) [m] from the axis of the left and of the right edge that a camera at +x
        sees of the peg turned by `yaw` [rad] about its axis.

        `slopes` are those of the camera's rays to the left and to the right edge: metres along y
        for a metre away from the camera. They decide which of two corners, one behind the other,
        is the edge; with slope 0 it is the nearer.
        """
        if self.radius is not None:
            return (-self.radius, 0.0), (self.radius, 0.0)
        turned = polygon.turned(self.outline, yaw)
        # y where the ray through (x, y) meets the plane x = 0; within rounding the nearer is seen
        left = min(turned, key=lambda p: (round(p[1] + slopes[0] * p[0], 9), -p[0]))
        right = max(turned, key=lambda p: (round(p[1] + slopes[1] * p[0], 9), p[0]))
        return (left[1], left[0]), (right[1], right[0])

    def face(self, yaw: float = 0.0) -> tuple[Place, Place] | None:
        """Places (y, x) [m] from the axis of the left and of the right edge of the flat side that a
        camera at +x sees nearly square on; None: it has no such side."""
        if self.radius is not None:
            return None
        for (ax, ay), (bx, by) in polygon.edges(polygon.turned(self.outline, yaw)):
            middle_x, length = (ax + bx) / 2, math.hypot(bx - ax, by - ay)
            if middle_x > 0.0 and abs(by - ay) > _SQUARE_ON * length:
                left, right = sorted(((ay, ax), (by, bx)))
                return left, right
        return None

    def front(self, within: float, yaw: float = 0.0) -> float:
        """Greatest x [m] of the peg turned by `yaw` [rad], where y is at most `within` [m] from
        the axis: what a camera at +x sees in the middle of the top edge."""
        if self.radius is not None:
            return self.radius
        turned = polygon.turned(self.outline, yaw)
        found = [x for x, y in turned if abs(y) <= within]
        for (ax, ay), (bx, by) in polygon.edges(turned):
            for y in (-within, within):
                if (ay - y) * (by - y) < 0:
                    found.append(ax + (bx - ax) * (y - ay) / (by - ay))
        return max(found)


@dataclass(frozen=True, kw_only=True)
class Hole:
    """The peg's outline grown by half the `clearance` all round, with a 45 degree `chamfer` [m].

    Raises:
        InputError: either is out of range.
    """

    clearance: float = 0.002
    chamfer: float = 0.0

    def __post_init__(self) -> None:
        if not _LEAST_CLEARANCE <= self.clearance <= 0.02:
            raise InputError(
                f"hole clearance {self.clearance * 1e3:g} mm: it must be"
                f" {_LEAST_CLEARANCE * 1e3:g} to 20 mm, the hole being wider than the peg by more"
                " than simulated contacts give way"
            )
        if not 0.0 <= self.chamfer <= 0.01:
            raise InputError(f"hole chamfer {self.chamfer * 1e3:g} mm: it must be 0 to 10 mm")


@dataclass(frozen=True, kw_only=True)
class Wrist:
    """The soft wrist: stiffness [N/m, N m/rad] and damping [N s/m, N m s/rad] per axis.

    The defaults are the four published axes of Fuchioka et al. 2024, the simulator that the paper
    builds on. A lateral stiffness makes it six, as the real wrist has.

    Raises:
        InputError: a value is not above 0, or only one lateral stiffness is given.
    """

    stiffness_z: float = 1000.0
    stiffness_roll: float = 0.5
    stiffness_pitch: float = 0.5
    stiffness_yaw: float = 5.0
    stiffness_x: float | None = None
    stiffness_y: float | None = None
    damping_z: float = 1.0
    damping_roll: float = 0.005
    damping_pitch: float = 0.005
    damping_yaw: float = 1.0
    damping_x: float = 1.0
    damping_y: float = 1.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"wrist {f.name} is {value}: it must be above 0")
        if (self.stiffness_x is None) != (self.stiffness_y is None):
            raise InputError("wrist: give both stiffness_x and stiffness_y, or neither")


@dataclass(frozen=True, kw_only=True)
class Task:
    """The nominal task: what a method may know before it starts.

    Raises:
        InputError: the hole is too wide for the block, or the peg too short for the depth.
    """

    peg: Peg
    hole: Hole = field(default_factory=Hole)
    wrist: Wrist = field(default_factory=Wrist)
    depth: float = INSERTED_DEPTH_M  # to insert

    # Kinematics of the tool, below the hinge point [m] (Fuchioka et al. 2024).
    grasp_below_hinge: float = 0.099
    peg_top_above_grasp: float = 0.005

    def __post_init__(self) -> None:
        least = self.depth + _FINGERS_BELOW_GRASP + self.peg_top_above_grasp
        if self.peg.length < least:
            with within("length"):
                raise InputError(
                    f"peg '{self.peg.name}': length {self.peg.length * 1e3:g} mm; to go in by"
                    f" {self.depth * 1e3:g} mm before the fingers reach the board it must be at"
                    f" least {least * 1e3:g} mm"
                )
        margin = self.hole.clearance / 2 + self.hole.chamfer
        grown = self.peg.grown(margin)
        if grown and (closed := polygon.reversed_edge(self.peg.outline, grown)):
            raise InputError(
                f"peg '{self.peg.name}': its hole, {margin * 1e3:g} mm wider on each side, closes"
                f" at the edge from {polygon.spoken(*closed[0])} to {polygon.spoken(*closed[1])}"
                " mm: lengthen that edge, or lessen the clearance or the chamfer"
            )
        half = max((abs(v) for p in grown for v in p), default=(self.peg.radius or 0.0) + margin)
        if half > min(BLOCK_SIZE[:2]) / 2 - 0.01:
            raise InputError(
                f"peg '{self.peg.name}': its hole is {2e3 * half:g} mm wide; the block leaves room"
                f" for {2e3 * (min(BLOCK_SIZE[:2]) / 2 - 0.01):g} mm"
            )

    @property
    def tip_below_hinge(self) -> float:
        """The distance [m] from the hinge point to the centre of the peg's bottom face, grasp angle
        0."""
        return self.grasp_below_hinge - self.peg_top_above_grasp + self.peg.length

    @property
    def tip_below_grasp(self) -> float:
        """The distance [m] from the grasp to the centre of the peg's bottom face."""
        return self.peg.length - self.peg_top_above_grasp


# --- pegs are data -----------------------------------------------------------------------------


def shipped_pegs() -> list[str]:
    """Names that `load_task` takes beside a file's path."""
    return sorted(
        p.name.removesuffix(".yaml")
        for p in (resources.files("pliant") / "pegs").iterdir()
        if p.name.endswith(".yaml")
    )


def load_task(peg: str, level: str = "L0") -> Task:
    """The nominal task for a shipped peg's name or a peg file's path, on a level of the ladder. It
    tells the level's hole and depth, and not the level's name, which is the experiment's to know.

    Raises:
        InputError: the name is unknown, or the file is missing or broken.
    """
    return on_level(_load_peg(peg), load_level(level))


def located_peg(peg: str, folder: Path | None = None) -> str:
    """A peg as `load_task` takes it, whatever the current folder is: a peg file's path is made
    absolute, counting from `folder`. A shipped peg's name stays."""
    return str(located(peg, folder)) if _is_file(peg) else peg


def _is_file(peg: str) -> bool:
    return peg not in shipped_pegs() and Path(peg).suffix in (".yaml", ".yml")


def on_level(task: Task, level: Level) -> Task:
    """A task with the hole and the depth that a level asks for."""
    hole = task.hole
    if level.clearance is not None:
        hole = replace(hole, clearance=level.clearance)
    return replace(task, hole=hole, depth=level.depth)


def _load_peg(peg: str) -> Task:
    if peg in shipped_pegs():
        return _shipped_peg(peg)
    if not _is_file(peg):
        raise unknown("peg", peg, shipped_pegs(), "or the path of a peg file (.yaml)")
    path = located(peg)
    advice = f"start from {resources.files('pliant') / 'pegs' / 'circle.yaml'}"
    name = os.fsencode(path.stem).decode(errors="replace")  # whatever the locale makes of it
    return _peg_task(files.read_yaml(path, "peg file", advice), name)


@cache
def _shipped_peg(name: str) -> Task:
    content = (resources.files("pliant") / "pegs" / f"{name}.yaml").read_bytes()
    return _peg_task(files.parse_yaml(content, f"peg file '{name}'"), name)


def _peg_task(document: files.Document, name: str) -> Task:
    fields_given = document.fields()
    try:
        found = files.checked(document, peg_file.SHAPES)
        with document.at(("clearance_mm",)):
            hole = Hole(clearance=found.clearance_mm * 1e-3)
        with document.at(("chamfer_mm",)):
            hole = replace(hole, chamfer=found.chamfer_mm * 1e-3)
        try:
            length = found.length_mm * 1e-3
            peg = Peg(name=name, radius=found.radius, outline=found.outline, length=length)
            return Task(peg=peg, hole=hole)
        except InputError as error:
            names = peg_file.WRITTEN.get(str(error.place[0]), ()) if error.place else ()
            place = next((n for n in names if n in fields_given), "shape")
            raise document.error((place,), str(error)) from error
    except InputError as error:
        raise InputError(f"{error}{peg_file.metres(fields_given)}") from error
