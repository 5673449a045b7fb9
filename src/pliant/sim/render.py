"""Pictures of the simulated cell, from calibrated cameras."""

import math
import weakref
from itertools import pairwise, product

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.cell import Camera, View
from pliant.conditions import Setup
from pliant.errors import InputError, unknown
from pliant.sim import constants as c
from pliant.sim import looks
from pliant.sim.gl import INSTALL, let_go, must_draw
from pliant.sim.model import SPRINGS

CAMERAS = c.CAMERAS
_COILS, _SEGMENTS_PER_COIL, _COIL_RADIUS, _WIRE_RADIUS = 5, 10, 0.0065, 0.0011
_SPRING_RGBA = np.array([0.85, 0.65, 0.15, 1.0], np.float32)
_ROUND = mujoco.mjtGeom.mjGEOM_CYLINDER
_ENDS = ("bottom", "top")  # of a spring
_UNSEEN = 5  # a geom group that is not drawn
_BEYOND = 0.02  # of its distance, how far outside a picture a thing is drawn: cameras shift


class Cameras:
    """Draws a model's cameras. The renderer is made at the first picture and kept.

    What a camera cannot see is left out. `enlarged` draws images that many times as wide and high;
    the model must allow it.
    """

    def __init__(self, model: mujoco.MjModel, *, enlarged: int = 1) -> None:
        self._model = model
        self._size = c.IMAGE_SIZE[0] * enlarged, c.IMAGE_SIZE[1] * enlarged
        self._renderer: mujoco.Renderer | None = None
        self._corners = _corners(model)
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = 0
        self._calibrations = {name: _calibration(model, name) for name in CAMERAS}
        self.dress(Setup(seed=0))

    def dress(self, setup: Setup) -> None:
        """Let everything look as a trial's setup says, from the next picture on."""
        self._setup, self._looks = setup, looks.looks_of(setup)

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

    def image_at(
        self, name: str, data: mujoco.MjData, qpos: NDArray[np.floating]
    ) -> NDArray[np.uint8]:  # (height, width, 3)
        """The picture that the camera sees, without noise, of the cell with joints at `qpos`."""
        data.qpos[: len(qpos)] = qpos
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        return self.image(name, data)

    def image(self, name: str, data: mujoco.MjData) -> NDArray[np.uint8]:  # (height, width, 3)
        """The picture that the camera sees, without noise."""
        renderer, groups = self._ready(), self._model.geom_group
        turns = data.geom_xmat.reshape(-1, 3, 3)
        places = data.geom_xpos[:, None] + self._corners @ turns.transpose(0, 2, 1)
        shown = groups.copy()
        groups[~self._in_view(name, data, places)] = _UNSEEN
        renderer.update_scene(data, camera=name, scene_option=self._options)
        groups[:] = shown
        scene = renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not self._looks.paints  # behind a backdrop
        ends = np.array(
            [[data.site(f"spring{k}_{end}").xpos for end in _ENDS] for k in range(SPRINGS)]
        )
        for bottom, top in ends[self._in_view(name, data, ends)]:
            _draw_spring(scene, bottom, top)
        looks.dress(self._looks, scene, self._model, name)
        image = renderer.render().copy()
        let_go()
        return image

    def _in_view(
        self, name: str, data: mujoco.MjData, points: NDArray[np.float64]
    ) -> NDArray[np.bool_]:  # (n,)
        """Which things, each within the hull of its points (n, m, 3) [m], a camera may see."""
        camera = self._model.camera(name).id
        seen = (points - data.cam_xpos[camera]) @ data.cam_xmat[camera].reshape(3, 3)
        steep = math.tan(math.radians(float(self._model.cam_fovy[camera])) / 2)
        aspect = c.IMAGE_SIZE[0] / c.IMAGE_SIZE[1]
        reach = np.array([steep * aspect + _BEYOND, steep + _BEYOND]) * -seen[..., 2:]
        off = np.stack([seen[..., :2] - reach, -seen[..., :2] - reach])  # of each border
        return np.asarray(~(off > 0).all(axis=-2).any(axis=0).any(axis=-1))

    def close(self) -> None:
        if self._renderer is not None:
            self._closing()
            self._renderer = None

    def _ready(self) -> mujoco.Renderer:
        if self._renderer is None:
            width, height = self._size
            must_draw()
            try:
                self._renderer = mujoco.Renderer(self._model, height, width, max_geom=1000)
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
