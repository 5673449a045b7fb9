"""`pliant/Recovery-v0`: one step is one recovery decision of the paper's loop (Sec. V-B).

The loop runs with the taught goals and the rules' judge until an execution fails; the agent sees
what the case holds, in numbers (`decision.FIELDS`), and answers with a plan (`decision.ACTION`).
What may be done of it is done, up to the next failed execution. A plan of which nothing may be done
changes nothing, and costs as one execution.

An episode is a trial in which something fails; a drawn trial without a failure is drawn again. It
ends when the peg is judged inserted, and is cut short when the loop's patience ends (ten failed
verdicts in a row, forty executions), at a fault, or, through `gymnasium.make`, after 20 decisions.
"""

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pliant.conditions import Condition
from pliant.envelope import Limits
from pliant.envs.common import (
    RENDER_MODES,
    CellEnv,
    check_action,
    known,
)
from pliant.envs.decision import ACTION, FIELDS, as_recovery, numbers
from pliant.errors import InputError
from pliant.experiment.one import Spec, composed
from pliant.reasoners.rules import Rules
from pliant.records import Case, End, Execution, Recovery, Verdict
from pliant.recovery import admit
from pliant.teaching import shipped
from pliant.trial import Question

NAME = "agent"
INSERTED, EXECUTION_COST = 1.0, 0.05
_DRAWS = 30


class RecoveryEnv(CellEnv[NDArray[np.float32]]):
    """Recover from failures, one decision per step.

    `peg` is a shipped peg's name or a peg file, `condition` what is drawn, by name or as a
    Condition. The reward is `INSERTED` when the peg is judged inserted and is, less
    `EXECUTION_COST` for each formation skill that followed from the decision.

    Raises:
        InputError: an option cannot be used; in `reset`, if no trial of the condition fails.
    """

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": 1}  # noqa: RUF012
    needs_reset = "render"

    def __init__(
        self,
        *,
        peg: str = "circle",
        level: str = "L0",
        condition: str | Condition = "all",
        render_mode: str | None = None,
    ) -> None:
        super().__init__(render_mode)
        self._spec = Spec.named(peg=peg, level=level, condition=condition, reasoner=NAME)
        self._teaching = shipped().for_task(self._spec.task)
        self._limits = Limits()
        self._judge = _Judge()
        self._turns: Generator[Question | Execution, None, None] | None = None
        self._question: Question | None = None
        low, high = np.array(list(FIELDS.values()), np.float32).T
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (len(ACTION),), np.float32)

    @property
    def question(self) -> Question:
        """The case that is to be answered, and its verdict: for a policy that reads records."""
        if self._question is None:
            raise gymnasium.error.ResetNeeded("nothing is asked: call reset")
        return self._question

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Run a trial to its first failure: `seed`'s, the same that an experiment runs, or where
        nothing fails in it, or no seed is given, the next that fails of this environment's own
        stream. `info` has the trial's seed."""
        super().reset(seed=seed, options=options)
        for draw in range(_DRAWS):
            trial = self._drawn_seed() if seed is None or draw else seed
            self._begin(trial)
            if self._question is not None:
                return self._observe(), {"seed": trial, **self._info()}
        raise InputError(
            f"condition '{self._spec.condition.name}': nothing failed in {_DRAWS} trials; choose"
            " one in which something does"
        )

    def step(
        self, action: NDArray[Any]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Make one decision. `info` has why steps of it were `refused`, the `formation` and the
        `reason` of the last verdict, `executions` so far, the loop's `end_reason`, what a `fault`
        said, and the `truth`, which is not for a policy."""
        question = self.question
        values = check_action(action, len(ACTION))
        answer = as_recovery(values, question.case, question.verdict, NAME)
        admission = admit(answer, question.case, self._limits)
        before = self._executions()
        if admission.steps:
            question.answer = answer
            self._go_on()
        cost = EXECUTION_COST * max(1, self._executions() - before)
        terminated = self._run.end_reason == End.INSERTED
        truncated = bool(self._run.end_reason) and not terminated
        inserted = terminated and bool(self._cell.truth().inserted)
        reward = (INSERTED if inserted else 0.0) - cost
        info = self._info("; ".join(admission.refusals))
        return self._observe(), reward, terminated, truncated, info

    # --- inside ----------------------------------------------------------------------------------

    def _begin(self, trial: int) -> None:
        if self._turns is not None:
            self._turns.close()  # it halts the robot, which must not be the new trial's
        spec = replace(self._spec, seed=trial)
        self._setup = spec.condition.draw(trial)
        self._robot = self._cell.prepare(spec.task, self._setup)
        self._judge = _Judge()
        self._run = composed(
            spec, self._robot, self._setup, self._teaching, self._judge, limits=self._limits
        )
        self._turns = self._run.turns()
        self._go_on()

    def _go_on(self) -> None:
        """Run the trial to the next question, or to its end."""
        assert self._turns is not None, "a trial has begun"
        self._question = next((t for t in self._turns if isinstance(t, Question)), None)

    def _executions(self) -> int:
        """The number of executions so far, the one in question included."""
        return len(self._run.history) + (self._question is not None)

    def _observe(self) -> NDArray[np.float32]:
        return numbers(*self._judge.last())

    def _info(self, refused: str = "") -> dict[str, Any]:
        case, verdict = self._judge.last()
        return {
            "formation": str(case.outcome.step.formation),
            "reason": verdict.reason,
            "executions": self._executions(),
            "refused": refused,
            "end_reason": str(self._run.end_reason),
            "fault": self._run.fault,
            "truth": known(self._cell.truth(), self._setup),
        }


class _Judge:
    """The rules' judge, which keeps what it judged last. The agent recovers in its place."""

    name = NAME

    def __init__(self) -> None:
        self._last: tuple[Case, Verdict] | None = None

    def judge(self, case: Case) -> Verdict:
        verdict = Rules().judge(case)
        self._last = case, verdict
        return verdict

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        return None

    def last(self) -> tuple[Case, Verdict]:
        assert self._last is not None, "an execution was judged"
        return self._last
