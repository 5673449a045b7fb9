"""The loop: step, outcome, evidence, verdict, on failure recovery and admitted steps (Sec. III).

The loop is an iterator of executions, so that an experiment samples truth between them, a terminal
shows them as they happen, and an environment drives it step by step.
"""

import math
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial

from pliant.belief import Belief, descent_of
from pliant.cell import Robot
from pliant.checks import doubt, slid, sunk
from pliant.diagnosis import blames_camera, weighed
from pliant.envelope import Guarded, Limits
from pliant.errors import RobotFault
from pliant.formations import Formation, Step
from pliant.methods import Method
from pliant.pose import Pose
from pliant.records import Aborted, Case, End, Execution, Look, Recovery, Verdict
from pliant.recovery import Inquirer, Reasoner, admit
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.measure import SIMULATED
from pliant.vision.sight import Sight
from pliant.vision.surround import SIDE

_FRESH_S = 0.15  # a picture so old is stale


@dataclass(frozen=True, kw_only=True)
class Patience:
    """The limits at which a trial gives up: failed verdicts in a row during recovery (the paper's
    ten), executions. And how many probes it grants."""

    failures: int = 10
    executions: int = 40
    probes: int = 4


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
        self._slid_m, self._sunk_m, self._seen_z = 0.0, 0.0, math.inf
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
            guarded.sees_depth = None  # else run, robot and its model wait for the collector

    def _turns(self, robot: Guarded) -> Iterator[Question | Execution]:
        goals = self.teaching.goals
        skill = self.method.skill(self.task, self.teaching, self.limits)
        queue = deque(goals.step(formation) for formation in Formation)
        robot.sees_depth = lambda: sunk(self._look(robot).scene)
        failures = 0
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
            self._bound(robot)
            outcome = skill(robot, partial(self._look, robot), target, step, self.belief)
            self._believe(step, outcome.looks)
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
                self._slid_m = self._slid_m if now is None else now
            self._see_depth(outcome.looks[-1])
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
            recovery = admission = fault = None
            done = verdict.success and step.formation is Formation.INSERTION
            out_of_patience = failures >= self.patience.failures
            if not verdict.success and not out_of_patience:
                case, fault = self._probed(robot, case, verdict)
            if not verdict.success and not out_of_patience and fault is None:
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
                probes=case.probes,
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
            if fault is not None:
                raise fault
            if self.end_reason:
                return

    def _probed(
        self, robot: Guarded, case: Case, verdict: Verdict
    ) -> tuple[Case, RobotFault | None]:
        """The case with the probes that the reasoner asks for, as many as the trial grants; and the
        fault that ended one: the execution before it has been judged, and is kept."""
        if self.method.prober is None or not isinstance(self.reasoner, Inquirer):
            return case, None
        prober = self.method.prober(self.task, self.teaching, self.limits)
        made = sum(len(execution.probes) for execution in self.history)
        case = replace(case, probes_left=self.patience.probes - made)
        while case.probes_left > 0:
            probe = self.reasoner.inquire(case, verdict)
            if probe is None:
                break
            self._bound(robot)
            try:
                found = prober(robot, partial(self._look, robot), probe, self.belief)
            except RobotFault as fault:
                return case, fault
            self._believe(case.goals.step(Formation.APPROACH), found.looks)
            self._see_depth(found.looks[-1])
            case = replace(
                case,
                belief=self.belief,
                probes=(*case.probes, found),
                probes_left=case.probes_left - 1,
            )
        return case, None

    def _bound(self, robot: Guarded) -> None:
        """Bound how low the hand may go, by what is believed of board and peg."""
        robot.descent = descent_of(
            self.belief,
            self.task,
            self.teaching,
            slid_m=self._slid_m,
            sunk_m=self._sunk_m,
            seen_z=self._seen_z,
        )

    def _see_depth(self, look: Look) -> None:
        """Keep how deep the tip is in the hole, and where the hand is."""
        now_m = sunk(look.scene) or 0.0
        self._sunk_m = max(self._sunk_m, now_m) if now_m else 0.0  # as deep as the way was free
        self._seen_z = look.observation.pose.z

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

    def _believe(self, step: Step, looks: Sequence[Look]) -> None:
        for look in looks:
            self.belief = self.method.believe(self.belief, look.during(step), self.teaching)
