"""The compiled model carries the documented constants; its contacts are as stiff as documented."""

import math
from dataclasses import dataclass
from functools import cache

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from stand_ins import PEGS, cell_for, prepared

from pliant.conditions import Setup
from pliant.menagerie import UR5E, menagerie_file
from pliant.pose import Axis, Pose
from pliant.sim import constants as c
from pliant.sim.arm import Profile
from pliant.sim.board import contains, hole_outline, hole_prisms
from pliant.sim.cell import SimRobot
from pliant.sim.model import ARM_JOINTS, BOARD, HINGE_SITE, PEG, TIP_SITE, WRIST, build
from pliant.task import BLOCK_SIZE, Hole, Peg, Task, Wrist, load_task

HEXAGON = Peg(
    name="hexagon",
    outline=tuple(
        (0.018 * math.cos(math.tau * k / 6), 0.018 * math.sin(math.tau * k / 6)) for k in range(6)
    ),
)


@cache
def model_of(peg: str) -> mujoco.MjModel:
    return build(load_task(peg))


def geoms(model: mujoco.MjModel, start: str) -> list[int]:
    return [i for i in range(model.ngeom) if model.geom(i).name.startswith(start)]


# --- the documented constants ------------------------------------------------------------------


def test_the_constants_are_the_published_ones() -> None:
    wrist = Wrist()
    assert (wrist.stiffness_z, wrist.damping_z) == (1000.0, 1.0)
    assert (wrist.stiffness_roll, wrist.damping_roll) == (0.5, 0.005)
    assert (wrist.stiffness_pitch, wrist.damping_pitch) == (0.5, 0.005)
    assert (wrist.stiffness_yaw, wrist.damping_yaw) == (5.0, 1.0)
    assert (c.WRIST_BELOW_FLANGE, c.GRIPPER_MASS, c.GRIPPER_COM_BELOW_HINGE) == (
        0.055,
        0.864,
        0.046,
    )
    assert c.GRIPPER_INERTIA == (1.02e-3, 1.03e-3, 0.49e-3)
    assert c.PEG_MASS == 0.03
    assert BLOCK_SIZE == (0.12, 0.12, 0.14)


@pytest.mark.parametrize("peg", PEGS)
def test_the_wrist_has_the_four_published_axes(peg: str) -> None:
    model, wrist = model_of(peg), load_task(peg).wrist
    joints = [model.joint(i).name for i in range(model.njnt)]
    assert joints == [*ARM_JOINTS, "wrist_z", "wrist_roll", "wrist_pitch", "wrist_yaw"]
    for axis in (Axis.Z, Axis.ROLL, Axis.PITCH, Axis.YAW):
        assert_carries(model, axis, wrist)


def test_a_wrist_with_lateral_springs_has_six_axes() -> None:
    wrist = Wrist(
        stiffness_x=700.0, stiffness_y=800.0, damping_x=2.0, damping_y=3.0, stiffness_roll=0.7
    )
    model = build(Task(peg=load_task("circle").peg, wrist=wrist))
    joints = [model.joint(i).name for i in range(len(ARM_JOINTS), model.njnt)]
    assert joints == [f"wrist_{axis}" for axis in Axis]
    for axis in Axis:
        assert_carries(model, axis, wrist)


def assert_carries(model: mujoco.MjModel, axis: Axis, wrist: Wrist) -> None:
    """One joint: its spring and damper as documented, and nothing beside them."""
    joint = model.joint(f"wrist_{axis}")
    kind = mujoco.mjtJoint.mjJNT_HINGE if axis.is_angle else mujoco.mjtJoint.mjJNT_SLIDE
    assert model.jnt_type[joint.id] == kind
    assert joint.stiffness[0] == getattr(wrist, f"stiffness_{axis}")
    assert joint.damping[0] == getattr(wrist, f"damping_{axis}")
    assert joint.armature[0] == 0.0
    assert joint.frictionloss[0] == 0.0
    assert joint.qpos_spring[0] == 0.0
    assert not model.jnt_limited[joint.id]


@pytest.mark.parametrize("peg", PEGS)
def test_the_gripper_and_the_peg_weigh_what_is_documented(peg: str) -> None:
    model = model_of(peg)
    wrist, held = model.body(WRIST), model.body(PEG)
    assert wrist.mass[0] == c.GRIPPER_MASS
    assert wrist.inertia == pytest.approx(c.GRIPPER_INERTIA)
    assert wrist.ipos == pytest.approx([0, 0, -c.GRIPPER_COM_BELOW_HINGE])
    assert held.mass[0] == pytest.approx(c.PEG_MASS)
    assert model.body_subtreemass[wrist.id] == pytest.approx(c.GRIPPER_MASS + c.PEG_MASS)


@pytest.mark.parametrize("peg", PEGS)
def test_gravity_is_compensated_on_the_arm_and_not_on_what_the_wrist_carries(peg: str) -> None:
    model = model_of(peg)
    assert model.body_gravcomp[model.body("forearm_link").id] == 1.0
    assert model.body_gravcomp[model.body(WRIST).id] == 0.0
    assert model.body_gravcomp[model.body(PEG).id] == 0.0


@pytest.mark.parametrize("peg", PEGS)
def test_the_hinge_and_the_tip_are_where_the_task_says(peg: str) -> None:
    model, task = model_of(peg), load_task(peg)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hinge, tip = data.site(HINGE_SITE), data.site(TIP_SITE)
    flange = data.site("attachment_site")
    assert np.linalg.norm(hinge.xpos - flange.xpos) == pytest.approx(c.WRIST_BELOW_FLANGE)
    below = hinge.xmat.reshape(3, 3).T @ (tip.xpos - hinge.xpos)
    assert below == pytest.approx([0, 0, -task.tip_below_hinge])


@pytest.mark.parametrize("peg", PEGS)
def test_the_peg_has_its_tasks_size_and_colour(peg: str) -> None:
    model, shape = model_of(peg), load_task(peg).peg
    geom = model.geom(PEG)
    half_x, half_y = shape.half_extents
    if shape.radius is not None:
        assert geom.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
        assert geom.size[:2] == pytest.approx([shape.radius, shape.length / 2])
    else:
        assert geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX
        assert geom.size == pytest.approx([half_x, half_y, shape.length / 2])
    assert geom.rgba == pytest.approx(c.PEG_RGBA)


@pytest.mark.parametrize("peg", PEGS)
def test_one_set_of_contact_parameters_holds_for_peg_fingers_and_board(peg: str) -> None:
    model = model_of(peg)
    touching = [i for i in range(model.ngeom) if model.geom_contype[i]]
    assert {model.geom(i).name[:5] for i in touching} == {"board", "peg", "gripp"}
    for i in touching:
        assert model.geom_friction[i] == pytest.approx(c.FRICTION)
        assert model.geom_solref[i] == pytest.approx(c.SOLREF)
        assert model.geom_solimp[i] == pytest.approx(c.SOLIMP)
        assert model.geom_condim[i] == c.CONDIM
        assert model.geom_margin[i] == model.geom_gap[i] == 0.0


@pytest.mark.parametrize("peg", PEGS)
def test_only_the_peg_and_the_two_fingertips_can_touch_only_the_board(peg: str) -> None:
    model = model_of(peg)
    pairs = {
        (model.geom(i).name, model.geom(j).name.rstrip("0123456789"))
        for i in range(model.ngeom)
        for j in range(model.ngeom)
        if model.geom_contype[i] & model.geom_conaffinity[j]
        and not model.geom(i).name.startswith(BOARD)
    }
    assert len(pairs) == 3
    assert {board for _, board in pairs} == {BOARD}


@pytest.mark.parametrize("peg", PEGS)
def test_the_solver_is_set_as_documented(peg: str) -> None:
    option = model_of(peg).opt
    assert option.timestep == c.TIMESTEP
    assert option.impratio == c.IMPRATIO
    assert option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert option.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert option.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
    assert option.gravity == pytest.approx([0, 0, -9.81])
    assert option.disableflags == 0


def test_the_arms_servos_are_menageries_with_a_stiffer_position_gain() -> None:
    ours, theirs = model_of("circle"), mujoco.MjModel.from_xml_path(str(menagerie_file(UR5E)))
    factor = c.SERVO_STIFFNESS_FACTOR
    assert ours.actuator_gainprm[:, 0] == pytest.approx(theirs.actuator_gainprm[:, 0] * factor)
    assert ours.actuator_biasprm[:, 1] == pytest.approx(theirs.actuator_biasprm[:, 1] * factor)
    assert ours.actuator_biasprm[:, 2] == pytest.approx(theirs.actuator_biasprm[:, 2])


@pytest.mark.parametrize("peg", PEGS)
def test_the_side_camera_stands_at_plus_x_at_the_boards_height(peg: str) -> None:
    camera = model_of(peg).camera("side")
    assert camera.pos == pytest.approx([c.SIDE_CAMERA_DISTANCE, 0, c.SIDE_CAMERA_HEIGHT])
    assert camera.fovy[0] == c.SIDE_CAMERA_FOVY


# --- the hole ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("peg", "x_mm", "y_mm"), [("square", 42, 42), ("rectangle_narrow", 42, 22)]
)
def test_a_rectangles_hole_is_its_clearance_wider(peg: str, x_mm: float, y_mm: float) -> None:
    task = load_task(peg)
    outline = hole_outline(task.peg, task.hole)
    assert np.ptp(outline, axis=0) * 1e3 == pytest.approx([x_mm, y_mm])


def test_a_circles_hole_is_a_twelve_gon_around_it_with_flats_at_plus_and_minus_y() -> None:
    task = load_task("circle")
    outline = hole_outline(task.peg, task.hole)
    middles = (outline + np.roll(outline, -1, axis=0)) / 2
    assert len(outline) == c.ROUND_HOLE_SIDES == 12
    assert np.linalg.norm(middles, axis=1) * 1e3 == pytest.approx(12 * [21.0])
    assert any(np.allclose(m, [0, 0.021]) for m in middles)
    assert any(np.allclose(m, [0, -0.021]) for m in middles)


SHAPES = st.one_of(
    st.builds(lambda r: Peg(name="disc", radius=r), st.floats(0.002, 0.0425)),
    st.builds(
        lambda x, y: Peg(name="box", outline=((-x, -y), (x, -y), (x, y), (-x, y))),
        st.floats(0.002, 0.045),
        st.floats(0.002, 0.0425),
    ),
    st.just(HEXAGON),
)


@given(SHAPES, st.floats(0.0001, 0.008))
def test_the_prisms_fill_the_block_and_leave_the_hole_free(peg: Peg, clearance: float) -> None:
    hole = Hole(clearance=clearance)
    outline = hole_outline(peg, hole)
    area = 0.0
    for i, vertices in enumerate(hole_prisms(peg, hole)):
        start, end = outline[i], outline[(i + 1) % len(outline)]
        inward = np.array([start[1] - end[1], end[0] - start[0]])
        assert np.max((vertices[:, :2] - start) @ inward) < 1e-9  # all on the edge's far side
        assert np.all(np.abs(vertices[:, :2]) <= np.array(BLOCK_SIZE[:2]) / 2 + 1e-12)
        assert {round(z, 9) for z in vertices[:, 2]} == {0.0, -BLOCK_SIZE[2]}
        area += hull_area(vertices[:, :2])
    whole = BLOCK_SIZE[0] * BLOCK_SIZE[1]
    assert area + hull_area(outline) == pytest.approx(whole, rel=1e-4)


@given(SHAPES)
def test_every_prism_is_convex(peg: Peg) -> None:
    for vertices in hole_prisms(peg, Hole()):
        floor = np.unique(vertices[:, :2].round(9), axis=0)
        middle = floor.mean(axis=0)
        turn = np.argsort(np.arctan2(*(floor - middle).T))
        ring = floor[turn]
        x, y = ring.T
        own = abs(float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)) / 2
        assert own == pytest.approx(hull_area(floor), rel=1e-3)


def hull_area(points: NDArray[np.float64]) -> float:
    hull = cv2.convexHull((points * 1e3).astype(np.float32))
    return float(cv2.contourArea(hull)) * 1e-6


def ceiling(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float) -> float:
    """Height of the board under a point [m], by a ray from above; -inf in the hole."""
    hit = np.zeros(1, np.int32)
    groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    start = np.array([x, y, 0.01])
    skip = model.body(PEG).id
    distance = mujoco.mj_ray(model, data, start, np.array([0.0, 0, -1]), groups, 1, skip, hit)
    name = model.geom(int(hit[0])).name if hit[0] >= 0 else ""
    return 0.01 - distance if name.startswith(BOARD) else -math.inf


@pytest.mark.parametrize("peg", [*PEGS, HEXAGON])
@pytest.mark.parametrize("chamfer", [0.0, 0.003])
def test_in_the_compiled_board_the_hole_is_open_and_all_else_is_solid(
    peg: str | Peg, chamfer: float
) -> None:
    shape = peg if isinstance(peg, Peg) else load_task(peg).peg
    task = Task(peg=shape, hole=Hole(chamfer=chamfer))
    model = build(task)
    data = mujoco.MjData(model)
    data.qpos[: len(ARM_JOINTS)] = [0.0, -2.5, 0.5, 0, 0, 0]  # folded away from the board
    mujoco.mj_kinematics(model, data)
    inner = hole_outline(task.peg, task.hole, grown=-1e-5)
    outer = hole_outline(task.peg, task.hole, grown=chamfer + 1e-5)
    steps = np.linspace(-0.0595, 0.0595, 41)  # moved a little, off the seams between prisms
    for x, y in [(x + 0.00013, y + 0.00037) for x in steps for y in steps]:
        height = ceiling(model, data, x, y)
        if contains(inner, (x, y)):
            assert height == -math.inf
        elif not contains(outer, (x, y)):
            assert height == pytest.approx(0.0, abs=1e-7)
        else:
            assert -chamfer - 1e-7 <= height <= 0.0


def test_a_chamfer_slopes_at_45_degrees() -> None:
    task = Task(peg=load_task("square").peg, hole=Hole(chamfer=0.004))
    model = build(task)
    data = mujoco.MjData(model)
    data.qpos[: len(ARM_JOINTS)] = [0.0, -2.5, 0.5, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    for out in (0.0005, 0.002, 0.0035):
        assert ceiling(model, data, 0.003, 0.021 + out) == pytest.approx(out - 0.004, abs=1e-6)


# --- how stiff the contacts are ----------------------------------------------------------------

SIDE_FORCE = 20.0  # [N] what the wrist presses with at its compression limit
LIMIT = 0.020  # [m] compression from free hang
CONTACT_SPEED = 0.05  # [m/s]


@pytest.mark.parametrize("peg", PEGS)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_peg_in_its_hole_has_its_clearance_as_play(peg: str, axis: int) -> None:
    robot = prepared(peg)
    robot.move_to(
        Pose(z=robot.task.tip_below_hinge - 0.020),
        speed_m_s=CONTACT_SPEED,
        stop_at_compression_m=LIMIT,
    )
    robot.settle(0.5)
    play = {force: play_under(robot, axis, force) for force in (1.0, SIDE_FORCE)}
    gentle, hard = play[1.0], play[SIDE_FORCE]
    print(f"{peg} {'xy'[axis]}: play {gentle * 1e3:.3f} mm at 1 N, {hard * 1e3:.3f} mm at 20 N")
    clearance = robot.task.hole.clearance
    assert clearance - 0.00001 <= gentle <= clearance + 0.00001
    assert gentle <= hard <= clearance + 0.00005


def play_under(robot: SimRobot, axis: int, force: float) -> float:
    """How far the tip moves between being pushed one way and the other [m]."""
    model, data = robot.model, robot.data
    start = data.qpos.copy()
    ends = []
    for sign in (-1.0, 1.0):
        data.qpos[:], data.qvel[:] = start, 0.0
        push = np.zeros(3)
        push[axis] = sign * force
        for _ in range(500):
            data.qfrc_applied[:] = 0.0
            at = data.site(TIP_SITE).xpos
            body = model.body(PEG).id
            mujoco.mj_applyFT(model, data, push, np.zeros(3), at, body, data.qfrc_applied)
            mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        ends.append(float(data.site(TIP_SITE).xpos[axis]))
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = start, 0.0, 0.0
    return ends[1] - ends[0]


@dataclass(frozen=True)
class Press:
    """How deep the peg sank into the board [m], and how hard it was pressed [N]."""

    at_touch_m: float
    at_rest_m: float
    force_n: float


@pytest.mark.parametrize("peg", PEGS)
@pytest.mark.parametrize("lean_deg", [0, 10])
def test_a_peg_pressed_on_the_board_sinks_in_by_less_than_a_tenth_of_a_millimetre(
    peg: str, lean_deg: int
) -> None:
    press = press_on_board(peg, math.radians(lean_deg))
    print(
        f"{peg}, flange at {lean_deg} deg: {press.at_touch_m * 1e3:.3f} mm at touch-down,"
        f" {press.at_rest_m * 1e3:.3f} mm at rest under {press.force_n:.1f} N"
    )
    assert press.force_n == pytest.approx(SIDE_FORCE, abs=1.0)
    assert 0 < press.at_rest_m < 0.00003
    assert press.at_touch_m < 0.0001


def press_on_board(peg: str, lean: float) -> Press:
    """Down onto the board at contact speed until the compression limit, then hold."""
    robot = prepared(peg, Setup(seed=0))
    model, data = robot.model, robot.data
    y = BLOCK_SIZE[1] / 2 - robot.task.peg.half_extents[1] if lean == 0 else 0.035
    above, below = Pose(y=y, z=0.215, roll=lean), Pose(y=y, z=0.130, roll=lean)
    robot.move_to(above, speed_m_s=0.1, stop_at_compression_m=LIMIT)
    robot.settle(1.0)
    line = robot.arm.line(above, below, data.ctrl.copy())
    profile = Profile(above.z - below.z, CONTACT_SPEED, c.ACCELERATION_RAMP)
    times = np.arange(0.0, profile.duration, c.TIMESTEP)
    at = profile.fractions(times) * (len(line) - 1)
    deepest = 0.0
    for place in at:
        low = min(int(place), len(line) - 2)
        data.ctrl[:] = line[low] + (place - low) * (line[low + 1] - line[low])
        mujoco.mj_step(model, data)
        deepest = max(deepest, depth(data))
        if robot.compression() > LIMIT:
            break
    robot.halt()
    for _ in range(round(1.0 / c.TIMESTEP)):
        mujoco.mj_step(model, data)
    wrench, force = np.zeros(6), 0.0
    for i, contact in enumerate(data.contact):
        mujoco.mj_contactForce(model, data, i, wrench)
        force += abs(float((contact.frame.reshape(3, 3).T @ wrench[:3])[2]))
    assert not cell_for(peg).truth().inserted
    return Press(deepest, depth(data), force)


def depth(data: mujoco.MjData) -> float:
    return max((-float(contact.dist) for contact in data.contact), default=0.0)
