"""The loop: step, outcome, evidence, verdict, on failure recovery and admitted steps (Sec. III).

The loop is an iterator of executions, so that an experiment samples truth between them, a terminal
shows them as they happen, and an environment drives it step by step.
"""

import math
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial

from pliant.belief import Belief, Seen, descent_of
from pliant.cell import Robot
from pliant.checks import doubt, slid, sunk
from pliant.diagnosis import blames_camera, weighed
from pliant.envelope import Guarded, Limits
from pliant.errors import RobotFault
from pliant.formations import Formation, Step
from pliant.methods import Method
from pliant.pose import Pose
from pliant.records import (
    Aborted,
    Case,
    End,
    Execution,
    Look,
    Outcome,
    Recovery,
    Verdict,
)
from pliant.recovery import Reasoner, admit
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.measure import SIMULATED
from pliant.vision.sight import Sight
from pliant.vision.surround import SIDE

_FRESH_S = 0.15  # a picture so old is stale


@dataclass(frozen=True, kw_only=True)
class Patience:
    """The limits at which a trial gives up: failed verdicts in a row during recovery (the paper's
    ten), executions."""

    failures: int = 10
    executions: int = 40


@dataclass(kw_only=True, eq=False)
class Question:
    """A failed execution that calls for a recovery. Whoever takes the turns sets the answer before
    the next one; None keeps to the plan."""

    case: Case
    verdict: Verdict
    answer: Recovery | None = None


@dataclass(kw_only=True, eq=False)
class Run:
    """A trial being run: iterate over it once; afterwards it holds how it ended.

    `sight` None: the method's own, for the colours of the simulation. `aborted` is the execution
    that was begun and not judged when it ended, `clock_s` the robot's after the last.
    """

    robot: Robot
    task: Task
    teaching: Teaching
    reasoner: Reasoner
    method: Method
    limits: Limits = field(default_factory=Limits)
    patience: Patience = field(default_factory=Patience)
    sight: Sight | None = None

    def __post_init__(self) -> None:
        self.history: list[Execution] = []
        self.belief = Belief()
        self.end_reason = ""
        self.fault = ""
        self.aborted: Aborted | None = None
        self.clock_s = 0.0
        self._begun: tuple[Step, Pose] | None = None
        self._sight = self.sight or self.method.sight(self.task, self.teaching, SIMULATED)

    def __iter__(self) -> Generator[Execution, None, None]:
        """The executions; the reasoner answers."""
        with closing(self.turns()) as turns:
            for turn in turns:
                if isinstance(turn, Question):
                    turn.answer = self.reasoner.recover(turn.case, turn.verdict)
                else:
                    yield turn

    def turns(self) -> Generator[Question | Execution, None, None]:
        """The executions, and before each that calls for a recovery its question: for whoever
        answers in the reasoner's place. The reasoner judges."""
        guarded = Guarded(self.robot, self.limits)
        try:
            with guarded as robot:
                yield from self._turns(robot)
        except RobotFault as fault:
            self.end_reason, self.fault = fault.end_reason, str(fault)
        finally:  # also when whoever takes the turns leaves, as by Ctrl-C
            self.aborted = self._unfinished(guarded)

    def _turns(self, robot: Guarded) -> Iterator[Question | Execution]:
        goals = self.teaching.goals
        skill = self.method.skill(self.task, self.teaching, self.limits)
        queue = deque(goals.step(formation) for formation in Formation)
        robot.sees_depth = lambda: sunk(self._look(robot).scene)
        failures, slid_m, sunk_m, seen_z = 0, 0.0, 0.0, math.inf
        while True:
            if not queue:
                self.end_reason = End.FINISHED
                return
            if len(self.history) >= self.patience.executions:
                self.end_reason = End.CAP
                return
            step = queue.popleft()
            goals = goals.updated(step)
            target = goals.target(step.formation)
            robot.motions.clear()
            self._begun = step, target
            robot.descent = descent_of(
                self.belief,
                self.task,
                self.teaching,
                slid_m=slid_m,
                sunk_m=sunk_m,
                seen_z=seen_z,
            )
            outcome = skill(robot, partial(self._look, robot), target, step, self.belief)
            self._believe(outcome)
            problem = doubt(
                self.task, outcome, self.belief, self.teaching, answered=robot.has_answered
            )
            signs = self.method.signs(self.task, self.history, outcome, self.belief)
            diagnosis = None if signs is None else weighed(signs)
            # Of a sensor that has answered and a picture that contradicts it, the picture may lie.
            lies = robot.has_answered and blames_camera(diagnosis)
            if problem is not None and not lies:
                robot.halt()
                raise RobotFault("sensor", f"the wrist's compression cannot be believed: {problem}")
            if robot.has_answered:  # else what is not felt may be the sensor's fault
                now = slid(self.task, outcome, self.belief, self.teaching)
                slid_m = slid_m if now is None else now
            now_m = sunk(outcome.scene) or 0.0
            sunk_m = max(sunk_m, now_m) if now_m else 0.0  # as deep as the way was free
            seen_z = outcome.pose.z
            evidence = self.method.check(self.task, outcome, self.belief, self.teaching)
            case = Case(
                task=self.task,
                teaching=self.teaching,
                goals=goals,
                history=tuple(self.history),
                outcome=outcome,
                evidence=evidence.with_signs(diagnosis),
                belief=self.belief,
                method=self.method,
                colours=self._sight.colours,
                diagnosis=diagnosis,
            )
            verdict = self.reasoner.judge(case)
            failures = 0 if verdict.success else failures + 1
            recovery = admission = None
            done = verdict.success and step.formation is Formation.INSERTION
            out_of_patience = failures >= self.patience.failures
            if not verdict.success and not out_of_patience:
                question = Question(case=case, verdict=verdict)
                yield question
                recovery = question.answer
                if recovery is not None:
                    admission = admit(recovery, case, self.limits)
                    queue = deque(admission.steps)
            execution = Execution(
                index=len(self.history),
                outcome=outcome,
                evidence=case.evidence,
                belief=case.belief,
                verdict=verdict,
                diagnosis=diagnosis,
                recovery=recovery,
                admission=admission,
            )
            self.history.append(execution)
            self._begun = None
            self.clock_s = robot.clock()
            if done:
                self.end_reason = End.INSERTED
            elif out_of_patience:
                self.end_reason = End.EXHAUSTED
            elif recovery is not None and not queue:
                self.end_reason = End.REFUSED if recovery.steps else End.STOPPED
            elif verdict.success and not queue:  # a plan that ended early goes on in order
                queue.append(goals.step(list(Formation)[step.formation.order + 1]))
            yield execution
            if self.end_reason:
                return

    def _unfinished(self, robot: Guarded) -> Aborted | None:
        if self._begun is None:
            return None
        step, target = self._begun
        return Aborted(
            step=step, target=target, motions=tuple(robot.motions), under_way=robot.under_way
        )

    def _look(self, robot: Guarded, cameras: Sequence[str] = (SIDE,)) -> Look:
        observation = robot.observe(cameras)
        for _ in range(self.method.retakes):
            if all(v.time_s >= observation.time_s - _FRESH_S for v in observation.views.values()):
                break
            observation = robot.observe(cameras)
        return Look(observation=observation, scene=self._sight(observation))

    def _believe(self, outcome: Outcome) -> None:
        for look in outcome.looks:
            seen = Seen(step=outcome.step, pose=look.observation.pose, scene=look.scene)
            self.belief = self.method.believe(self.belief, seen, self.teaching)
