"""What is inserted into what: nominal, so that a method may know all of it."""

import math
from dataclasses import dataclass, field, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from pliant.errors import InputError, unknown
from pliant.levels import Level, load_level

BLOCK_SIZE = (0.12, 0.12, 0.14)  # x, y, z [m]; the published board is a block with the hole in it


@dataclass(frozen=True, kw_only=True)
class Peg:
    """A straight peg: a disc of `radius`, or a convex polygon `outline`, times `length` [m].

    The outline is in the peg's frame, x away from the robot and y along the insertion plane,
    counter-clockwise around the peg's axis.

    Raises:
        InputError: the outline is not such a polygon, or a size cannot be built.
    """

    name: str
    radius: float | None = None
    outline: tuple[tuple[float, float], ...] = ()
    length: float = 0.09

    def __post_init__(self) -> None:
        if (self.radius is None) == (not self.outline):
            raise InputError(f"peg '{self.name}': give either a radius or an outline")
        if self.radius is not None and not 0.001 <= self.radius <= 0.05:
            raise InputError(
                f"peg '{self.name}': radius {self.radius * 1e3:g} mm; it must be 1 to 50 mm"
            )
        if not 0.06 <= self.length <= 0.2:
            raise InputError(
                f"peg '{self.name}': length {self.length * 1e3:g} mm; it must be 60 to 200 mm"
            )
        if self.outline and not _is_convex_ccw(self.outline):
            raise InputError(
                f"peg '{self.name}': the outline must be a convex polygon, counter-clockwise"
            )
        for axis, half in zip("xy", self.half_extents, strict=True):
            if not 0.001 <= half <= 0.05:
                raise InputError(
                    f"peg '{self.name}': {2e3 * half:g} mm along {axis}; it must be 2 to 100 mm"
                )

    @property
    def half_extents(self) -> tuple[float, float]:
        """Half the peg's size along x and y [m]."""
        if self.radius is not None:
            return self.radius, self.radius
        xs, ys = zip(*self.outline, strict=True)
        return max(map(abs, xs)), max(map(abs, ys))

    @property
    def silhouette_x(self) -> float:
        """x of the peg's outline as the side camera sees it [m]: a cylinder's is at its axis, a
        prism's at its front face."""
        return 0.0 if self.radius is not None else self.half_extents[0]


@dataclass(frozen=True, kw_only=True)
class Hole:
    """The peg's outline grown by half the `clearance` all round, with a 45 degree `chamfer` [m].

    Raises:
        InputError: either is out of range.
    """

    clearance: float = 0.002
    chamfer: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.clearance <= 0.02:
            raise InputError(
                f"hole clearance {self.clearance * 1e3:g} mm: it must be above 0 and at most 20 mm,"
                " the hole being wider than the peg"
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
        InputError: the hole is too wide for the block.
    """

    peg: Peg
    hole: Hole = field(default_factory=Hole)
    wrist: Wrist = field(default_factory=Wrist)
    level: str = "L0"
    depth: float = 0.010  # of insertion, of the bottom face's centre [m]; the paper's criterion

    # Kinematics of the tool, below the hinge point [m] (Fuchioka et al. 2024).
    grasp_below_hinge: float = 0.099
    peg_top_above_grasp: float = 0.005

    def __post_init__(self) -> None:
        half = max(self.peg.half_extents) + self.hole.clearance / 2 + self.hole.chamfer
        if half > min(BLOCK_SIZE[:2]) / 2 - 0.01:
            raise InputError(
                f"peg '{self.peg.name}': its hole is {2e3 * half:g} mm wide; the block leaves room"
                f" for {2e3 * (min(BLOCK_SIZE[:2]) / 2 - 0.01):g} mm"
            )

    @property
    def tip_below_hinge(self) -> float:
        """From the hinge point to the centre of the peg's bottom face, ungrasped angle 0 [m]."""
        return self.grasp_below_hinge - self.peg_top_above_grasp + self.peg.length

    @property
    def tip_below_grasp(self) -> float:
        """From the grasp to the centre of the peg's bottom face [m]."""
        return self.peg.length - self.peg_top_above_grasp


# --- pegs are data -----------------------------------------------------------------------------


def shipped_pegs() -> list[str]:
    """Names that `load_task` takes beside a file's path."""
    return sorted(
        p.name.removesuffix(".yaml")
        for p in (files("pliant") / "pegs").iterdir()
        if p.name.endswith(".yaml")
    )


def load_task(peg: str, level: str = "L0") -> Task:
    """The nominal task for a shipped peg's name or a peg file's path, on a level of the ladder.

    Raises:
        InputError: the name is unknown, or the file is missing or broken.
    """
    return on_level(_load_peg(peg), load_level(level))


def on_level(task: Task, level: Level) -> Task:
    """A task with the hole and the depth that a level asks for."""
    hole = task.hole
    if level.clearance is not None:
        hole = replace(hole, clearance=level.clearance)
    return replace(task, hole=hole, depth=level.depth, level=level.name)


def _load_peg(peg: str) -> Task:
    if peg in shipped_pegs():
        text = (files("pliant") / "pegs" / f"{peg}.yaml").read_text()
        return _parse_peg(text, peg)
    path = Path(peg)
    if path.suffix not in (".yaml", ".yml"):
        raise unknown("peg", peg, shipped_pegs(), "or the path of a peg file (.yaml)")
    try:
        text = path.read_text()
    except OSError as error:
        raise InputError(f"peg file '{peg}' cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"peg file '{peg}' is not text: it must be YAML in UTF-8") from error
    return _parse_peg(text, path.stem)


def _parse_peg(text: str, name: str) -> Task:
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        first = str(error).splitlines()[0]
        raise InputError(f"peg file '{name}' is not YAML: {first}") from error
    if not isinstance(data, dict):
        raise InputError(f"peg file '{name}' holds no fields; see the shipped circle.yaml")
    data = dict(data)
    shape = data.pop("shape", None)
    length = _millimetres(data, "length_mm", name, 90.0)
    hole = Hole(
        clearance=_millimetres(data, "clearance_mm", name, 2.0),
        chamfer=_millimetres(data, "chamfer_mm", name, 0.0),
    )
    if shape == "circle":
        peg = Peg(name=name, radius=_millimetres(data, "diameter_mm", name) / 2, length=length)
    elif shape == "rectangle":
        sx = _millimetres(data, "size_x_mm", name) / 2
        sy = _millimetres(data, "size_y_mm", name) / 2
        corners = ((-sx, -sy), (sx, -sy), (sx, sy), (-sx, sy))
        peg = Peg(name=name, outline=corners, length=length)
    else:
        raise unknown("shape", shape, ("circle", "rectangle"), f"in peg file '{name}'")
    if data:
        raise InputError(
            f"peg file '{name}': unknown field '{next(iter(data))}' for shape '{shape}'"
        )
    return Task(peg=peg, hole=hole)


def _millimetres(data: dict[str, Any], key: str, name: str, default: float | None = None) -> float:
    value = data.pop(key, default)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    signed = key in ("clearance_mm", "chamfer_mm")  # judged by Hole
    if not (number and (-1e4 if signed else 0.0) < value < 1e4):
        raise InputError(
            f"peg file '{name}': {key} is {value!r}; it must be a number of millimetres above 0"
        )
    return float(value) * 1e-3


def _is_convex_ccw(outline: tuple[tuple[float, float], ...]) -> bool:
    n = len(outline)
    if n < 3:
        return False
    turning = 0.0
    for i in range(n):
        (ax, ay), (bx, by), (cx, cy) = outline[i], outline[(i + 1) % n], outline[(i + 2) % n]
        cross = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
        if cross <= 0:
            return False
        turning += math.atan2(cross, (bx - ax) * (cx - bx) + (by - ay) * (cy - by))
    return math.isclose(turning, math.tau)  # a star turns more than once
