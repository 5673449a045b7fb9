"""Controls: reasoners that share the rules' judge, to show what recovery, and reading the evidence,
are worth."""

from dataclasses import dataclass

from pliant.formations import Formation, steps_from
from pliant.pose import Axis
from pliant.reasoners.rules import Rules
from pliant.records import Case, FailureAnalysis, Recovery, Verdict

_SWEEP_M = (0.0, -0.005, 0.005, -0.010, 0.010, -0.015, 0.015, -0.020, 0.020)  # around the taught
_STEP_M = 0.009  # of `messages`: Table I gives a direction and no size


@dataclass(frozen=True)
class OpenLoop(Rules):
    """The paper's baseline: all five skills once with the taught goals, whatever the verdicts."""

    name: str = "none"

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        return None


@dataclass(frozen=True)
class Retry(Rules):
    """Retreat, and repeat from touch-down with the taught goals."""

    name: str = "retry"

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        return _from_the_start(self.name, case, 0.0, "retreat and repeat as taught")


@dataclass(frozen=True)
class Sweep(Rules):
    """Retreat, and repeat with the goals shifted by the next of a fixed list of offsets: a bounded
    search that never reads the evidence."""

    name: str = "sweep"

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        tries = sum(execution.recovery is not None for execution in case.history)
        offset = _SWEEP_M[tries % len(_SWEEP_M)]
        how = f"retreat and repeat {offset * 1e3:+.0f} mm from the taught goals"
        return _from_the_start(self.name, case, offset, how)


@dataclass(frozen=True)
class Messages(Rules):
    """Plan from Table I's words alone, by a fixed step; at Insertion repeat Align. It retreats
    where it would press on after a compression stop."""

    name: str = "messages"

    def recover(self, case: Case, verdict: Verdict) -> Recovery | None:
        table = case.evidence["table_i"]
        words = "" if table is None else table.message
        failed = case.outcome.step.formation
        start = failed if failed in (Formation.FIT, Formation.ALIGN) else Formation.ALIGN
        shift = _STEP_M * _direction(words, failed)
        current = case.goals.formations
        goals = {**current, start: {Axis.Y: current[start][Axis.Y] + shift}}
        steps = steps_from(start, goals)
        if case.method.presses_on(steps[0], case):
            steps = steps_from(start, goals, retreat=True)
        analysis = FailureAnalysis(
            what=words or verdict.reason,
            why="not asked",
            how=f"{start} {shift * 1e3:+.0f} mm" if shift else f"repeat {start}",
            motion={Axis.Y: shift},
        )
        return Recovery(analysis=analysis, steps=steps, by=self.name)


def _direction(words: str, failed: Formation) -> int:
    """The direction along y, +1 or -1, by Table I's message; 0 where it names none. A position
    outweighs a lean: a peg that leans left is righted by moving right."""
    if "too small" in words:
        return 1
    if "too big" in words:
        return -1
    if "tilted to the left" in words:
        return 1
    if "tilted to the right" in words:
        return -1
    return -1 if failed is Formation.FIT else 0  # Fit failed unnoticed by Table I: travel on


def _from_the_start(name: str, case: Case, offset: float, how: str) -> Recovery:
    """Touch down again and repeat, with Fit's and Align's taught goals shifted by `offset` [m]."""
    taught = case.teaching.goals.formations
    shifted = {f: {Axis.Y: taught[f][Axis.Y] + offset} for f in (Formation.FIT, Formation.ALIGN)}
    analysis = FailureAnalysis(
        what="the verdict was failure", why="not asked", how=how, motion={Axis.Y: offset}
    )
    steps = steps_from(Formation.FIT, {**taught, **shifted}, retreat=True)
    return Recovery(analysis=analysis, steps=steps, by=name)
