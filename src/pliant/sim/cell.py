"""The simulated cell: a Robot for the method, a Workcell with the truth for the experiment."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.cell import HOME_ABOVE_BOARD, Motion, Observation, Samples, Stop, Truth, View, missed
from pliant.conditions import Setup
from pliant.errors import RobotFault
from pliant.pose import Pose, angles_from, pose_from
from pliant.sim import constants as c
from pliant.sim import model as m
from pliant.sim.arm import HOME_GUESS, Arm, Profile
from pliant.sim.board import contains, hole_outline
from pliant.sim.render import Cameras
from pliant.sim.sensor import Feed, Sensor
from pliant.sim.setup import apply, is_moving, place
from pliant.task import Task
from pliant.wrist import Reading, Watch, Way, is_straight, toward_tip

_STEPS_PER_CONTROL = round(c.CONTROL_PERIOD / c.TIMESTEP)
_CONTROLS_PER_SAMPLE = 5  # of a trace: 20 Hz
_CONTROLS_PER_FRAME = 4  # of the trajectory: 25 Hz
_UNLOADING = 0.00005  # [m] past the limit already, a motion may not press further than this
# Of a pose that counts as reached: where the board is shoved while the peg is in it the servos give
# way by up to 20 mm and 6.3 deg, and recover; wedged for good they were 46 mm and 24 deg off.
_NEAR_M, _NEAR_RAD = 0.025, math.radians(10.0)
_STREAM_TOLERANCE = 1e-5  # [m, rad] of a set point in a stream: it takes one iteration
_HANG_S, _HANG_DAMPING = 1.0, 30.0  # before a trial: damped, so that it starts at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Everything needed to draw a trial again: joint positions over time, and the setup."""

    time_s: NDArray[np.float64]  # (n,)
    qpos: NDArray[np.float32]  # (n, nq)
    setup: Setup


class SimCell:
    """A workcell in MuJoCo. One compiled model per task; a trial edits it and resets the state."""

    kind = "sim"

    def __init__(self) -> None:
        self._robot: SimRobot | None = None

    def prepare(self, task: Task, setup: Setup) -> "SimRobot":
        """Put the peg in the grasp and the hole where `setup` says, and the arm at home."""
        if self._robot is None or task != self._robot.task:
            if self._robot is not None:
                self._robot.cameras.close()
                self._robot = None  # gone before the next is compiled: half the memory
            self._robot = SimRobot(task)
        self._robot.reset(setup)
        return self._robot

    @property
    def robot(self) -> "SimRobot":
        """The robot of the trial that was prepared last: its model, its state, its cameras."""
        if self._robot is None:
            raise RuntimeError("the cell has not been prepared")
        return self._robot

    def truth(self) -> Truth:
        """Ground truth now. Nothing that the method holds can reach it. A peg that is missing is
        taken where it would be, and never inserted."""
        robot, task = self.robot, self.robot.task
        data, model = robot.data, robot.model
        mujoco.mj_kinematics(model, data)
        tip = data.site_xpos[robot.tip_site].copy()
        rotation = data.xmat[robot.peg_body].reshape(3, 3)
        hole = data.xpos[robot.board_body]
        board = data.xmat[robot.board_body].reshape(3, 3)
        depth = float(hole[2] - tip[2])
        inside = contains(hole_outline(task.peg, task.hole), ((tip - hole) @ board)[:2])
        low = tip + rotation @ self._low_corner(task, rotation)
        there = not robot.setup.is_on("peg_missing")
        near = contains(hole_outline(task.peg, task.hole, grown=0.001), ((low - hole) @ board)[:2])
        return Truth(
            inserted=there and inside and depth >= task.depth,
            depth_m=depth,
            tip=(float(tip[0]), float(tip[1]), float(tip[2])),
            tilt_rad=angles_from(board.T @ rotation)[0],
            hole_y=float(hole[1]),
            compression_m=robot.pressed(),
            fit=there and bool(low[2] < hole[2] - 0.001) and near,
        )

    def trajectory(self) -> Trajectory:
        """The trial so far, for drawing it again."""
        robot = self.robot
        times, qpos = zip(*robot.frames, strict=True)
        return Trajectory(
            time_s=np.array(times), qpos=np.array(qpos, np.float32), setup=robot.setup
        )

    def show(self) -> None:
        """Open MuJoCo's viewer on the prepared cell and keep it in step, in real time."""
        import mujoco.viewer

        robot = self.robot
        viewer = mujoco.viewer.launch_passive(robot.model, robot.data)
        began = time.monotonic() - robot.clock()

        def step() -> None:
            time.sleep(max(0.0, began + robot.clock() - time.monotonic()))
            if viewer.is_running():
                viewer.sync()

        robot.watch(step)

    @staticmethod
    def _low_corner(task: Task, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        """The lowest point of the bottom face in the plane of insertion, from its centre [m]; of an
        edge that lies across the plane, its middle."""
        half = task.peg.half_extents[1]
        y = half if rotation[2, 1] < 0 else -half
        outermost = [a for a, b in task.peg.outline if math.isclose(b, y, abs_tol=1e-4)]
        return np.array([sum(outermost) / len(outermost) if outermost else 0.0, y, 0.0])


class SimRobot:
    """The method's side of the simulated cell (protocol `pliant.cell.Robot`)."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.model = m.build(task)
        self.data = mujoco.MjData(self.model)
        self.arm = Arm(self.model)
        self.cameras = Cameras(self.model)
        self.setup = Setup(seed=0)
        self.frames: list[tuple[float, NDArray[np.float64]]] = []
        self._slide = int(self.model.joint("wrist_z").qposadr[0])
        self._site = self.model.site(m.HINGE_SITE).id
        self.tip_site = self.model.site(m.TIP_SITE).id
        self.peg_body, self.board_body = self.model.body(m.PEG).id, self.model.body(m.BOARD).id
        self._free_hang = self._tared = 0.0  # where the slide is at rest, and is felt to be [m]
        self._sensor, self._wrist = Sensor(self.setup, 0.0), Watch()
        self._feed = Feed(self.setup)
        self._sag = np.zeros(len(self.arm.qpos))  # [rad] set points less joint angles, at rest
        self._controls = 0
        self._commanded = Pose(z=task.tip_below_hinge + HOME_ABOVE_BOARD)
        self._home = self.arm.solve(
            self._commanded.position(), self._commanded.rotation(), np.array(HOME_GUESS)
        )
        self._q = self._home
        self._on_step: Callable[[], None] | None = None  # of a viewer that watches

    # --- what a trial randomises ---------------------------------------------------------------

    def reset(self, setup: Setup) -> None:
        """Apply a setup and hang at home, at rest, compression tared, clock at zero."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        self.setup = setup
        apply(model, setup)
        self._commanded = Pose(z=self.task.tip_below_hinge + HOME_ABOVE_BOARD)
        self._q = self._home
        data.qpos[self.arm.qpos] = self._home
        data.ctrl[:] = self._home
        damping = model.dof_damping.copy()
        model.dof_damping[self.arm.dofs[-1] + 1 :] *= _HANG_DAMPING
        mujoco.mj_step(model, data, round(_HANG_S / c.TIMESTEP))
        model.dof_damping[:] = damping
        data.qvel[:] = 0.0
        data.time = 0.0
        self.frames = []
        self._controls = 0
        self._sag = self._home - data.qpos[self.arm.qpos]
        self.cameras.dress(setup)
        self._sensor = Sensor(setup, float(data.qpos[self._slide]))
        self._feed = Feed(setup)
        self._wrist.forget()
        self.tare()
        self._keep_frame()

    # --- Robot -----------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.halt()

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        waypoints = self.arm.line(self._commanded, pose, self._q)
        profile = Profile(self._length(pose), speed_m_s, c.ACCELERATION_RAMP)
        ticks = max(1, math.ceil(profile.duration / c.CONTROL_PERIOD))
        fractions = profile.fractions(np.arange(1.0, ticks + 1.0) * c.CONTROL_PERIOD)
        path = _along(waypoints, fractions)
        motion = self._follow(path, pose, stop_at_compression_m)
        if motion.stop is Stop.REACHED:
            self._verify(motion)
        return motion

    def stream_to(self, pose: Pose, *, seconds: float, stop_at_compression_m: float) -> Motion:
        """Run the set points evenly, without ramps, to a pose a few millimetres away."""
        target = self.arm.solve(pose.position(), pose.rotation(), self._q, _STREAM_TOLERANCE)
        ticks = max(1, round(seconds / c.CONTROL_PERIOD))
        path = self._q + np.arange(1, ticks + 1)[:, None] / ticks * (target - self._q)
        return self._follow(path, pose, stop_at_compression_m)

    def settle(self, seconds: float) -> None:
        for _ in range(round(seconds / c.CONTROL_PERIOD)):
            self._control()

    def tare(self) -> None:
        self._obeyed(partial(self._wrist.tare, self._sensor.watched(self._felt())))
        self._free_hang, self._tared = float(self.data.qpos[self._slide]), self._felt()

    def clock(self) -> float:
        return float(self.data.time)

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        mujoco.mj_kinematics(self.model, self.data)
        time_s = self.clock()
        return Observation(
            time_s=time_s,
            pose=self.pose(),
            compression_m=self.compression(),
            views={name: self._view(name, time_s) for name in cameras},
            compression_sd_m=self.setup.compression_noise,
        )

    def _view(self, camera: str, time_s: float) -> View:
        height = float(self.data.site_xpos[self.tip_site][2] - self.data.xpos[self.board_body][2])
        see = partial(self.cameras.view, camera, self.data, time_s)
        return self._feed.deliver(camera, time_s, height, see)

    def halt(self) -> None:
        """Hold where the joints are: their angles plus the servos' error under the tool's weight,
        without which the arm would sink a little at every halt."""
        self._q = self.data.qpos[self.arm.qpos] + self._sag
        self._commanded = pose_from(*self.arm.pose_of(self._q))
        self.data.ctrl[:] = self._q

    # --- measurements ----------------------------------------------------------------------------

    def pose(self) -> Pose:
        """The hinge point with the wrist unsprung, from the measured joints."""
        mujoco.mj_kinematics(self.model, self.data)
        site = self.data.site_xmat[self._site].reshape(3, 3)
        return pose_from(self.data.site_xpos[self._site], site)

    def set_point(self) -> Pose:
        """The pose where the arm is told to be; it hangs a little lower under the tool's weight."""
        return self._commanded

    def compression(self) -> float:
        """The compression of the wrist along its axis, from free hang [m], as it is read."""
        return self._felt() + self._sensor.noise - self._tared

    def pressed(self) -> float:
        """The compression as a perfect sensor would read it: the experiment's side [m]."""
        return float(self.data.qpos[self._slide]) - self._free_hang

    def _watched(self) -> float:
        """The compression on which a motion's limit is watched [m]."""
        return self._sensor.watched(self._felt()) - self._tared

    def _felt(self) -> float:
        return self._sensor.felt(float(self.data.qpos[self._slide]))

    # --- inside ----------------------------------------------------------------------------------

    def watch(self, on_step: Callable[[], None]) -> None:
        """Call `on_step` after every control period; for the live viewer."""
        self._on_step = on_step

    def _follow(self, path: NDArray[np.float64], pose: Pose, limit: float) -> Motion:
        """Hold each row of `path` (ticks, 6) [rad], which ends at `pose`, for one control period,
        until compression is past `limit` [m]. What the wrist's own limit does not permit is not
        begun: the arm stays for a control period where it is."""
        started = self.clock()
        peak = self._watched()
        stop = Stop.REACHED
        samples = Samples()
        margin = _UNLOADING + self._sensor.margin
        limit = min(limit, self._wrist.limit_m)
        way = None
        if is_straight(self._commanded, pose):
            way = Way(self._commanded.position(), -pose.rotation()[:, 2])
        if not self._wrist.begin(peak, toward_tip(self._commanded, pose), limit, way):
            path = self.data.ctrl[None].copy()
            stop = Stop.COMPRESSION
        ticks = len(path)
        for k in range(ticks):
            self.data.ctrl[:] = path[k]
            reading = self._control()
            watched = reading.filtered_m
            peak = max(peak, watched)
            ends = self._wrist.ends(watched, margin)
            if k % _CONTROLS_PER_SAMPLE == 0 or k == ticks - 1:
                samples.take(self.clock(), self.pose(), reading.read_m)
            if ends and stop is Stop.REACHED:
                stop = Stop.COMPRESSION
                self._wrist.rest()
                self.halt()
                self.settle(self._sensor.delay_s)
                break
        self._wrist.rest()
        if stop is Stop.REACHED:
            self._commanded, self._q = pose, path[-1]
        return Motion(
            requested=pose,
            commanded=pose,
            ended=self.pose(),
            stop=stop,
            peak_compression_m=peak,
            started_s=started,
            ended_s=self.clock(),
            trace=samples.trace(),
            answer=self._wrist.answer(),
        )

    def _verify(self, motion: Motion) -> None:
        """Check that a motion ended near its goal: what holds the peg may hold back the hand, too,
        since the servos give way."""
        off, turn = motion.off
        if off > _NEAR_M or turn > _NEAR_RAD:
            self.halt()
            raise RobotFault("not_reached", missed(off, turn))

    def _length(self, pose: Pose) -> float:
        """Length of a motion [m]: of the hinge's line, or of the tip's arc if that is longer."""
        line = float(np.linalg.norm(pose.position() - self._commanded.position()))
        return max(line, self.task.tip_below_hinge * self._commanded.turn_to(pose))

    def _control(self) -> Reading:
        """One control period, and what was read at its end."""
        model, data = self.model, self.data
        if is_moving(self.setup, self.clock()):
            for _ in range(_STEPS_PER_CONTROL):
                place(model, self.setup, self.clock() + c.TIMESTEP)
                mujoco.mj_step(model, data)
        else:
            mujoco.mj_step(model, data, _STEPS_PER_CONTROL)
        felt, sensor = self._felt(), self._sensor
        sensor.read(felt)
        self._controls += 1
        if self._controls % _CONTROLS_PER_FRAME == 0:
            self._keep_frame()
        if self._on_step is not None:
            self._on_step()
        reading = Reading(
            time_s=self.clock(),
            read_m=felt + sensor.noise - self._tared,
            filtered_m=sensor.watched(felt) - self._tared,
            margin_m=sensor.margin,
            noise_m=self.setup.compression_noise,
            along_m=self._wrist.along(data.site_xpos[self._site]),
        )
        self._obeyed(partial(self._wrist.read, reading))
        return reading

    def _obeyed(self, ask: Callable[[], None]) -> None:
        """Ask the wrist's watch by a call, and halt where it finds a fault."""
        try:
            ask()
        except RobotFault:
            self._wrist.rest()
            self.halt()
            raise

    def _keep_frame(self) -> None:
        self.frames.append((self.clock(), self.data.qpos.copy()))


def _along(waypoints: NDArray[np.float64], fractions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Joint angles (ticks, 6) at fractions of a path through equally spaced waypoints (n, 6)."""
    at = fractions * (len(waypoints) - 1)
    low = np.minimum(at.astype(int), len(waypoints) - 2)
    part = (at - low)[:, None]
    return waypoints[low] * (1 - part) + waypoints[low + 1] * part
