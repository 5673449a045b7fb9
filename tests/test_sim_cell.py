"""The simulated robot does what the Robot protocol says, and does it the same way every time."""

import gc
import math
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stand_ins import PEGS, cell_for, prepared

from pliant.cell import Motion, Stop
from pliant.conditions import CONDITIONS, Setup
from pliant.envelope import Limits
from pliant.errors import InputError, RobotFault
from pliant.experiment.one import Spec, perform
from pliant.pose import Axis, Pose
from pliant.sim import constants as c
from pliant.sim.arm import Profile
from pliant.sim.cell import SimCell, SimRobot, Trajectory
from pliant.sim.model import BOARD, PEG
from pliant.task import load_task
from pliant.teaching import shipped

SPEED, LIMIT = 0.05, 0.020
BESIDE_HOLE = Pose(y=0.038, z=0.205, roll=math.radians(10))
LIMITS = Limits()


def go(robot: SimRobot, pose: Pose, *, speed: float = SPEED, limit: float = LIMIT) -> Motion:
    return robot.move_to(pose, speed_m_s=speed, stop_at_compression_m=limit)


# --- moving ------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(
    st.floats(-0.08, 0.08),
    st.floats(0.22, 0.32),
    st.floats(-0.3, 0.3),
    st.floats(-0.02, 0.02),
    st.sampled_from([0.02, 0.05, 0.1]),
)
def test_the_hinge_point_keeps_to_the_straight_line_within_half_a_millimetre(
    y: float, z: float, roll: float, x: float, speed: float
) -> None:
    robot = prepared()
    robot.settle(0.1)
    start, end = robot.pose(), Pose(x=x, y=y, z=z, roll=roll)
    motion = go(robot, end, speed=speed)
    along = end.position() - start.position()
    length = float(np.linalg.norm(along))
    for at in motion.trace.pose[:, :3]:
        part = np.clip((at - start.position()) @ along / max(length, 1e-9) ** 2, 0, 1)
        assert np.linalg.norm(at - start.position() - part * along) < 0.0005
    robot.settle(0.2)
    assert np.linalg.norm(robot.pose().position() - end.position()) < 0.0005


def test_a_motion_under_contact_ends_within_the_pose_checks_tolerance() -> None:
    robot = prepared()
    go(robot, BESIDE_HOLE)
    pressed = go(robot, BESIDE_HOLE.updated({Axis.Z: 0.185}))
    assert pressed.peak_compression_m > 0.003
    slid = go(robot, BESIDE_HOLE.updated({Axis.Z: 0.185, Axis.Y: 0.030}))
    error = slid.requested.error(slid.ended, list(Axis))
    assert all(abs(e) < (0.005 if a.is_angle else 0.0005) for a, e in error.items())


@pytest.mark.parametrize("speed", [0.02, 0.05, 0.1])
def test_a_motion_never_exceeds_its_speed(speed: float) -> None:
    robot = prepared()
    motion = go(robot, Pose(y=0.08, z=0.30), speed=speed)
    steps = np.linalg.norm(np.diff(motion.trace.pose[:, :3], axis=0), axis=1)
    times = np.diff(motion.trace.time_s)
    assert np.max(steps[:-1] / times[:-1]) < speed * 1.1


def test_a_motion_takes_as_long_as_its_length_and_speed_say() -> None:
    robot = prepared()
    start = robot.clock()
    motion = go(robot, Pose(y=0.05, z=robot.pose().z))
    assert motion.ended_s - motion.started_s == pytest.approx(
        0.05 / SPEED + c.ACCELERATION_RAMP, abs=0.02
    )
    assert (motion.started_s, motion.ended_s) == (start, robot.clock())


def test_moving_to_where_it_is_does_nothing_and_ends() -> None:
    robot = prepared()
    here = go(robot, Pose(y=0.01, z=0.24)).requested
    again = go(robot, here)
    assert again.stop is Stop.REACHED
    assert again.ended_s - again.started_s == pytest.approx(c.CONTROL_PERIOD)


@given(st.floats(0.0001, 0.5), st.floats(0.001, 0.2))
def test_a_speed_profile_goes_from_rest_to_rest_without_exceeding_its_speed(
    length: float, speed: float
) -> None:
    profile = Profile(length, speed, c.ACCELERATION_RAMP)
    times = np.linspace(0, profile.duration, 2001)
    covered = profile.fractions(times) * length
    velocity = np.diff(covered) / np.diff(times)
    assert covered[0] == 0.0
    assert covered[-1] == pytest.approx(length)
    assert np.all(velocity >= -1e-9)
    assert np.max(velocity) <= speed * 1.001
    tick = 0.001
    first, last = profile.fractions(np.array([tick, profile.duration - tick])) * length
    assert first / tick < 0.01 * speed
    assert (length - last) / tick < 0.01 * speed


@pytest.mark.parametrize("pose", [Pose(y=5.0, z=0.2), Pose(z=3.0), Pose(x=-0.5, y=-0.13, z=0.0)])
def test_a_pose_that_cannot_be_reached_is_a_fault_and_moves_nothing(pose: Pose) -> None:
    robot = prepared()
    before, at = robot.pose(), robot.clock()
    with pytest.raises(RobotFault) as fault:
        go(robot, pose)
    assert fault.value.kind == "unreachable"
    assert robot.clock() == at
    assert robot.pose() == before


@settings(max_examples=25)
@given(
    st.builds(
        Pose,
        **{axis.value: st.floats(LIMITS.low[axis], LIMITS.high[axis]) for axis in Axis},
    )
)
def test_the_whole_workspace_can_be_reached(pose: Pose) -> None:
    robot = prepared()
    line = robot.arm.line(Pose(z=0.244), pose, robot.data.ctrl.copy())
    position, rotation = robot.arm.pose_of(line[-1])
    assert np.allclose(position, pose.position(), atol=1e-6)
    assert np.allclose(rotation, pose.rotation(), atol=1e-6)


# --- compression -------------------------------------------------------------------------------


def test_compression_is_counted_from_free_hang() -> None:
    robot = prepared()
    assert robot.compression() == 0.0
    sag = -float(robot.data.joint("wrist_z").qpos[0])
    weight = (c.GRIPPER_MASS + c.PEG_MASS) * 9.81
    assert sag == pytest.approx(weight / robot.task.wrist.stiffness_z, rel=0.01)


def test_a_wrist_that_hangs_free_again_after_a_motion_reads_zero() -> None:
    robot = prepared()
    go(robot, Pose(y=0.03, z=0.26))
    robot.settle(6.0)
    assert robot.observe(cameras=()).compression_m == pytest.approx(0.0, abs=0.0001)


def test_tare_counts_from_here() -> None:
    robot = prepared()
    go(robot, BESIDE_HOLE)
    go(robot, BESIDE_HOLE.updated({Axis.Z: 0.190}))
    robot.settle(0.5)
    assert robot.compression() > 0.003
    robot.tare()
    assert robot.compression() == 0.0


@pytest.mark.parametrize("peg", PEGS)
@pytest.mark.parametrize("limit", [0.005, LIMIT])
def test_the_compression_limit_ends_a_motion_at_once_as_a_result(peg: str, limit: float) -> None:
    robot = prepared(peg)
    go(robot, BESIDE_HOLE)
    robot.settle(1.0)
    goal = BESIDE_HOLE.updated({Axis.Z: 0.13})
    motion = go(robot, goal, limit=limit)
    assert motion.stop is Stop.COMPRESSION
    assert limit < motion.peak_compression_m <= limit + 0.0005
    assert motion.ended.z > goal.z + 0.01
    peaks = []
    robot.watch(lambda: peaks.append(robot.compression()))
    robot.settle(0.5)  # nothing moves on after the stop
    robot.watch(lambda: None)
    assert max(peaks) <= limit + 0.0007
    assert -0.0005 < robot.pose().z - motion.ended.z < 0.001  # if it gives way, then upward


def test_a_stopped_robot_may_unload_and_then_move_on() -> None:
    robot = prepared()
    go(robot, BESIDE_HOLE)
    stopped = go(robot, BESIDE_HOLE.updated({Axis.Z: 0.13}))
    assert stopped.stop is Stop.COMPRESSION
    up = go(robot, BESIDE_HOLE)
    assert up.stop is Stop.REACHED
    assert up.peak_compression_m < LIMIT + 0.0005
    assert robot.compression() < 0.002
    assert go(robot, Pose(y=-0.05, z=0.25)).stop is Stop.REACHED


def test_a_stopped_robot_starts_its_next_line_where_it_stopped() -> None:
    robot = prepared()
    go(robot, BESIDE_HOLE)
    stopped = go(robot, BESIDE_HOLE.updated({Axis.Z: 0.13}))
    up = go(robot, stopped.ended.updated({Axis.Z: 0.21}))
    assert np.linalg.norm(up.trace.pose[0, :3] - stopped.ended.position()) < 0.002


def test_pushing_again_and_again_never_presses_past_the_limit() -> None:
    robot = prepared()
    go(robot, BESIDE_HOLE)
    peaks = [go(robot, BESIDE_HOLE.updated({Axis.Z: 0.13})).peak_compression_m for _ in range(6)]
    assert max(peaks) <= LIMIT + 0.0005


def test_halt_holds_where_the_arm_is() -> None:
    robot = prepared()
    go(robot, Pose(y=0.02, z=0.25))
    robot.halt()
    before = robot.pose()
    robot.settle(1.0)
    assert np.linalg.norm(robot.pose().position() - before.position()) < 0.0005


def test_halting_again_and_again_does_not_let_the_arm_sink() -> None:
    robot = prepared()
    before = robot.pose()
    for _ in range(8):
        robot.halt()
        robot.settle(0.2)
    assert np.linalg.norm(robot.pose().position() - before.position()) < 0.0005


# --- the same seed, the same trajectory --------------------------------------------------------


def trajectory_of(cell: SimCell, condition: str, seed: int, reasoner: str) -> Trajectory:
    """A whole trial's trajectory, its joints at full precision."""
    spec = Spec(
        task=load_task("circle"), condition=CONDITIONS[condition], seed=seed, reasoner=reasoner
    )
    perform(spec, cell, shipped())
    frames = cell.robot.frames
    return replace(cell.trajectory(), qpos=np.array([qpos for _, qpos in frames]))


@pytest.mark.parametrize("condition", sorted(CONDITIONS))
def test_the_same_seed_gives_the_same_trajectory_bit_for_bit(condition: str) -> None:
    cell = cell_for("circle")
    first = trajectory_of(cell, condition, 1, "rules")
    trajectory_of(cell, "all", 2, "retry" if condition == "none" else "none")
    again = trajectory_of(cell, condition, 1, "rules")
    fresh = trajectory_of(SimCell(), condition, 1, "rules")
    for other in (again, fresh):
        assert other.setup == first.setup
        assert other.time_s.tobytes() == first.time_s.tobytes()
        assert other.qpos.tobytes() == first.qpos.tobytes()
    assert len(first.qpos) > 100
    assert first.qpos.dtype == np.float64


def test_the_same_seed_gives_the_same_trajectory_after_another_peg() -> None:
    cell = SimCell()
    first = trajectory_of(cell, "all", 3, "none")
    cell.prepare(load_task("square"), Setup(seed=0))
    assert trajectory_of(cell, "all", 3, "none").qpos.tobytes() == first.qpos.tobytes()


def test_a_cell_holds_the_model_of_its_last_peg_alone() -> None:
    cell = SimCell()
    robots = [
        weakref.ref(cell.prepare(load_task(peg), Setup(seed=0)))
        for peg in ("circle", "square", "circle")
    ]
    gc.collect()
    assert [robot() is None for robot in robots] == [True, True, False]


def test_a_cell_is_gone_with_its_last_name_also_after_a_trial() -> None:
    """A model takes 0.1 GB: it cannot wait until Python looks for circles."""
    gc.disable()
    try:
        cell = SimCell()
        trajectory_of(cell, "none", 1, "none")
        robot = weakref.ref(cell.robot)
        del cell
        assert robot() is None
    finally:
        gc.enable()


def test_another_seed_gives_another_trajectory() -> None:
    cell = cell_for("circle")
    one, two = (trajectory_of(cell, "all", seed, "none").qpos for seed in (1, 2))
    assert one.tobytes() != two.tobytes()


def test_looking_changes_nothing() -> None:
    def drop(look: Callable[[SimRobot], object]) -> bytes:
        robot = prepared()
        for z in (0.20, 0.19, 0.185):
            go(robot, BESIDE_HOLE.updated({Axis.Z: z}))
            look(robot)
        robot.settle(0.2)
        return bytes(robot.data.qpos.tobytes())

    blind = drop(lambda robot: None)
    assert drop(lambda robot: robot.observe(("side", "wide"))) == blind
    assert drop(lambda robot: cell_for("circle").truth()) == blind


# --- what a setup changes ----------------------------------------------------------------------


@pytest.mark.parametrize("peg", PEGS)
def test_a_setup_moves_the_hole_turns_the_peg_and_scales_the_boards_friction(peg: str) -> None:
    angle = math.radians(4)
    robot = prepared(peg, Setup(seed=0, friction=3.0, hole_y=0.013, grasp_roll=angle))
    model = robot.model
    truth = cell_for(peg).truth()
    assert truth.hole_y == pytest.approx(0.013)
    assert truth.tilt_rad == pytest.approx(angle, abs=math.radians(0.7))
    board = [i for i in range(model.ngeom) if model.geom(i).name.startswith(BOARD)]
    assert model.geom_friction[board, 0] == pytest.approx(3.0 * c.FRICTION[0])
    assert model.geom_friction[board, 1] == pytest.approx(c.FRICTION[1])
    assert model.geom(PEG).friction[0] == c.FRICTION[0]


def test_preparing_again_leaves_no_trace_of_the_setup_before() -> None:
    fresh = SimCell().prepare(load_task("circle"), Setup(seed=0)).model
    prepared("circle", Setup(seed=1, friction=5.0, hole_y=-0.02, grasp_roll=0.05))
    back = prepared("circle", Setup(seed=0)).model
    for name in ("geom_friction", "body_pos", "body_quat", "dof_damping", "jnt_stiffness"):
        assert np.array_equal(getattr(back, name), getattr(fresh, name)), name


def test_a_trial_starts_at_rest_in_free_hang_with_its_clock_at_zero() -> None:
    robot = prepared("circle", Setup(seed=0, grasp_roll=0.08))
    assert robot.clock() == 0.0
    before = robot.data.qpos.copy()
    robot.settle(1.0)
    assert np.max(np.abs(robot.data.qpos - before)) < 0.003
    assert robot.clock() == pytest.approx(1.0)


def test_the_truth_is_inserted_only_ten_millimetres_deep_inside_the_hole() -> None:
    for depth, hole_y, inserted in ((0.012, 0.0, True), (0.008, 0.0, False), (0.012, 0.03, False)):
        cell = cell_for("square")
        robot = prepared("square", Setup(seed=0, hole_y=hole_y))
        tip = cell.truth().tip
        hang = robot.pose().z - tip[2]
        robot.data.qpos[robot.arm.qpos] = robot.arm.solve(
            np.array([0.0, 0.0, hang - depth]), np.eye(3), robot.data.ctrl.copy()
        )
        mujoco.mj_kinematics(robot.model, robot.data)
        truth = cell.truth()
        assert truth.depth_m == pytest.approx(depth, abs=1e-4)
        assert truth.inserted is inserted


def test_the_truth_before_any_trial_is_a_programming_error() -> None:
    with pytest.raises(RuntimeError, match="prepared"):
        SimCell().truth()


# --- looking -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["side", "wide"])
def test_a_camera_projects_points_to_where_they_are_drawn(name: str) -> None:
    robot = prepared()
    go(robot, Pose(y=0.08, z=0.32), speed=0.1)
    view = robot.observe((name,)).views[name]
    for point in ((0.065, -0.03, 0.02), (0.065, 0.05, -0.05), (0.065, 0.0, 0.05)):
        drawn = centre_of_dot(robot, name, np.array(point))
        assert drawn == pytest.approx(view.camera.project(np.array(point)), abs=0.7)


def centre_of_dot(robot: SimRobot, name: str, point: np.ndarray) -> tuple[float, float]:
    """Where a small sphere, drawn into the picture alone, appears [px]."""
    width, height = c.IMAGE_SIZE
    renderer = mujoco.Renderer(robot.model, height, width, max_geom=1000)
    scene = renderer.scene
    renderer.update_scene(robot.data, camera=name)
    plain = renderer.render().astype(int)
    renderer.update_scene(robot.data, camera=name)
    geom = scene.geoms[scene.ngeom]
    size = np.array([0.004, 0.0, 0.0])
    magenta = np.array([1, 0, 1, 1], np.float32)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE, size, point, np.eye(3).ravel(), magenta)
    scene.ngeom += 1
    changed = np.abs(renderer.render().astype(int) - plain).sum(axis=2) > 30
    renderer.close()
    rows, columns = np.nonzero(changed)
    assert len(rows) > 20
    return float(columns.mean()) + 0.5, float(rows.mean()) + 0.5


@pytest.mark.parametrize("ends", ["closed", "forgotten"])
def test_a_cell_that_ends_leaves_anothers_pictures_as_they_were(ends: str) -> None:
    mine, other = (SimRobot(load_task("circle")) for _ in range(2))
    for robot in (mine, other, mine):  # both have drawn, mine last
        robot.reset(Setup(seed=0))
        before = robot.cameras.image("wide", robot.data)
    if ends == "closed":
        other.cameras.close()
    else:
        del other, robot
        gc.collect()
    assert np.array_equal(mine.cameras.image("wide", mine.data), before)


def test_a_cell_is_drawn_and_collected_by_any_thread() -> None:
    held = [SimRobot(load_task("circle"))]
    held[0].reset(Setup(seed=0))
    mine = held[0].cameras.image("wide", held[0].data)
    with ThreadPoolExecutor(max_workers=1) as other:
        its = other.submit(lambda: held[0].cameras.image("wide", held[0].data)).result()
    assert np.array_equal(mine, its)
    held[0].cameras.image("wide", held[0].data)
    with ThreadPoolExecutor(max_workers=1) as other:
        other.submit(held.clear)
        other.submit(gc.collect).result()  # what it could not end would fail this test


@pytest.mark.parametrize("peg", ["square", "rectangle_narrow"])
def test_the_blocks_front_edges_are_drawn_where_the_calibration_says(peg: str) -> None:
    robot = prepared(peg, Setup(seed=0, hole_y=0.011))
    view = robot.observe().views["side"]
    hsv = cv2.cvtColor(view.image, cv2.COLOR_RGB2HSV)
    red = ((hsv[..., 0] < 8) | (hsv[..., 0] > 172)) & (hsv[..., 1] > 110) & (hsv[..., 2] > 40)
    columns = np.nonzero(red[300])[0]
    left, row = view.camera.project(np.array([0.06, 0.011 - 0.06, -0.04]))
    right, _ = view.camera.project(np.array([0.06, 0.011 + 0.06, -0.04]))
    assert columns[0] == pytest.approx(left, abs=1.0)
    assert columns[-1] + 1 == pytest.approx(right, abs=1.0)
    assert row == pytest.approx(304, abs=1.0)


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_a_pixel_on_a_known_plane_gives_back_the_point(x: float, y: float, z: float) -> None:
    camera = shipped().demonstrations[next(iter(shipped().demonstrations))].view.camera
    u, v = camera.project(np.array([x, y, z]))
    assert camera.on_plane_x(u, v, x) == pytest.approx((y, z), abs=1e-9)


def test_plus_y_is_right_and_plus_z_is_up_in_the_side_picture() -> None:
    camera = prepared().observe().views["side"].camera
    here, right, up = (camera.project(np.array(p)) for p in ((0, 0, 0), (0, 0.01, 0), (0, 0, 0.01)))
    assert here == pytest.approx((320, 240))
    assert right[0] > here[0]
    assert up[1] < here[1]


def test_an_observation_is_of_one_moment() -> None:
    robot = prepared()
    go(robot, Pose(y=0.01, z=0.25))
    seen = robot.observe(("side", "wide"))
    assert {v.time_s for v in seen.views.values()} == {seen.time_s} == {robot.clock()}
    assert seen.pose == robot.pose()
    assert all(v.image.shape == (480, 640, 3) for v in seen.views.values())


def test_an_earlier_picture_does_not_change_with_later_ones() -> None:
    robot = prepared()
    first = robot.observe().views["side"].image
    kept = first.copy()
    go(robot, Pose(y=0.06, z=0.25))
    later = robot.observe().views["side"].image
    assert np.array_equal(first, kept)
    assert not np.array_equal(first, later)


def test_an_unknown_camera_lists_the_valid_ones() -> None:
    with pytest.raises(
        InputError, match="unknown camera 'top': valid are side, front, oblique, wide"
    ):
        prepared().observe(("top",))
