"""`pliant/Insertion-v0`: one step is one short straight motion of the hinge point.

An action is a change of the set point, each axis from -1 to 1 times `STEP_M` or `STEP_RAD`. It is
cut to the workspace and run through the envelope in `PERIOD_S` without ramps, as a stream of set
points; the compression limit ends it. Axes that are not controlled stay where they began.

The observation is what a real cell gives, `STATE` in SI units, and pictures where they are asked
for; where the hole is, how it rubs and how the peg was grasped are drawn anew in every episode and
must be felt or seen. The reward knows the truth; the observation does not.

An episode ends when the peg is inserted (as deep in the hole as the level asks, 10 mm on L0); it is
cut short by a fault of the robot or, through `gymnasium.make`, after 1000 steps.
"""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pliant.belief import Belief
from pliant.cell import Observation, Stop, Truth
from pliant.conditions import Condition
from pliant.envelope import Guarded, Limits
from pliant.envs.common import (
    RENDER_MODES,
    CellEnv,
    as_condition,
    check_action,
    chosen,
    known,
)
from pliant.errors import InputError, RobotFault
from pliant.formations import Formation
from pliant.levels import load_level
from pliant.methods.planar.skills import PlanarSkills
from pliant.pose import Axis, Pose
from pliant.records import Look
from pliant.sim.cell import SimRobot
from pliant.sim.stream import Streamed
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.scene import Scene

PERIOD_S = 0.020
STEP_M = 0.001  # 50 mm/s, the speed of the paper's skills in free space
STEP_RAD = math.radians(0.3)  # as fast at the peg's tip

STATE = (
    *("x", "y", "z", "roll", "pitch", "yaw"),  # measured pose [m, rad]
    *("goal_y", "goal_z", "goal_roll"),  # the taught Insertion goal less that pose [m, rad]
    "compression",  # of the wrist, from free hang [m]
    "stopped",  # 1: the compression limit ended the last motion
)

OBSERVATIONS = ("state", "picture", "both")
REWARDS = ("sparse", "shaped")
STARTS = ("home", "approach", "contact", "fit", "align")

INSERTED, STEP_COST = 1.0, 0.001
SHAPING = 10.0  # [1/m] on the tip's distance from its place in the hole


class InsertionEnv(CellEnv[Any]):
    """Insert the peg by pose increments.

    `peg` is a shipped peg's name or a peg file, `condition` what is drawn, by name or as a
    Condition. `axes` are controlled, in the action's order. `observation` is "state" (Box of
    `STATE`), "picture" (Box of pixels, `picture_width` wide and three quarters as high, from the
    side camera) or "both" (Dict of the two). `reward` "sparse": `INSERTED` once, less `STEP_COST`
    per step; "shaped" adds `SHAPING` times the progress of the peg's tip. `start` names the last
    formation that the taught skills do before the first step.

    Raises:
        InputError: an option cannot be used.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, as Gymnasium declares it
        "render_modes": RENDER_MODES,
        "render_fps": round(1 / PERIOD_S),
    }

    def __init__(
        self,
        *,
        peg: str = "circle",
        level: str = "L0",
        condition: str | Condition = "all",
        axes: Sequence[str] = ("y", "z", "roll"),
        observation: str = "state",
        picture_width: int = 160,
        reward: str = "sparse",
        start: str = "home",
        render_mode: str | None = None,
    ) -> None:
        super().__init__(render_mode)
        self._task = load_task(peg, level)
        self._condition = load_level(level).on(as_condition(condition))
        self._axes = _as_axes(axes)
        self._observed = chosen("observation", observation, OBSERVATIONS)
        self._picture_size = _picture_size(picture_width)
        self._shaped = chosen("reward", reward, REWARDS) == "shaped"
        self._before = _formations(chosen("start", start, STARTS))

        self._limits = Limits()
        self._scale = np.array([STEP_RAD if a.is_angle else STEP_M for a in self._axes])
        self._goals = shipped().for_task(self._task).goals
        self._goal = self._goals.target(Formation.INSERTION)
        self._held = Pose()
        self._potential = 0.0
        self.action_space = spaces.Box(-1.0, 1.0, (len(self._axes),), np.float32)
        self.observation_space = self._space()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Draw a trial: `seed`'s, the same that an experiment runs, or the next of this
        environment's own stream. `info` has the trial's seed."""
        super().reset(seed=seed, options=options)
        trial = self._drawn_seed() if seed is None else seed
        self._setup = self._condition.draw(trial)
        self._robot = robot = self._cell.prepare(self._task, self._setup)
        self._play_taught(robot)
        self._held = robot.set_point()
        self._guarded = Guarded(Streamed(robot, PERIOD_S), self._limits)
        truth = self._cell.truth()
        self._potential = _potential(truth, self._task.depth)
        info = {"seed": trial, **self._info(truth, Stop.REACHED)}
        return self._observe(robot, Stop.REACHED), info

    def step(self, action: NDArray[Any]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make one motion. `info` has how it ended (`stop`), the robot's `time_s`, what a `fault`
        said, and the `truth`, which is not for a policy."""
        robot = self._ready()
        changes = check_action(action, len(self._axes)) * self._scale
        stop, fault = Stop.REACHED, ""
        try:
            motion = self._guarded.move_to(
                self._target(robot.set_point(), changes),
                speed_m_s=self._limits.speed_m_s,
                stop_at_compression_m=self._limits.compression_m,
            )
            stop = motion.stop
        except RobotFault as error:
            fault = str(error)
        truth = self._cell.truth()
        inserted = bool(truth.inserted)
        info = self._info(truth, stop, fault)
        return self._observe(robot, stop), self._reward(truth), inserted, bool(fault), info

    # --- inside ----------------------------------------------------------------------------------

    def _play_taught(self, robot: SimRobot) -> None:
        """Run the taught skills before the start, without looking."""
        skill = PlanarSkills(taught=self._goals)
        guarded = Guarded(robot, self._limits)

        def unseen(cameras: Sequence[str] = ()) -> Look:
            return Look(observation=robot.observe(cameras), scene=Scene(peg=None, hole=None))

        for formation in self._before:
            target, step = self._goals.target(formation), self._goals.step(formation)
            skill(guarded, unseen, target, step, Belief())

    def _target(self, here: Pose, changes: NDArray[np.float64]) -> Pose:
        low, high = self._limits.low, self._limits.high
        return self._held.updated(
            {
                axis: min(max(here[axis] + change, low[axis]), high[axis])
                for axis, change in zip(self._axes, changes.tolist(), strict=True)
            }
        )

    def _reward(self, truth: Truth) -> float:
        reward = (INSERTED if truth.inserted else 0.0) - STEP_COST
        if self._shaped:
            before, self._potential = self._potential, _potential(truth, self._task.depth)
            reward += self._potential - before
        return reward

    def _info(self, truth: Truth, stop: Stop, fault: str = "") -> dict[str, Any]:
        time_s = self._ready().clock()
        told = known(truth, self._setup)
        return {"time_s": time_s, "stop": str(stop), "fault": fault, "truth": told}

    def _observe(self, robot: SimRobot, stop: Stop) -> Any:
        views = () if self._observed == "state" else ("side",)
        seen = robot.observe(views)
        if self._observed == "state":
            return self._state(seen, stop)
        small = cv2.resize(
            seen.views["side"].image, self._picture_size, interpolation=cv2.INTER_AREA
        )
        if self._observed == "picture":
            return small
        return {"state": self._state(seen, stop), "picture": small}

    def _state(self, seen: Observation, stop: Stop) -> NDArray[np.float32]:
        pose, goal = seen.pose, self._goal
        values = [pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw]
        values += [goal.y - pose.y, goal.z - pose.z, goal.roll - pose.roll]
        values += [seen.compression_m, float(stop.is_early)]
        return np.clip(np.array(values, np.float32), self._low, self._high)

    def _space(self) -> spaces.Space[Any]:
        beyond = [0.1 if axis.is_angle else 0.02 for axis in Axis]  # what a halt may let it drift
        low = [self._limits.low[a] - b for a, b in zip(Axis, beyond, strict=True)]
        high = [self._limits.high[a] + b for a, b in zip(Axis, beyond, strict=True)]
        low, high = [*low, *[-0.4] * 3, -0.05, 0.0], [*high, *[0.4] * 3, 0.05, 1.0]
        self._low, self._high = np.array(low, np.float32), np.array(high, np.float32)
        state = spaces.Box(self._low, self._high, dtype=np.float32)
        width, height = self._picture_size
        pixels = spaces.Box(0, 255, (height, width, 3), np.uint8)
        if self._observed == "both":
            return spaces.Dict({"state": state, "picture": pixels})
        return state if self._observed == "state" else pixels


def _as_axes(names: Sequence[str]) -> tuple[Axis, ...]:
    if isinstance(names, str) or not names or len(set(names)) != len(names):
        raise InputError(f"axes {names!r}: give a list of different ones of {', '.join(Axis)}")
    return tuple(Axis(chosen("axis", name, tuple(Axis))) for name in names)


def _picture_size(width: int) -> tuple[int, int]:
    if isinstance(width, bool) or width not in range(32, 641, 4):
        raise InputError(f"picture_width is {width!r}: it must be a multiple of 4 from 32 to 640")
    return width, width * 3 // 4


def _formations(start: str) -> tuple[Formation, ...]:
    """The formations to play up to `start`."""
    order = list(Formation)
    return () if start == "home" else tuple(order[: order.index(Formation(start)) + 1])


def _potential(truth: Truth, depth: float) -> float:
    """The potential of the shaped reward, from how near the tip is to `depth` [m] in the middle of
    the hole."""
    _, y, _ = truth.tip
    return -SHAPING * math.hypot(y - truth.hole_y, truth.depth_m - depth)
