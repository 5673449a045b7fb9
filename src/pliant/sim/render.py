"""Pictures of the simulated cell, from calibrated cameras."""

import math
import weakref
from itertools import pairwise

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


class Cameras:
    """Draws a model's cameras. The renderer is made at the first picture and kept.

    `enlarged` draws images that many times as wide and high; the model must allow it.
    """

    def __init__(self, model: mujoco.MjModel, *, enlarged: int = 1) -> None:
        self._model = model
        self._size = c.IMAGE_SIZE[0] * enlarged, c.IMAGE_SIZE[1] * enlarged
        self._renderer: mujoco.Renderer | None = None
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

    def image(self, name: str, data: mujoco.MjData) -> NDArray[np.uint8]:  # (height, width, 3)
        """The picture that the camera sees, without noise."""
        renderer = self._ready()
        renderer.update_scene(data, camera=name, scene_option=self._options)
        scene = renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        for k in range(SPRINGS):
            top, bottom = data.site(f"spring{k}_top").xpos, data.site(f"spring{k}_bottom").xpos
            _draw_spring(scene, bottom, top)
        looks.dress(self._looks, scene, self._model, name)
        return renderer.render().copy()

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
    """Draw a helix between two points, as short capsules that belong to the picture only."""
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
    for start, end in pairwise(points):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(
            geom,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            np.zeros(3),
            np.zeros(3),
            np.eye(3).ravel(),
            _SPRING_RGBA,
        )
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, _WIRE_RADIUS, start, end)
        scene.ngeom += 1
