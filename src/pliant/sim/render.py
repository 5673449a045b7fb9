"""Pictures of the simulated cell, from calibrated cameras."""

import math
import weakref
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise, product

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera, View
from pliant.conditions import Setup
from pliant.errors import InputError, unknown
from pliant.sim import constants as c
from pliant.sim import looks
from pliant.sim.gl import INSTALL, must_draw
from pliant.sim.model import SPRINGS

CAMERAS = c.CAMERAS
_COILS, _SEGMENTS_PER_COIL, _COIL_RADIUS, _WIRE_RADIUS = 5, 10, 0.0065, 0.0011
_SPRING_RGBA = np.array([0.85, 0.65, 0.15, 1.0], np.float32)
_ROUND = mujoco.mjtGeom.mjGEOM_CYLINDER
_ENDS = ("bottom", "top")  # of a spring
_UNSEEN = 5  # a geom group that is not drawn
_BEYOND = 0.02  # of its distance, how far outside a picture a thing is drawn: cameras shift


@dataclass(frozen=True, kw_only=True, eq=False)
class _Drawn:
    """A picture (height, width, 3) with its depths (height, width), more where it is nearer; rows
    go up, as OpenGL's do."""

    picture: NDArray[np.uint8]
    depths: NDArray[np.float32]

    def behind(self, nearer: "_Drawn") -> NDArray[np.uint8]:
        """This picture with another before it, rows going down."""
        hidden = (nearer.depths < self.depths).view(np.uint8)
        return np.asarray(cv2.flip(cv2.copyTo(self.picture, hidden, nearer.picture), 0), np.uint8)


class _Renderer(mujoco.Renderer):  # type: ignore[misc]
    """A renderer that tells the depths with a picture, as OpenGL has them."""

    def upload(self, meshes: Iterable[int]) -> None:
        """Take a model's meshes as they are now."""
        self._gl_context.make_current()
        for mesh in meshes:
            mujoco.mjr_uploadMesh(self._model, self._mjr_context, mesh)

    def drawn(self) -> _Drawn:
        self._gl_context.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._mjr_context)
        picture = np.empty((self._height, self._width, 3), np.uint8)
        depths = np.empty((self._height, self._width), np.float32)
        mujoco.mjr_readPixels(picture, depths, self._rect, self._mjr_context)
        return _Drawn(picture=picture, depths=depths)


class Cameras:
    """Draws a model's cameras. The renderer is made at the first picture and kept.

    What a camera cannot see is left out. `enlarged` draws images that many times as wide and high;
    the model must allow it. Where edges are not smoothed, the sky and what stands still are drawn
    once for each camera, and what moves is laid over them by its depths, in less time.
    """

    def __init__(self, model: mujoco.MjModel, *, enlarged: int = 1) -> None:
        self._model = model
        self._size = c.IMAGE_SIZE[0] * enlarged, c.IMAGE_SIZE[1] * enlarged
        self._renderer: _Renderer | None = None
        self._corners = _corners(model)
        self._still = model.body_weldid[model.geom_bodyid] == 0
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = 0
        self._calibrations = {name: _calibration(model, name) for name in CAMERAS}
        self.dress(Setup(seed=0))

    def dress(self, setup: Setup) -> None:
        """Let everything look as a trial's setup says, from the next picture on."""
        self._setup, self._looks = setup, looks.looks_of(setup)
        self._behind: dict[str, tuple[bytes, _Drawn]] = {}

    def view(self, name: str, data: mujoco.MjData, time_s: float) -> View:
        """A picture now, with the camera's nominal calibration.

        Raises:
            InputError: no camera has that name, or there is no OpenGL.
        """
        if name not in self._calibrations:
            raise unknown("camera", name, CAMERAS)
        random = self._setup.stream(f"noise of {name} at {time_s:.3f} s")
        image = looks.noisy(self._looks, self.image(name, data), random)
        return View(camera=self._calibrations[name], time_s=time_s, image=image)

    def image(self, name: str, data: mujoco.MjData) -> NDArray[np.uint8]:  # (height, width, 3)
        """The picture that the camera sees, without noise."""
        turns = data.geom_xmat.reshape(-1, 3, 3)
        places = data.geom_xpos[:, None] + self._corners @ turns.transpose(0, 2, 1)
        seen = self._in_view(name, data, places)
        if self._looks.paints or self._model.vis.quality.offsamples > 1:
            self._update(name, data, seen)
            self._add(name, data)
            return self._ready().render().copy()
        known = places[self._still].tobytes()
        if name not in self._behind or self._behind[name][0] != known:
            self._update(name, data, seen & self._still)
            looks.dress(self._looks, self._ready().scene, self._model, name)
            self._behind[name] = known, self._ready().drawn()
        self._update(name, data, seen & ~self._still)
        self._add(name, data)
        self._ready().scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        return self._behind[name][1].behind(self._ready().drawn())

    def upload(self, meshes: Iterable[int]) -> None:
        """Draw some of the model's meshes as they are now, from the next picture on."""
        self._behind.clear()
        self._ready().upload(meshes)

    def _update(self, name: str, data: mujoco.MjData, shown: NDArray[np.bool_]) -> None:
        """Set the scene: the geoms that are shown (ngeom,), before the sky."""
        renderer, groups = self._ready(), self._model.geom_group
        known = groups.copy()
        groups[~shown] = _UNSEEN
        renderer.update_scene(data, camera=name, scene_option=self._options)
        groups[:] = known
        flags = renderer.scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not self._looks.paints  # behind a backdrop

    def _add(self, name: str, data: mujoco.MjData) -> None:
        """Add to the scene what only shows: the springs, and the trial's looks."""
        scene = self._ready().scene
        ends = np.array(
            [[data.site(f"spring{k}_{end}").xpos for end in _ENDS] for k in range(SPRINGS)]
        )
        for bottom, top in ends[self._in_view(name, data, ends)]:
            _draw_spring(scene, bottom, top)
        looks.dress(self._looks, scene, self._model, name)

    def _in_view(
        self, name: str, data: mujoco.MjData, points: NDArray[np.float64]
    ) -> NDArray[np.bool_]:  # (n,)
        """Which things, each within the hull of its points (n, m, 3) [m], a camera may see."""
        camera = self._model.camera(name).id
        seen = (points - data.cam_xpos[camera]) @ data.cam_xmat[camera].reshape(3, 3)
        beyond = seen @ self.borders(name).T > 0  # (n, m, 4)
        return np.asarray(~beyond.all(axis=-2).any(axis=-1))

    def borders(self, name: str) -> NDArray[np.float64]:  # (4, 3)
        """Outward normals, on a camera's axes (right, up, back), of planes through it that are a
        little beyond its picture's borders."""
        up = math.tan(math.radians(float(self._model.camera(name).fovy[0])) / 2)
        aside = up * c.IMAGE_SIZE[0] / c.IMAGE_SIZE[1] + _BEYOND
        up += _BEYOND
        return np.array([[1.0, 0.0, aside], [-1.0, 0.0, aside], [0.0, 1.0, up], [0.0, -1.0, up]])

    def close(self) -> None:
        if self._renderer is not None:
            self._closing()
            self._renderer = None

    def _ready(self) -> _Renderer:
        if self._renderer is None:
            width, height = self._size
            must_draw()
            try:
                self._renderer = _Renderer(self._model, height, width, max_geom=1000)
            except Exception as error:  # the back ends raise what they like
                raise InputError(
                    f"OpenGL cannot draw ({error}): run '{INSTALL}' as root and set"
                    " MUJOCO_GL=osmesa"
                ) from error
            # Also when the program ends, before OpenGL is gone.
            self._closing = weakref.finalize(self, self._renderer.close)
        return self._renderer


def _corners(model: mujoco.MjModel) -> NDArray[np.float64]:  # (ngeom, 8, 3) [m]
    """The corners of the box around each geom, in its own frame."""
    middle, half = model.geom_aabb[:, None, :3], model.geom_aabb[:, None, 3:]
    return np.asarray(middle + half * np.array(list(product((-1.0, 1.0), repeat=3))))


def _calibration(model: mujoco.MjModel, name: str) -> Camera:
    width, height = c.IMAGE_SIZE
    camera = model.camera(name)
    fovy = math.radians(float(camera.fovy[0]))
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, camera.quat)
    right, up, back = matrix.reshape(3, 3).T
    return Camera(
        name=name,
        width=width,
        height=height,
        focal_px=height / 2 / math.tan(fovy / 2),
        position=camera.pos.copy(),
        rotation=np.column_stack([right, -up, -back]),
    )


def _draw_spring(
    scene: mujoco.MjvScene, bottom: NDArray[np.float64], top: NDArray[np.float64]
) -> None:
    """Draw a helix between two points, as short bars that belong to the picture only."""
    axis = top - bottom
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    other /= np.linalg.norm(other)
    s = np.linspace(0.0, 1.0, _COILS * _SEGMENTS_PER_COIL + 1)
    turn = math.tau * _COILS * s
    points = (
        bottom
        + s[:, None] * axis
        + _COIL_RADIUS * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other)
    )
    nowhere, unturned = np.zeros(3), np.eye(3).ravel()
    for start, end in pairwise(points):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, _ROUND, nowhere, nowhere, unturned, _SPRING_RGBA)
        mujoco.mjv_connector(geom, _ROUND, _WIRE_RADIUS, start, end)
        geom.type = mujoco.mjtGeom.mjGEOM_BOX  # of 12 triangles: a wire is two pixels wide
        scene.ngeom += 1
