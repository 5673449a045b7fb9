"""Teaching goals as a state machine: what each key does, without a terminal and without a robot.

`decide` answers a key with the next state and, where the robot has to act, a command. Whoever
carries the command out tells the session how it went: `moved`, `taken`, `guided`. A goal is the set
point, what will be commanded in a trial; the pose measured there stands beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pliant.cell import Motion, Observation, Stop, View
from pliant.commissioning.keys import ANGLES_DEG, LENGTHS_MM, Do, Intent, Jog, StepOf
from pliant.envelope import Limits
from pliant.formations import OWNED, Formation, Goals
from pliant.pose import Axis, Partial, Pose, describe
from pliant.teaching import Demonstration, Teaching, taught
from pliant.vision.measure import SIMULATED, Colours
from pliant.vision.scene import Scene

_SAME = 0.05  # [mm, deg] within which an axis that a formation keeps counts as kept


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One formation as it was taught: the whole set point, the pose measured there, the picture."""

    formation: Formation
    goal: Pose
    pose: Pose
    view: View = field(repr=False)


@dataclass(frozen=True)
class MoveTo:
    """A command to go straight to a pose."""

    pose: Pose


@dataclass(frozen=True)
class Guide:
    """A command to let a hand lead the arm, or to hold it again."""

    on: bool


@dataclass(frozen=True)
class Take:
    """A command to come to rest, look, and record."""


@dataclass(frozen=True)
class Tare:
    """A command to count compression from here."""


@dataclass(frozen=True)
class Finish:
    """A command to write the goals."""


@dataclass(frozen=True)
class Quit:
    """A command to halt and end."""


Command = MoveTo | Guide | Take | Tare | Finish | Quit


@dataclass(frozen=True, kw_only=True, eq=False)
class Session:
    """The state of teaching: where the arm is told to be, which formation is being taught (None:
    all are), the step sizes, and everything recorded, oldest first."""

    at: Pose
    log: tuple[Record, ...] = ()
    formation: Formation | None = Formation.APPROACH
    length_mm: float = LENGTHS_MM[1]
    angle_deg: float = ANGLES_DEG[1]
    is_guided: bool = False
    note: str = ""

    @property
    def records(self) -> Mapping[Formation, Record]:
        """The latest record of each formation that was taught."""
        return {record.formation: record for record in self.log}

    def astray(self, formation: Formation, pose: Pose) -> Partial:
        """The axes that `formation` does not set and `pose` has elsewhere, with what they will be
        in a trial: as the formations before taught them; x, pitch and yaw, which none sets, 0."""
        kept = {axis: 0.0 for axis in Axis if all(axis not in owned for owned in OWNED.values())}
        for earlier in list(Formation)[: formation.order]:
            if earlier in self.records:
                kept |= {axis: self.records[earlier].goal[axis] for axis in OWNED[earlier]}
        return {
            axis: value
            for axis, value in kept.items()
            if axis not in OWNED[formation] and abs(axis.to_report(pose[axis] - value)) > _SAME
        }

    def stale(self) -> list[Formation]:
        """The formations taught at a pose that an earlier formation, taught since, has changed."""
        return [f for f in Formation if f in self.records and self._is_stale(f)]

    def open(self) -> list[Formation]:
        """The formations that are still to be taught, or to be taught again."""
        return [f for f in Formation if f not in self.records or self._is_stale(f)]

    def teaching(self, peg: str, colours: Colours = SIMULATED) -> Teaching:
        """The taught goals and their pictures, with `peg`'s name or file, in these `colours`. Every
        formation must have been taught."""
        records = self.records
        goals = {f: {axis: records[f].goal[axis] for axis in OWNED[f]} for f in Formation}
        shown = {
            f: Demonstration(formation=f, pose=records[f].pose, peg=peg, view=records[f].view)
            for f in Formation
        }
        return taught(Goals(formations=goals), shown, colours)

    def _is_stale(self, formation: Formation) -> bool:
        return bool(self.astray(formation, self.records[formation].goal))


def begin(pose: Pose, log: tuple[Record, ...] = ()) -> Session:
    """Begin teaching from the measured pose, going on with what was recorded before."""
    session = _onward(Session(at=_tidied(pose), log=log))
    count = len(session.records)
    return _say(session, f"going on: {count} of {len(Formation)} are taught") if log else session


def decide(
    session: Session, intent: Intent, limits: Limits, *, can_guide: bool = False
) -> tuple[Session, Command | None]:
    """Answer a key with the next state and, where the robot is to act, a command."""
    if session.is_guided and intent not in (Do.GUIDE, Do.QUIT):
        return _say(session, "the arm is led by hand: f holds it again"), None
    match intent:
        case Jog(axis=axis, sign=sign):
            size = session.angle_deg if axis.is_angle else session.length_mm
            value = round(axis.to_report(session.at[axis]) + sign * size, 3) + 0.0
            return _move(session, session.at.updated({axis: axis.from_report(value)}), limits)
        case StepOf(size=size, is_angle=True):
            return replace(session, angle_deg=size, note=""), None
        case StepOf(size=size):
            return replace(session, length_mm=size, note=""), None
        case Do.RECORD:
            return _record(session)
        case Do.UNDO:
            return _undo(session), None
        case Do.NEXT:
            return _jump(session, 1), None
        case Do.BACK:
            return _jump(session, -1), None
        case Do.GO:
            record = None if session.formation is None else session.records.get(session.formation)
            if record is None:
                return _say(session, "nothing is recorded here to go to"), None
            return _move(session, record.goal, limits)
        case Do.KEEP:
            astray = session.formation and session.astray(session.formation, session.at)
            if not astray:
                return _say(session, "every axis that is kept is where it was"), None
            return _move(session, session.at.updated(astray), limits)
        case Do.TARE:
            return session, Tare()
        case Do.GUIDE if not can_guide:
            return _say(session, "this cell has no freedrive"), None
        case Do.GUIDE:
            return session, Guide(on=not session.is_guided)
        case Do.QUIT:
            return session, Quit()


def moved(session: Session, target: Pose, motion: Motion) -> Session:
    """The state after a motion to `target` has ended. Where the wrist stopped it, the axes that
    moved are where they were measured."""
    if motion.stop is Stop.REACHED:
        return replace(session, at=target, note="")
    turned = {axis: motion.ended[axis] for axis in Axis if session.at[axis] != target[axis]}
    pressed = motion.peak_compression_m * 1e3
    return replace(
        session,
        at=session.at.updated(turned),
        note=f"stopped: the wrist is pressed by {pressed:.1f} mm, its limit; go back a little",
    )


def tared(session: Session, observation: Observation, *, loaded: bool) -> Session:
    """The state after taring: compression counts from here; not where the wrist is loaded."""
    if loaded:
        pressed = observation.compression_m * 1e3
        return _say(
            session, f"not tared: {pressed:+.1f} mm of compression; let the peg hang freely"
        )
    return _say(session, "compression counts from here")


def taken(session: Session, observation: Observation, scene: Scene) -> Session:
    """The state after a picture was taken for the formation that is being taught. Without peg or
    hole it is of no use to a trial, and is not recorded."""
    if session.formation is None:
        return session
    if scene.peg is None or scene.hole is None:
        return _say(session, f"not recorded: {'; '.join(scene.problems)}")
    record = Record(
        formation=session.formation,
        goal=session.at,
        pose=observation.pose,
        view=observation.views["side"],
    )
    session = _onward(replace(session, log=(*session.log, record)))
    goal = describe({axis: record.goal[axis] for axis in OWNED[record.formation]})
    stale = [f for f in session.stale() if f.order > record.formation.order]
    again = f"; teach {', '.join(stale)} again" if stale else ""
    return _say(session, f"{record.formation} recorded: {goal}{again}")


def guided(session: Session, on: bool, pose: Pose) -> Session:
    """The state with a hand leading the arm from now on, or with the arm held again at the measured
    `pose`."""
    if on:
        return _say(replace(session, is_guided=True), "lead the arm by hand; f holds it again")
    return replace(session, is_guided=False, at=_tidied(pose), note="the arm is held")


# --- inside --------------------------------------------------------------------------------------


def _move(session: Session, target: Pose, limits: Limits) -> tuple[Session, Command | None]:
    outside = limits.outside({axis: target[axis] for axis in Axis}, margin=True)
    if outside is not None:
        return _say(session, f"not moved: {outside}"), None
    return replace(session, note=""), MoveTo(target)


def _record(session: Session) -> tuple[Session, Command | None]:
    if session.formation is None:
        return session, Finish()
    astray = session.astray(session.formation, session.at)
    if astray:
        return _say(
            session,
            f"not recorded: {session.formation} keeps {describe(astray)}; = goes there, or teach"
            " what sets it again",
        ), None
    return _say(session, ""), Take()


def _undo(session: Session) -> Session:
    if not session.log:
        return _say(session, "there is nothing to undo")
    *log, last = session.log
    undone = replace(session, log=tuple(log), formation=last.formation)
    return _say(undone, f"{last.formation} is as it was before")


def _jump(session: Session, by: int) -> Session:
    places = [*Formation, None] if not session.open() else [*Formation]
    at = places.index(session.formation) + by
    return replace(session, formation=places[max(0, min(len(places) - 1, at))], note="")


def _onward(session: Session) -> Session:
    """The session at the first formation that is open."""
    return replace(session, formation=next(iter(session.open()), None))


def _say(session: Session, note: str) -> Session:
    return replace(session, note=note)


def _tidied(pose: Pose) -> Pose:
    """A pose rounded to a tenth of a millimetre or degree: a goal needs no noise in its digits."""
    return Pose().updated(
        {axis: axis.from_report(round(axis.to_report(pose[axis]), 1) + 0.0) for axis in Axis}
    )
