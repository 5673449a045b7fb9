"""The one judge of truth: whether an execution succeeded, and of what kind a failure was.

A formation succeeds when the peg is where the next skill can take over from it; pictures and checks
play no part. Nothing here is known to a method.
"""

import math

from pliant.cell import Stop, Truth
from pliant.checks import TILT_TOLERANCE_DEG, half_hole, pose_check
from pliant.experiment import faults
from pliant.formations import Formation
from pliant.records import End, Outcome, Trial
from pliant.task import Task

TOUCHING_M = 0.0005
"""The compression from which a wrist at rest touches something [m]; in free hang it is pressed by
less."""

BELOW_M = 0.0005
"""The depth below the board's surface at which an edge is in the hole [m]: contact is softer than
that."""

TRIAL_KINDS = {
    "missed_edge": "Fit ended with the peg short of the hole, or astride its near rim",
    "overshot": "Fit, or what followed it, ended with the peg beyond the hole's centre, outside it",
    "compression_stop": "in the hole, and the compression limit ended the last execution",
    "wedged": "in the hole, not deep enough, and not stopped by the compression limit",
    "false_accept": "judged inserted, and it was not",
    "false_reject": "inserted, and not judged so",
    "not_inserted": "not inserted, as a person saw it; where the peg was, nobody measured",
    "gave_up": "the reasoner stopped, or the trial ended before any Fit",
    "cell_fault": "the cell ended it, as by a protective stop: see end_reason and fault",
    "fault": "nothing was measured: reasoner, worker or wiring failed; see end_reason and fault",
}
"""The kinds of a trial's failure, the values of the column failure_kind (`trial_kind`)."""

KINDS = {
    "goal_missed": "Approach or Contact did not reach its goal",
    "missed_edge": "outside the hole or astride its rim, and short of its centre (to its right)",
    "overshot": "outside the hole or astride its rim, and beyond its centre (to its left)",
    "tilted": "in the hole, and the peg leans more than 5 degrees after Align",
    "compression_stop": "in the hole, and the compression limit ended the push",
    "wedged": "in the hole, not deep enough, and not stopped by the compression limit",
}
"""The kinds of a failed execution (`kind`). Fit comes from the right in the side picture (+y)."""


def succeeded(task: Task, outcome: Outcome, truth: Truth) -> bool:
    """Whether the executed formation was reached, by the truth.

    Approach: the pose is reached and the peg hangs free above the board. Contact: the peg presses
    on the board. Fit: its low edge is in the hole, and its trailing edge has left the near rim.
    Align: its whole bottom face is in the hole, and it leans at most 5 degrees. Insertion: the
    centre of its bottom face is at least 10 mm deep in the hole.
    """
    match outcome.step.formation:
        case Formation.APPROACH:
            free = truth.depth_m < 0.0 and truth.compression_m < TOUCHING_M
            return free and pose_check(outcome).vote is True
        case Formation.CONTACT:
            return truth.compression_m >= TOUCHING_M
        case Formation.FIT:
            return _is_in_hole(task, truth)
        case Formation.ALIGN:
            return _is_upright(truth) and _is_whole_face_in_hole(task, truth)
        case Formation.INSERTION:
            return truth.inserted is True


def kind(task: Task, outcome: Outcome, truth: Truth) -> str:
    """The kind of a failed execution, one of `KINDS`."""
    formation = outcome.step.formation
    if formation in (Formation.APPROACH, Formation.CONTACT):
        return "goal_missed"
    if not _is_in_hole(task, truth):
        return _beside_hole(truth)
    if formation is Formation.ALIGN:
        return _beside_hole(truth) if _is_upright(truth) else "tilted"
    return _held_in_hole(outcome)


def trial_kind(trial: Trial) -> str | None:
    """The kind of a trial's failure, one of `TRIAL_KINDS`; None when nothing failed or the truth is
    not known.

    In order: a fault after which nothing was measured is "fault", another "cell_fault"
    (`faults` says which); judged and not inserted "false_accept"; inserted and
    not judged "false_reject"; a reasoner that stopped, or a trial without a Fit, "gave_up". Then
    where the peg was, first after the last Fit and then at the end: outside the hole or astride its
    rim it had "missed_edge" short of the hole's centre (Fit travels toward -y) or "overshot" beyond
    it. In the hole it is a "compression_stop" if the last execution was stopped so, else "wedged".
    Where nobody measured the peg's place, it is "not_inserted".
    """
    if trial.end_reason.startswith(faults.PREFIX):
        return "fault" if faults.is_unmeasured(trial.end_reason) else "cell_fault"
    if trial.inserted is None or (trial.judged and trial.inserted):
        return None
    if trial.judged or trial.inserted:
        return "false_accept" if trial.judged else "false_reject"
    known = zip(trial.executions, trial.truths, strict=False)
    fits = [truth for execution, truth in known if execution.formation is Formation.FIT]
    if trial.end_reason == End.STOPPED or not fits:
        return "gave_up"
    for truth in (fits[-1], trial.truths[-1]):
        if truth.fit is None:
            return "not_inserted"
        if not _is_in_hole(trial.task, truth):
            return _beside_hole(truth)
    return _held_in_hole(trial.executions[-1].outcome)


def _is_in_hole(task: Task, truth: Truth) -> bool:
    """Whether the peg's low edge is in the hole, and its trailing edge past the rim that it came
    over, toward -y, or below it."""
    half = task.peg.half_extents[1]
    trailing = truth.tip[1] + half * math.cos(truth.tilt_rad)
    below = truth.depth_m - half * math.sin(truth.tilt_rad)
    has_left_rim = trailing < truth.hole_y + half_hole(task) or below > BELOW_M
    return truth.fit is True and has_left_rim


def _is_whole_face_in_hole(task: Task, truth: Truth) -> bool:
    """Whether both edges of the bottom face are below the board's surface, and its centre in the
    hole."""
    up = task.peg.half_extents[1] * abs(math.sin(truth.tilt_rad))
    return abs(truth.tip[1] - truth.hole_y) < half_hole(task) and truth.depth_m - up > BELOW_M


def _is_upright(truth: Truth) -> bool:
    return abs(math.degrees(truth.tilt_rad)) <= TILT_TOLERANCE_DEG


def _beside_hole(truth: Truth) -> str:
    return "missed_edge" if truth.tip[1] > truth.hole_y else "overshot"


def _held_in_hole(outcome: Outcome) -> str:
    return "compression_stop" if outcome.stop is Stop.COMPRESSION else "wedged"
