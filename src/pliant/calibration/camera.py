"""The camera's calibration to the task frame from pictures of the peg at known poses of the arm.

No target is needed: the peg's size is known, the block's is, and the arm knows where it holds the
peg. What it does not know, how the peg hangs in the soft wrist and sits in the grasp, is found with
the camera. The peg's outline in each picture is compared with the one that the camera would see;
fingers that hide some of it are left out by the robust fit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from pliant.calibration.outline import Hang, Points, block_points, outside, peg_points, project
from pliant.cell import Camera
from pliant.errors import InputError
from pliant.pose import Pose
from pliant.task import BLOCK_SIZE, Task
from pliant.vision.least_squares import Unknown, Vector, minimise

LEAST_SHOTS = 8
WORST_RMS_PX = 0.6  # a sharp picture's staircase alone is 0.3
WORST_LEFT_OUT_PX = 1.2  # of a picture that took no part
WORST_AT_HOLE_M = 0.0005  # a quarter of the hole's clearance

_FOCAL_GUESSES = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6)  # in picture widths
_ROBUST_PX = (30.0, 8.0, 2.0, 1.0)
_EDGE_SD_PX = 0.3
_POINTS = 100  # of an outline
_EDGES = 4  # of an outline: its points share their errors along an edge
_SEEN = 0.75  # of an outline, whatever the fingers hide
_LEAN_SD = 0.001  # [rad] of a tool taken to hang straight: as good as a camera further along y
_FOOT = 0.12  # of the block's height from below: it may stand in something
_UNKNOWNS = 14


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibrationShot:
    """A picture's outlines [px] for the calibration, and the pose of the arm when it was taken."""

    pose: Pose
    peg: Points = field(repr=False)  # (n, 2)
    block: Points | None = field(repr=False, default=None)  # None: not wholly in the picture


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraFound:
    """The calibrated camera, what was found with it, and how good it is."""

    camera: Camera
    hang: Hang
    block_y: float  # [m]
    rms_px: tuple[float, ...]  # of each picture's outline
    left_out_px: tuple[float, ...]  # the same, of a calibration without that picture
    sd_at_hole_m: tuple[float, float]  # of y and z at the nominal hole

    @property
    def total_rms_px(self) -> float:
        return math.sqrt(float(np.mean(np.square(self.rms_px))))

    def problem(self) -> str | None:
        """Why the calibration is too poor to be used, and what to do; None: it is good."""
        others = float(np.median(self.rms_px))
        if max(self.left_out_px) > WORST_LEFT_OUT_PX and others <= WORST_RMS_PX:
            which = int(np.argmax(self.left_out_px)) + 1
            return (
                f"picture {which}, left out, is {max(self.left_out_px):.2f} px off, more than"
                f" {WORST_LEFT_OUT_PX} px: look whether the peg moved in the grasp, or still swung"
            )
        if self.total_rms_px > WORST_RMS_PX:
            return (
                f"the outlines are {self.total_rms_px:.2f} px off, more than {WORST_RMS_PX} px:"
                " check the peg's size, the tool centre point, focus and the colour ranges"
            )
        if max(self.sd_at_hole_m) > WORST_AT_HOLE_M:
            return (
                f"the hole's place is known to {max(self.sd_at_hole_m) * 1e3:.2f} mm only, worse"
                f" than {WORST_AT_HOLE_M * 1e3:.1f} mm: let the camera see more of the workspace,"
                " or bring it nearer"
            )
        return None


def calibrate(
    shots: Sequence[CalibrationShot], task: Task, size: tuple[int, int], *, leave_out: bool = True
) -> CameraFound:
    """Find the camera whose pictures have `size` (width, height).

    Raises:
        InputError: there are too few pictures, none shows the block, or no camera explains them.
    """
    if len(shots) < LEAST_SHOTS:
        raise InputError(
            f"{len(shots)} pictures show the whole peg; calibrating the camera takes"
            f" {LEAST_SHOTS}: turn the camera so that it sees the peg above the whole board"
        )
    block = next((shot.block for shot in shots if shot.block is not None), None)
    if block is None:
        raise InputError(
            "no picture shows the whole block, from whose top heights count: turn the camera, or"
            " pick the block's colour again (pliant calibrate colours)"
        )
    fit = _Fit(task, size, _start(shots, task, size), block)
    found = fit.solve(shots, np.zeros(_UNKNOWNS), _ROBUST_PX)
    camera, hang, block_y = fit.read(found)
    rms = tuple(fit.rms(found, shot) for shot in shots)
    left_out, spread = (
        _leave_one_out(fit, shots, found) if leave_out else (rms, (math.inf, math.inf))
    )
    return CameraFound(
        camera=camera,
        hang=hang,
        block_y=block_y,
        rms_px=rms,
        left_out_px=left_out,
        sd_at_hole_m=spread,
    )


def _leave_one_out(
    fit: "_Fit", shots: Sequence[CalibrationShot], found: Vector
) -> tuple[tuple[float, ...], tuple[float, float]]:
    """Each picture's rms [px] in a fit without it; the deviation of the hole's y and z [m], by the
    jackknife and by what it does not see: one lean of the tool and one edge of the block served all
    pictures."""
    camera = fit.read(found)[0]
    u, v = camera.project(np.zeros(3))
    rms, holes = [], []
    for i, shot in enumerate(shots):
        without = fit.solve([*shots[:i], *shots[i + 1 :]], found, _ROBUST_PX[-1:])
        rms.append(fit.rms(without, shot))
        holes.append(fit.read(without)[0].on_plane_x(u, v, 0.0))
    n = len(shots)
    y, z = (float(sd) * math.sqrt(n - 1) for sd in np.std(np.array(holes), axis=0))
    edge = _EDGE_SD_PX * camera.metres_per_pixel(0.0)
    return tuple(rms), (math.hypot(y, _LEAN_SD * fit.task.tip_below_hinge), math.hypot(z, edge))


# --- the model ------------------------------------------------------------------------------------


class _Fit:
    """The fit of a camera to the outlines. Its unknowns (14,): the camera's log focal length, place
    [m] and turn [rad] against the start, then reach, sag [m], droop, the grasp's roll and pitch
    [rad], the block's y [m], and how far a mask's boundary lies inside the true edge [px]."""

    def __init__(self, task: Task, size: tuple[int, int], start: Camera, block: Points) -> None:
        self.task, self._size, self._start = task, size, start
        v = block[:, 1]
        self._block = _thinned(block[v < np.max(v) - _FOOT * np.ptp(v)])  # without its foot

    def solve(
        self, shots: Sequence[CalibrationShot], at: Vector, robust: tuple[float, ...]
    ) -> Vector:
        pegs = [_thinned(shot.peg) for shot in shots]
        counts = [len(points) for points in (*pegs, self._block)]
        edges = [_EDGES] * len(pegs) + [_EDGES - 1]
        sds = np.concatenate(
            [np.full(n, _EDGE_SD_PX * math.sqrt(n / e)) for n, e in zip(counts, edges, strict=True)]
        )

        def residuals(x: Vector) -> Vector:
            camera, hang, block_y = self.read(x)
            parts = [
                outside(points, project(camera, peg_points(self.task, shot.pose, hang)))
                for points, shot in zip(pegs, shots, strict=True)
            ]
            parts.append(outside(self._block, project(camera, block_points(block_y))))
            return np.concatenate(parts) + x[13]

        return minimise(residuals, _unknowns(at), sds=sds, robust=robust)

    def read(self, x: Vector) -> tuple[Camera, Hang, float]:
        turn = cv2.Rodrigues(np.ascontiguousarray(x[4:7]))[0]
        width, height = self._size
        camera = replace(
            self._start,
            width=width,
            height=height,
            focal_px=self._start.focal_px * math.exp(float(np.clip(x[0], -2.0, 2.0))),
            position=self._start.position + x[1:4],
            rotation=self._start.rotation @ turn,
        )
        reach, sag, droop, roll, pitch, block_y = (float(v) for v in x[7:13])
        hang = Hang(reach=reach, sag=sag, droop=max(droop, 0.0), grasp_roll=roll, grasp_pitch=pitch)
        return camera, hang, block_y

    def rms(self, x: Vector, shot: CalibrationShot) -> float:
        """Rms distance [px] of the larger part of a picture's outline of the peg from the one
        expected: fingers may hide the rest."""
        camera, hang, _ = self.read(x)
        corners = project(camera, peg_points(self.task, shot.pose, hang))
        off = outside(_thinned(shot.peg), corners) + x[13]
        kept = np.sort(np.abs(off))[: math.ceil(_SEEN * len(off))]
        return math.sqrt(float(np.mean(kept**2)))


def _unknowns(at: Vector) -> list[Unknown]:
    """The fit's unknowns, starting `at`. Priors are wide: they hold what the pictures leave open,
    and nothing else."""
    camera = [Unknown(start=v) for v in at[:7]]
    reach, sag, droop, roll, pitch, block_y, inset = at[7:]
    wide = math.radians(5.0)
    return camera + [
        Unknown(start=reach, prior=0.0, prior_sd=0.010),
        Unknown(start=sag or 0.009, prior=0.009, prior_sd=0.005),
        Unknown(start=droop or 0.9, prior=0.9, prior_sd=0.9),
        Unknown(start=roll, prior=0.0, prior_sd=wide),
        Unknown(start=pitch, prior=0.0, prior_sd=math.radians(2.0)),
        Unknown(start=block_y, prior=0.0, prior_sd=0.02),
        Unknown(start=inset or 0.5, prior=0.5, prior_sd=0.5, step=1e-3),
    ]


def _thinned(points: Points) -> Points:
    return points[:: max(1, len(points) // _POINTS)]


# --- the start ------------------------------------------------------------------------------------


def _start(shots: Sequence[CalibrationShot], task: Task, size: tuple[int, int]) -> Camera:
    """A first camera, from the middles of the pegs alone, which are taken to hang as usual; several
    focal lengths are tried."""
    usual = Hang(sag=0.009, droop=0.9)
    middles = np.array([peg_points(task, shot.pose, usual).mean(axis=0) for shot in shots])
    pixels = np.array([cv2.minAreaRect(shot.peg.astype(np.float32))[0] for shot in shots])
    candidates = [_from_points(middles, pixels, size, f * size[0]) for f in _FOCAL_GUESSES]
    usable = [c for c in candidates if c is not None]
    if not usable:
        raise InputError(
            "no camera position explains where the peg is in the pictures: check the task frame and"
            " that the picture is not mirrored"
        )
    return min(usable, key=lambda c: c[0])[1]


def _from_points(
    points: Points, pixels: Points, size: tuple[int, int], focal_px: float
) -> tuple[float, Camera] | None:
    """The camera with a given focal length that sees `points` at `pixels`, as (rms [px], camera);
    None: it would not look at the board."""
    width, height = size
    matrix = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
    is_found, turn, shift = cv2.solvePnP(points, pixels, matrix, None, flags=cv2.SOLVEPNP_SQPNP)
    if not is_found:
        return None
    turn, shift = cv2.solvePnPRefineLM(points, pixels, matrix, None, turn, shift)
    # Its columns are the camera's axes in the task frame.
    rotation = np.asarray(cv2.Rodrigues(turn)[0].T, np.float64)
    camera = Camera(
        name="side",
        width=width,
        height=height,
        focal_px=focal_px,
        position=np.asarray(-rotation @ shift, np.float64).ravel(),
        rotation=rotation,
    )
    if camera.position[0] < BLOCK_SIZE[0] / 2:
        return None
    off = project(camera, points) - pixels
    return math.sqrt(float(np.mean(np.sum(off**2, axis=1)))), camera
