"""What several tests share: simulated pictures to order, a scripted robot, ready-made cases."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import TracebackType
from typing import Self

import mujoco
import numpy as np

from pliant.belief import Belief
from pliant.cell import Camera, Motion, Observation, Stop, Trace, View
from pliant.conditions import Setup
from pliant.errors import RobotFault
from pliant.formations import OWNED, Formation, Goals, Step
from pliant.methods.planar import Planar
from pliant.pose import Axis, Pose
from pliant.records import (
    Case,
    Evidence,
    Execution,
    FailureAnalysis,
    Look,
    Outcome,
    Recovery,
    Verdict,
)
from pliant.sim.arm import HOME_GUESS
from pliant.sim.cell import SimCell, SimRobot
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.measure import measure
from pliant.vision.scene import HoleSeen, Measured, PegSeen, Scene
from pliant.wrist import SensorAnswer

PEGS = ("circle", "square", "rectangle_narrow")
ANSWERS = SensorAnswer(slope=1.0, sd=0.0)
UNSEEN = Scene(peg=None, hole=None, problems=("no peg: scripted", "no hole: scripted"))


# --- the simulated cell ------------------------------------------------------------------------


@lru_cache(maxsize=len(PEGS))  # each takes 0.1 GB
def cell_for(peg: str) -> SimCell:
    """One cell for each of the last pegs: compiling and the first picture take a second."""
    return SimCell()


def prepared(peg: str = "circle", setup: Setup | None = None) -> SimRobot:
    return cell_for(peg).prepare(load_task(peg), setup or Setup(seed=0))


def stand_peg(robot: SimRobot, *, tip_y: float, tip_z: float, lean: float) -> None:
    """Put the middle of the peg's bottom face at (`tip_y`, `tip_z`) [m], leaning `lean` [rad] to
    the left, without physics: for pictures to order."""
    model, data, task = robot.model, robot.data, robot.task
    flange = 0.5 * lean
    below, above = task.tip_below_grasp, task.grasp_below_hinge
    hinge_lean = lean - robot.setup.grasp_roll
    y = tip_y - below * math.sin(lean) - above * math.sin(hinge_lean)
    z = tip_z + below * math.cos(lean) + above * math.cos(hinge_lean)
    pose = Pose(y=y, z=z, roll=flange)
    data.qpos[:] = 0.0
    data.qpos[robot.arm.qpos] = robot.arm.solve(
        pose.position(), pose.rotation(), np.array(HOME_GUESS)
    )
    data.qpos[model.joint("wrist_roll").qposadr[0]] = hinge_lean - flange
    mujoco.mj_forward(model, data)


def picture(robot: SimRobot) -> View:
    return robot.observe().views["side"]


# --- records to order --------------------------------------------------------------------------


def side_camera() -> Camera:
    return shipped().demonstrations[Formation.APPROACH].view.camera


def scene_of(
    *,
    tip_y: float = 0.0,
    tip_z: float = 0.0,
    tilt_deg: float = 0.0,
    hole_y: float = 0.0,
    half: float = 0.02,
    center_px: float = 320.0,
    edge_px: float = 340.0,
    hole_px: float = 320.0,
) -> Scene:
    """A scene as if measured [m, deg, px]."""
    tilt = math.radians(tilt_deg)
    dy, dz = half * math.cos(tilt), half * math.sin(tilt)
    box = ((0.0, 0.0),) * 4
    return Scene(
        peg=PegSeen(
            box_px=(box[0], box[1], box[2], box[3]),
            center_px=(center_px, 100.0),
            edge_px=(edge_px, 200.0),
            tilt_deg=tilt_deg,
            tilt=Measured(value=tilt, sd=0.002),
            tip_y=Measured(value=tip_y, sd=0.0003),
            tip_z=Measured(value=tip_z, sd=0.0003),
            left_y=tip_y - dy,
            left_z=tip_z - dz,
            right_y=tip_y + dy,
            right_z=tip_z + dz,
        ),
        hole=HoleSeen(
            box_px=(box[0], box[1], box[2], box[3]),
            center_px=(hole_px, 300.0),
            y=Measured(value=hole_y, sd=0.0003),
            surface_z=Measured(value=0.0, sd=0.0003),
        ),
    )


def motion_to(pose: Pose, ended: Pose | None = None, stop: Stop = Stop.REACHED) -> Motion:
    trace = Trace(time_s=np.zeros(1), pose=np.zeros((1, 6)), compression_m=np.zeros(1))
    return Motion(
        requested=pose,
        commanded=pose,
        ended=ended or pose,
        stop=stop,
        peak_compression_m=0.020 if stop is Stop.COMPRESSION else 0.004,
        started_s=0.0,
        ended_s=1.0,
        trace=trace,
    )


def outcome_of(
    formation: Formation,
    *,
    goals: Goals | None = None,
    ended: Pose | None = None,
    stop: Stop = Stop.REACHED,
    scene: Scene = UNSEEN,
) -> Outcome:
    """An execution of a formation with the goals in force."""
    goals = goals or shipped().goals
    target = goals.target(formation)
    view = View(camera=side_camera(), time_s=0.0, image=np.zeros((480, 640, 3), np.uint8))
    observation = Observation(
        time_s=0.0, pose=ended or target, compression_m=0.0, views={"side": view}
    )
    return Outcome(
        step=goals.step(formation),
        target=target,
        motions=(motion_to(target, ended, stop),),
        looks=(Look(observation=observation, scene=scene),),
    )


def case_after(outcome: Outcome, goals: Goals | None = None) -> Case:
    return Case(
        task=load_task("circle"),
        teaching=shipped(),
        goals=goals or shipped().goals,
        history=(),
        outcome=outcome,
        evidence=Evidence(checks=()),
        belief=Belief(),
        method=Planar(),
    )


def executed(case: Case, success: bool = False) -> Execution:
    """The case as it stands in the history of a later one."""
    return Execution(
        index=len(case.history),
        outcome=case.outcome,
        evidence=case.evidence,
        belief=case.belief,
        verdict=verdict_of(success),
    )


def recovery_of(*steps: Step) -> Recovery:
    analysis = FailureAnalysis(what="scripted", why="scripted", how="scripted", motion={})
    return Recovery(analysis=analysis, steps=steps, by="scripted")


def verdict_of(success: bool) -> Verdict:
    return Verdict(success=success, reason="scripted", votes={}, conflict=None, by="scripted")


def goal_step(formation: Formation, change: float = 0.0, *, retreat: bool = False) -> Step:
    """The taught goal, changed by some metres along its axis."""
    axis = OWNED[formation][0]
    taught = shipped().goals.formations[formation][axis]
    return step_to(formation, {axis: taught + change}, retreat=retreat)


def step_to(formation: Formation, goal: Mapping[Axis, float], *, retreat: bool = False) -> Step:
    return Step(formation=formation, goal=goal, retreat=retreat)


# --- the loop's partners -----------------------------------------------------------------------


@dataclass(kw_only=True)
class ScriptedRobot:
    """Goes exactly where it is told, sees an empty picture, and keeps what was asked of it.

    `fault` names a call and at which of its uses it breaks: ("observe", 2).
    `blocked_below` is a height [m] under which every motion ends by compression; `answer` is how
    its wrist answers in every motion. `readings` are the compressions [m] that it reads at rest, in
    order, each known to a standard deviation of `sd_m`; then there is none.
    """

    fault: tuple[str, int] | None = None
    blocked_below: float = -math.inf
    answer: SensorAnswer | None = ANSWERS
    readings: Sequence[float] = ()
    sd_m: float = 0.0
    pose: Pose = Pose(z=0.244)
    calls: list[str] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    compression_limits: list[float] = field(default_factory=list)
    waited_s: float = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.calls.append("halt")

    def move_to(self, pose: Pose, *, speed_m_s: float, stop_at_compression_m: float) -> Motion:
        self._called("move_to")
        self.poses.append(pose)
        self.speeds.append(speed_m_s)
        self.compression_limits.append(stop_at_compression_m)
        blocked = pose.z < self.blocked_below
        self.pose = pose.updated({Axis.Z: self.blocked_below}) if blocked else pose
        stop = Stop.COMPRESSION if blocked else Stop.REACHED
        return replace(motion_to(pose, self.pose, stop), answer=self.answer)

    def settle(self, seconds: float) -> None:
        self._called("settle")
        self.waited_s += seconds

    def tare(self) -> None:
        self._called("tare")

    def clock(self) -> float:
        self._called("clock")
        return self.waited_s

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        self._called("observe")
        image = np.zeros((480, 640, 3), np.uint8)
        view = View(camera=side_camera(), time_s=self.waited_s, image=image)
        used = self.calls.count("observe") - 1
        return Observation(
            time_s=self.waited_s,
            pose=self.pose,
            compression_m=self.readings[used] if used < len(self.readings) else 0.0,
            views=dict.fromkeys(cameras, view),
            compression_sd_m=self.sd_m,
        )

    def halt(self) -> None:
        self._called("halt")

    def _called(self, name: str) -> None:
        self.calls.append(name)
        if self.fault == (name, self.calls.count(name)):
            raise RobotFault("lost", f"scripted at {name}")


@dataclass(kw_only=True)
class ScriptedReasoner:
    """Says what it was told to say, in order, and keeps the cases it was shown.

    When the verdicts run out the last one stands; so do the plans.
    """

    verdicts: Sequence[bool] = (True,)
    plans: Sequence[Recovery | None] = (None,)
    name: str = "scripted"
    model: str | None = None
    judged: list[Case] = field(default_factory=list)
    recovered: list[Case] = field(default_factory=list)

    def judge(self, case: Case) -> Verdict:
        self.judged.append(case)
        return verdict_of(self.verdicts[min(len(self.judged), len(self.verdicts)) - 1])

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        self.recovered.append(case)
        return self.plans[min(len(self.recovered), len(self.plans)) - 1]


def seen(robot: SimRobot) -> Scene:
    return measure(picture(robot), robot.task)


def names(executions: Sequence[Execution]) -> list[str]:
    return [str(e.formation) for e in executions]
