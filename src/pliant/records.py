"""Records of what a trial saw, thought and did: frozen, and flowing one way.

    Step -> Outcome -> Evidence -> Verdict -> (on failure) Recovery -> admitted Steps

A trial is the list of its executions; it can be stored, replayed, shown and scored.
"""

import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from html import escape
from typing import Annotated, Any, Protocol

from pydantic import AliasChoices, Field, PlainSerializer, PlainValidator

from pliant import pictures
from pliant.belief import Belief, Seen
from pliant.cell import Image, Motion, Observation, Stop, Truth
from pliant.diagnosis import OF_FAULTS, Diagnosis, Hypothesis
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.formations import OWNED, Formation, Goals, Step
from pliant.pose import Axis, Partial, Pose
from pliant.task import Task
from pliant.teaching import Teaching
from pliant.vision.measure import Colours
from pliant.vision.scene import Scene

_THUMBNAIL = 120  # [px] width of a picture in a notebook's view

SCHEMA = 2
"""Version of everything stored. A reader refuses another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """An observation and what was measured in its pictures."""

    observation: Observation
    scene: Scene

    def during(self, step: Step) -> Seen:
        """This look as a belief takes it: with the step during which it was taken."""
        return Seen(step=step, pose=self.observation.pose, scene=self.scene)


class Looking(Protocol):
    """Takes pictures with the named cameras, now, and measures them."""

    def __call__(self, cameras: Sequence[str] = ("side",)) -> Look: ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """One execution of a skill: the pose it was sent to, its motions, and the looks it took."""

    step: Step
    target: Pose
    motions: tuple[Motion, ...]
    looks: tuple[Look, ...]

    @property
    def pose(self) -> Pose:
        """The terminal pose p_e."""
        return self.looks[-1].observation.pose

    @property
    def scene(self) -> Scene:
        return self.looks[-1].scene

    @property
    def stop(self) -> Stop:
        """The stop of the whole execution: compression if any motion was stopped by it."""
        stopped = any(m.stop is Stop.COMPRESSION for m in self.motions)
        return Stop.COMPRESSION if stopped else Stop.REACHED

    @property
    def peak_compression_m(self) -> float:
        return max((m.peak_compression_m for m in self.motions), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Check:
    """One source's vote on success. `vote` None: it could not be made, and `message` says why.

    `paper` is False for the checks that pliant adds.
    """

    name: str
    vote: bool | None
    message: str
    paper: bool = True


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """All checks of one execution."""

    checks: tuple[Check, ...]

    def __getitem__(self, name: str) -> Check | None:
        return next((c for c in self.checks if c.name == name), None)

    @property
    def votes(self) -> dict[str, bool | None]:
        return {c.name: c.vote for c in self.checks}

    def with_signs(self, diagnosis: Diagnosis | None) -> "Evidence":
        """This, and what does not fit the task: it fails an execution where no attempt can help,
        and has no vote until then."""
        if diagnosis is None or not diagnosis.signs:
            return self
        vote = False if diagnosis.is_hopeless else None
        message = f"{diagnosis}: {diagnosis.why}"
        check = Check(name="plausible", vote=vote, message=message, paper=False)
        return Evidence(checks=(*self.checks, check))


@dataclass(frozen=True, kw_only=True, eq=False)
class Exchange:
    """One request to a model and its reply, as text and with the pictures that were sent.

    `stage` is judge, probe, analyse or plan; `refused` says why the reply could not be used, or why
    there was none, and is empty when it was used. `cost_usd` None: the price is not known.
    """

    stage: str
    request: str
    reply: str
    model: str
    pictures: tuple[Image, ...] = field(default=(), repr=False)
    input_tokens: int = 0
    cached_tokens: int = 0  # of the input
    output_tokens: int = 0
    latency_s: float = 0.0
    cost_usd: float | None = None
    refused: str = ""
    note: str = ""

    @property
    def tokens(self) -> int:
        return self.input_tokens + self.output_tokens


class Decision:
    """The part that a verdict and a recovery have in common: who the decision came from in the
    end."""

    exchanges: tuple[Exchange, ...]
    fallback: str

    @property
    def is_asked(self) -> bool:
        """Whether the decision was put to a model."""
        return bool(self.exchanges or self.fallback)

    @property
    def is_own(self) -> bool:
        """Whether a model made it: it was asked, and its last reply was used as it came."""
        answered = bool(self.exchanges) and not self.exchanges[-1].refused
        return answered and not self.fallback


@dataclass(frozen=True, kw_only=True)
class Verdict(Decision):
    """The judgement of one execution: each source's vote, and what conflicted.

    `fallback` says why the rules answered in a model's place; empty: the answer is `by`'s own.
    """

    success: bool
    reason: str
    votes: Mapping[str, bool | None]
    conflict: str | None
    by: str
    exchanges: tuple[Exchange, ...] = ()
    fallback: str = ""


@dataclass(frozen=True, kw_only=True)
class FailureAnalysis:
    """The analysis of a failure: what happened, why, how to recover, and the motion from the
    current goal (Sec. V-B). `changes` are the motions from each current goal, where they were told
    one by one."""

    what: str
    why: str
    how: str
    motion: Partial
    changes: Mapping[Formation, Partial] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Recovery(Decision):
    """An analysis and the steps that follow from it; no steps: stop. A reasoner that gives no
    Recovery at all keeps to the plan it has.

    `fallback` as in Verdict. `clamped` holds the steps a model proposed where `steps` are these
    cut down to what may be done; None: nothing was cut.
    """

    analysis: FailureAnalysis
    steps: tuple[Step, ...]
    by: str
    exchanges: tuple[Exchange, ...] = ()
    fallback: str = ""
    clamped: tuple[Step, ...] | None = None

    @property
    def is_own(self) -> bool:
        """Whether a model made it, and nothing was cut."""
        return super().is_own and self.clamped is None

    @property
    def no_answer_about_probes(self) -> str:
        """The reason why a model gave no usable answer when it was asked whether it needs a probe;
        empty: it did, or was not asked."""
        asked = [exchange for exchange in self.exchanges if exchange.stage == "probe"]
        return asked[-1].refused if asked else ""


@dataclass(frozen=True, kw_only=True)
class Probe(Decision):
    """What a reasoner asks for where it is in doubt, before it plans: to lift the peg out, look
    with every camera, and touch with the peg's low corner `at` (x, y) [m] from the middle of the
    believed hole; None: look only. `reason` says why.

    Raises:
        InputError: the place is no finite numbers.
    """

    reason: str
    at: tuple[float, float] | None
    by: str
    exchanges: tuple[Exchange, ...] = ()
    fallback: str = ""

    def __post_init__(self) -> None:
        if self.at is not None and not all(math.isfinite(value) for value in self.at):
            x, y = self.at
            raise InputError(f"a probe at x {x:g}, y {y:g} m: it must be finite numbers")


@dataclass(frozen=True, kw_only=True, eq=False)
class Probed:
    """The result of a probe. `held_m` is how far the wrist was stretched as the peg was lifted [m],
    `touched_z` the height of the low corner where it was felt [m], in the task frame; None: it was
    not, and `note` says how far down, or why it did not go there."""

    probe: Probe
    motions: tuple[Motion, ...]
    looks: tuple[Look, ...]
    held_m: float
    touched_z: float | None = None
    note: str = ""

    def __str__(self) -> str:
        pulled = f"pulled at, the peg stretched the wrist by {self.held_m * 1e3:.1f} mm"
        if self.probe.at is None:
            return f"look with the peg lifted out; {pulled}"
        x, y = (f"{value * 1e3:+.1f}" for value in self.probe.at)
        felt = self.note
        if self.touched_z is not None:
            felt = f"felt at z {self.touched_z * 1e3:.1f} mm"
        return f"touch at x {x}, y {y} mm from the believed hole: {felt}; {pulled}"


@dataclass(frozen=True, kw_only=True)
class Admission:
    """The steps of a recovery that may be done, and why the rest may not."""

    steps: tuple[Step, ...]
    refusals: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Execution:
    """One commanded formation skill, with everything that followed from it."""

    index: int
    outcome: Outcome
    evidence: Evidence
    belief: Belief
    verdict: Verdict
    diagnosis: Diagnosis | None = None
    recovery: Recovery | None = None
    admission: Admission | None = None
    probes: tuple[Probed, ...] = ()  # before the recovery was planned

    @property
    def formation(self) -> Formation:
        return self.outcome.step.formation

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All motions: the skill's, then those of its probes."""
        return (*self.outcome.motions, *(m for probed in self.probes for m in probed.motions))


@dataclass(frozen=True, kw_only=True, eq=False)
class Aborted:
    """An execution that a fault ended before it was judged. `under_way` is where the arm was being
    sent when it came; None: it stood still."""

    step: Step
    target: Pose
    motions: tuple[Motion, ...]  # those that were done
    under_way: Pose | None


class KnownMethod(Protocol):
    """All that a reasoner may know of the method that does its plans (`pliant.methods.Method`)."""

    @property
    def name(self) -> str:
        """The method's name, as results have it. A reasoner asks the method, and compares no
        names."""
        ...

    @property
    def plannable(self) -> Mapping[Formation, tuple[Axis, ...]]:
        """The axes that a plan may name in each formation: those that the formation owns, which it
        must name, and after them the shifts."""
        ...

    @property
    def follows_belief(self) -> bool:
        """Whether the skills correct themselves by what is seen and believed: of a goal then only
        the shift from the taught one counts, and a model is told the measurements."""
        ...

    @property
    def words(self) -> Mapping[str, str]:
        """The method's own words for a model, by the name of the prompt: "task" says what the
        skills do. Where it has none, the common ones are used."""
        ...

    def presses_on(self, step: Step, case: "Case") -> bool:
        """Whether a step, done next, would go on loading a wrist that the compression limit has
        just stopped."""
        ...

    def plan(self, case: "Case", verdict: Verdict, by: str) -> Recovery | None:
        """The next steps by rules after a failed execution, signed `by` whoever asks; None: keep to
        the plan."""
        ...


def shifts(method: KnownMethod, formation: Formation) -> tuple[Axis, ...]:
    """The axes that a step may name beside those that its formation owns: how far from what is
    believed to aim. A shift holds for its step alone; goals hold none."""
    return tuple(a for a in method.plannable[formation] if a not in OWNED[formation])


def _is_method(value: Any) -> Any:
    """Refuse a name as a method: whoever reads a case puts the method in its place, as records know
    no methods."""
    if isinstance(value, str):
        raise ValueError(f"the method {value!r} was not looked up")
    return value


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """All that a reasoner may know when it judges or recovers: serialisable, so that a stored case
    can be judged again. `goals` are the ones in force, updated by the recoveries so far; `colours`
    None: those of peg and block may be anything; `diagnosis` None: the method does not look for
    what is not as the task says. `probes` are those made since the execution, `probes_left` how
    many more the trial grants."""

    task: Task
    teaching: Teaching = field(repr=False)
    goals: Goals
    history: tuple[Execution, ...]
    outcome: Outcome
    evidence: Evidence
    belief: Belief
    method: Annotated[
        KnownMethod, PlainValidator(_is_method), PlainSerializer(lambda method: method.name)
    ]
    colours: Colours | None = None
    diagnosis: Diagnosis | None = None
    probes: tuple[Probed, ...] = ()
    probes_left: int = 0

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes of all executions so far, the last one's included."""
        return (*(execution.outcome for execution in self.history), self.outcome)


class End(StrEnum):
    """The way in which a trial ended. A fault is written `fault:<kind>`."""

    INSERTED = "inserted"  # judged so
    EXHAUSTED = "exhausted"  # ten failed verdicts in a row
    CAP = "cap"  # forty executions
    STOPPED = "stopped"  # the reasoner said that it cannot or should not go on
    REFUSED = "refused"  # nothing of its plan may be done
    FINISHED = "finished"  # an open-loop plan ran out


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trial:
    """A whole trial, as it is stored."""

    trial_id: str
    task: Task
    level: str  # or the scenario; as `condition` and `seed`, the experiment's to know
    condition: str
    seed: int
    reasoner: str
    model: str | None
    goals: Goals
    executions: tuple[Execution, ...]
    end_reason: str
    fault: str  # what the cell said, for `fault:<kind>`
    simulated_s: float
    wall_s: float
    drawn: Mapping[str, float] = field(default_factory=dict)  # the setup: truth
    truths: tuple[Truth, ...] = ()  # after each execution; kept apart, so that no Case holds one
    aborted: Aborted | None = None  # the execution during which `fault` happened
    cell: str = "sim"  # the kind of workcell
    method: Annotated[str, Field(validation_alias=AliasChoices("method", "skills"))] = "planar"
    limits: Limits = field(default_factory=Limits)  # of the envelope

    @property
    def judged(self) -> bool:
        """Whether the verdict on Insertion was success: the paper's F."""
        last = self.executions[-1] if self.executions else None
        return last is not None and last.formation is Formation.INSERTION and last.verdict.success

    @property
    def diagnosis(self) -> Diagnosis | None:
        """What was believed to be so in the end: a fault of the cell that says it, or the last
        execution's; unknown where a reasoner stopped without a sign. None: the method did not look
        for it."""
        said = OF_FAULTS.get(self.end_reason)
        if said is not None:
            sees = any(look.scene.peg for e in self.executions for look in e.outcome.looks)
            return Diagnosis(weights={said[sees]: 1.0})
        last = self.executions[-1].diagnosis if self.executions else None
        if last is None:
            return None
        if self.end_reason == End.STOPPED and last.is_as_told:
            return Diagnosis(weights={Hypothesis.UNKNOWN: 1.0})
        return last

    @property
    def inserted(self) -> bool | None:
        """Whether the peg is inserted in truth, where it is known: the paper's G."""
        return self.truths[-1].inserted if self.truths else None

    def __repr__(self) -> str:
        return f"<Trial {self.trial_id}: {self._ended}>"

    def _repr_html_(self) -> str:
        """A notebook's view: each execution with its last picture, how it was judged and why."""
        rows = "".join(
            f"<tr><td>{_thumbnail(e)}</td><td>{e.index + 1}</td><td>{e.formation}</td>"
            f"<td>{'success' if e.verdict.success else 'failure'}</td>"
            f"<td>{escape(e.verdict.reason)}</td></tr>"
            for e in self.executions
        )
        return f"<p><b>{escape(self.trial_id)}</b>: {escape(self._ended)}</p><table>{rows}</table>"

    @property
    def _ended(self) -> str:
        known = {True: "inserted", False: "not inserted", None: "not labelled"}[self.inserted]
        return f"{self.end_reason}, {known}, {len(self.executions)} executions"


def _thumbnail(execution: Execution) -> str:
    """The execution's last side picture, small, as HTML; empty where there is none."""
    views = execution.outcome.looks[-1].observation.views if execution.outcome.looks else {}
    if "side" not in views:
        return ""
    small = pictures.shrunk(views["side"].image, _THUMBNAIL)
    data = b64encode(pictures.encoded(small)).decode()
    return f'<img src="data:image/png;base64,{data}" alt="{execution.formation}">'
