"""What is left out of a picture, or drawn with less, so that it is drawn faster, changes nothing
that counts."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from stand_ins import prepared, stand_peg

from pliant.conditions import Setup, condition
from pliant.levels import load_level
from pliant.sim import looks
from pliant.sim.cell import SimRobot
from pliant.sim.model import build
from pliant.task import load_task, shipped_pegs
from pliant.vision.lines import peaks


def dressed(level: str, seed: int) -> Setup:
    return replace(load_level(level).on(condition("all")).draw(seed), stale=0.0)


def whole(robot: SimRobot, camera: str) -> NDArray[np.uint8]:
    """The picture with everything in it, springs besides, whatever the camera sees."""
    options = mujoco.MjvOption()
    options.sitegroup[:] = 0
    with mujoco.Renderer(robot.model, 480, 640, max_geom=1000) as renderer:
        renderer.update_scene(robot.data, camera=camera, scene_option=options)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        looks.dress(looks.looks_of(robot.setup), renderer.scene, robot.model, camera)
        return renderer.render().copy()


@pytest.mark.parametrize("camera", ["side", "front"])  # neither ever sees a spring
@pytest.mark.parametrize("level", ["L0", "L5+"])
def test_what_a_camera_cannot_see_is_left_out_of_its_picture_without_a_trace(
    level: str, camera: str
) -> None:
    for seed in (1, 2, 3):
        robot = prepared("square", dressed(level, seed))
        stand_peg(robot, tip_y=0.02, tip_z=0.03 * (seed - 1), lean=0.1)
        assert np.array_equal(robot.cameras.image(camera, robot.data), whole(robot, camera))


def test_a_picture_leaves_the_model_as_it_was() -> None:
    robot = prepared()
    before = robot.model.geom_group.copy()
    robot.observe(cameras=("side", "oblique"))
    assert np.array_equal(robot.model.geom_group, before)


@pytest.mark.parametrize("peg", shipped_pegs())
def test_only_meshes_that_nothing_can_touch_are_drawn_coarser(peg: str) -> None:
    model = build(load_task(peg))
    compiled = np.diff([*model.mesh_faceadr, model.nmeshface])
    is_mesh = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    touches = is_mesh & ((model.geom_contype | model.geom_conaffinity) != 0)
    solid = np.unique(model.geom_dataid[touches])
    assert len(solid)
    assert np.array_equal(model.mesh_facenum[solid], compiled[solid])
    assert model.mesh_facenum.sum() < 0.4 * model.nmeshface


def test_noise_is_as_wide_as_the_looks_say_and_has_no_bias() -> None:
    grey = np.full((480, 640, 3), 120, np.uint8)
    wide = replace(looks.NOMINAL, noise=5.0)
    noise = looks.noisy(wide, grey, np.random.default_rng(0)).astype(float) - 120
    assert abs(noise.mean()) < 0.02
    assert noise.std() == pytest.approx(5.0, rel=0.01)
    assert np.quantile(noise, 0.975) == pytest.approx(9.8, abs=0.6)
    assert abs(np.corrcoef(noise[:, 1:].ravel(), noise[:, :-1].ravel())[0, 1]) < 0.01


def test_steps_are_found_in_each_profile_as_if_it_were_alone() -> None:
    profiles = np.random.default_rng(3).normal(100, 20, (9, 30, 3)).astype(np.float32)
    together = peaks(profiles, 15.0, 5.0)
    for n, profile in enumerate(profiles):
        alone = peaks(profile[None], 15.0, 5.0)
        assert np.array_equal(together.place[together.profile == n], alone.place)
        assert np.array_equal(together.step[together.profile == n], alone.step)
        assert len(alone.place)
