"""A stored trial's motion at a fixed rate: measured pose, compression, command, execution."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pliant.cell import Motion
from pliant.conditions import NOMINAL
from pliant.errors import InputError
from pliant.pose import Axis, Pose, angles_from
from pliant.records import Trial
from pliant.sim import model as m
from pliant.sim.arm import Arm
from pliant.sim.cell import Trajectory
from pliant.task import Task

_SENSED = [name for name in NOMINAL if name.startswith("compression_")]
FASTEST = 25  # [Hz] at which trajectories are stored


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A trial's motion as n samples from its start to its last look, on the robot's clock.

    `pose` and `command` hold x, y, z [m], roll, pitch, yaw [rad] of the hinge point. `command` is
    where the running motion goes, or where the arm holds. `execution` is the index of the one that
    is running: an execution lasts until its look.
    """

    trajectory: Trajectory  # resampled: (n,) times, (n, nq) joint positions
    pose: NDArray[np.float64]  # (n, 6) measured
    compression_m: NDArray[np.float64]  # (n,) from free hang, as it was read
    command: NDArray[np.float64]  # (n, 6)
    execution: NDArray[np.int64]  # (n,)

    def __len__(self) -> int:
        return len(self.execution)


def check_rate(fps: int) -> None:
    """Refuse a rate [Hz] at which a trial cannot be sampled."""
    if not 1 <= fps <= FASTEST:
        raise InputError(f"fps is {fps}: it must be 1 to {FASTEST}, the rate that is stored")


def track(trial: Trial, trajectory: Trajectory, fps: int) -> Track:
    """Sample a trial with at least one execution at `fps` [Hz]; joints are interpolated linearly
    between the samples that are stored."""
    looks = np.array([e.outcome.looks[-1].observation.time_s for e in trial.executions])
    time_s = np.arange(int(looks[-1] * fps + 1e-6) + 1) / fps
    stored = trajectory.qpos.astype(np.float64)
    qpos = np.column_stack([np.interp(time_s, trajectory.time_s, joint) for joint in stored.T])
    arm, slide = _kinematics(trial.task)
    poses = [arm.pose_of(q) for q in qpos[:, arm.qpos]]
    pose = np.array([[*position, *angles_from(rotation)] for position, rotation in poses])
    execution = np.minimum(np.searchsorted(looks, time_s - 1e-6), len(looks) - 1)
    return Track(
        trajectory=replace(trajectory, time_s=time_s, qpos=qpos.astype(np.float32)),
        pose=pose,
        compression_m=_read(trial, time_s, qpos[:, slide] - stored[0, slide]),
        command=_commands(trial, time_s, pose[0]),
        execution=execution.astype(np.int64),
    )


def _read(
    trial: Trial, time_s: NDArray[np.float64], pressed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The wrist's compression as the robot read it [m]: `pressed`, which is true, unless the
    trial's sensor was not; then what the trial recorded of it, with lines between."""
    if not any(value != NOMINAL[name] for name, value in trial.drawn.items() if name in _SENSED):
        return pressed
    readings = [
        (trace.time_s, trace.compression_m)
        for e in trial.executions
        for trace in (motion.trace for motion in e.motions)
    ]
    looks = [look.observation for e in trial.executions for look in e.outcome.looks]
    times = np.concatenate([*(t for t, _ in readings), [look.time_s for look in looks]])
    values = np.concatenate([*(v for _, v in readings), [look.compression_m for look in looks]])
    order = np.argsort(times, kind="stable")
    return np.interp(time_s, times[order], values[order])


@lru_cache(maxsize=4)
def _kinematics(task: Task) -> tuple[Arm, int]:
    """The arm, and where the wrist's slide stands among the joint positions."""
    model = m.build(task)
    return Arm(model), int(model.joint("wrist_z").qposadr[0])


def _commands(
    trial: Trial, time_s: NDArray[np.float64], first: NDArray[np.float64]
) -> NDArray[np.float64]:
    motions = [motion for e in trial.executions for motion in e.motions]
    begun = np.searchsorted([motion.started_s for motion in motions], time_s + 1e-6, side="right")
    return np.array(
        [
            _held(motions[n - 1], t) if n else first
            for n, t in zip(begun.tolist(), time_s.tolist(), strict=True)
        ]
    )


def _held(motion: Motion, time_s: float) -> NDArray[np.float64]:
    """The pose that the arm is sent to; after a motion that was stopped, that where it halted."""
    halted = motion.stop.is_early and time_s > motion.ended_s
    return _array(motion.ended if halted else motion.commanded)


def _array(pose: Pose) -> NDArray[np.float64]:
    return np.array([pose[axis] for axis in Axis])
