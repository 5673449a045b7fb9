"""Questions about one execution, with answers from the truth: detect, identify, locate, explain,
correct. What a question shows is what a reasoner sees; the truth stands apart."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pliant.experiment.success import KINDS
from pliant.export.labels import Label, causes, correction, labels, setup_of
from pliant.formations import Formation
from pliant.pose import Axis, Partial, describe
from pliant.records import Execution, Recovery, Trial
from pliant.text import rounded

TYPES = ("detect", "identify", "locate", "explain", "correct")
CENTRED_M = 0.0005  # [m] closer than this, the peg is over the hole's centre
_SIDES = "Left and right are those of the side picture: left is -y, right is +y."
_WAYS = {Axis.Y: ("left", "right"), Axis.Z: ("down", "up")}


@dataclass(frozen=True, kw_only=True)
class TextQuestion:
    """A question about an execution, with its answer. `category` is the answer's discrete part, for
    counting and for exact scoring; `truth` holds the values behind the answer."""

    type: str
    question: str
    answer: str
    category: str
    truth: dict[str, Any]


def asked(trial: Trial) -> Iterator[tuple[Label, list[TextQuestion]]]:
    """Each execution with a known truth, and the questions that can be asked about it. All but
    detect and locate are asked about failures only."""
    for label in labels(trial):
        questions = [_detect(label), _locate(label)]
        if not label.success:
            questions += [_identify(label), _explain(trial, label)]
            plan = correction(trial, label)
            if plan is not None:
                questions.append(_correct(label, plan))
        yield label, questions


def context(trial: Trial, label: Label) -> dict[str, Any]:
    """The knowledge of a reasoner when it is asked, besides the picture [mm, deg]. Only the checks
    of the paper: Table I, pose, compression, goal picture."""
    execution, outcome = label.execution, label.execution.outcome
    observed = outcome.looks[-1].observation
    return {
        "peg": trial.task.peg.name,
        "formation": str(execution.formation),
        "retreat": outcome.step.retreat,
        "goal": report({axis: outcome.target[axis] for axis in Axis}),
        "pose": report({axis: outcome.pose[axis] for axis in Axis}),
        "compression_mm": round(observed.compression_m * 1e3, 2),
        "peak_compression_mm": round(outcome.peak_compression_m * 1e3, 2),
        "stop": str(outcome.stop),
        "checks": {c.name: c.message for c in execution.evidence.checks if c.paper},
        "goals": {str(f): report(goal) for f, goal in label.goals.formations.items()},
        "earlier": [_earlier(e) for e in trial.executions[: execution.index]],
    }


def report(goal: Partial) -> dict[str, float]:
    """A goal or a pose in millimetres and degrees, the unit in each axis's name."""
    return {f"{a}_{a.report_unit}": rounded(a.to_report(v), 3) for a, v in goal.items()}


def _earlier(execution: Execution) -> dict[str, Any]:
    step = execution.outcome.step
    return {
        "formation": str(step.formation),
        "retreat": step.retreat,
        "goal": report(step.goal),
        "judged_success": execution.verdict.success,
    }


def _detect(label: Label) -> TextQuestion:
    name = _name(label)
    answer = "yes" if label.success else "no"
    return TextQuestion(
        type="detect",
        question=f"{name} has ended. Did it succeed? {_MEANING[label.execution.formation]}",
        answer=answer,
        category=answer,
        truth={"success": label.success},
    )


def _identify(label: Label) -> TextQuestion:
    assert label.kind is not None, "only failures have a kind"
    choices = "; ".join(f"{kind}: {meaning}" for kind, meaning in KINDS.items())
    return TextQuestion(
        type="identify",
        question=f"{_name(label)} failed. Which kind of failure is it? {choices}.",
        answer=label.kind,
        category=label.kind,
        truth={"kind": label.kind},
    )


def _locate(label: Label) -> TextQuestion:
    return TextQuestion(
        type="locate",
        question=(
            f"{_name(label)} has ended. Where is the centre of the peg's bottom face, relative to"
            f" the hole's centre and the board's surface, and how does the peg lean? {_SIDES}"
        ),
        answer=f"{_where(label)}, {_height(label)}, {_lean(label.tilt_deg)}.",
        category=_side(label),
        truth={
            "side": _side(label),
            "offset_y_mm": round(label.offset_m * 1e3, 2),
            "depth_mm": round(label.truth.depth_m * 1e3, 2),
            "tilt_deg": round(label.tilt_deg, 2),
        },
    )


def _explain(trial: Trial, label: Label) -> TextQuestion:
    assert label.kind is not None, "only failures are explained"
    why = causes(trial)
    differs = f"In this trial {_listed(why)}." if why else "Nothing in this trial was off nominal."
    setup = setup_of(trial)
    return TextQuestion(
        type="explain",
        question=f"{_name(label)} failed. Why? {_SIDES}",
        answer=(
            f"{_BECAUSE[label.kind]}: the centre of its bottom face is {place(label)}. {differs}"
        ),
        category=label.kind,
        truth={
            "kind": label.kind,
            "hole_y_mm": round(setup.hole_y * 1e3, 2),
            "grasp_roll_deg": round(math.degrees(setup.grasp_roll), 2),
            "friction_factor": round(setup.friction, 3),
            "peak_compression_mm": round(label.execution.outcome.peak_compression_m * 1e3, 2),
        },
    )


def _correct(label: Label, plan: Recovery) -> TextQuestion:
    question = (
        f"{_name(label)} failed. Which formation should be executed next, does the peg have to"
        f" retreat first, and how far and which way should that formation's goal be moved? {_SIDES}"
    )
    if not plan.steps:
        truth: dict[str, Any] = {"formation": None, "plan": []}
        return TextQuestion(
            type="correct", question=question, answer="Stop.", category="stop", truth=truth
        )
    first = plan.steps[0]
    axis, change = next(iter(plan.analysis.motion.items()))
    size = round(abs(axis.to_report(change)), 2)
    way = _WAYS[axis][change > 0] if size else "none"
    retreat = "after a retreat" if first.retreat else "from where it is"
    moved = f"goal moved {size:.1f} {axis.report_unit} {way}" if size else "the same goal"
    return TextQuestion(
        type="correct",
        question=question,
        answer=f"{str(first.formation).capitalize()}, {retreat}, {moved}: {describe(first.goal)}.",
        category=f"{first.formation} {way}" + (", retreat" if first.retreat else ""),
        truth={
            "formation": str(first.formation),
            "retreat": first.retreat,
            "axis": str(axis),
            "direction": way,
            "size_mm": size,
            "plan": [
                {"formation": str(s.formation), "retreat": s.retreat, "goal": report(s.goal)}
                for s in plan.steps
            ],
        },
    )


_MEANING = {
    Formation.APPROACH: "It succeeds when the goal pose is reached and the peg hangs free.",
    Formation.CONTACT: "It succeeds when the peg presses on the board.",
    Formation.FIT: "It succeeds when the peg's low edge is in the hole and the other off its rim.",
    Formation.ALIGN: "It succeeds when both of the peg's low edges are in the hole and it leans at"
    " most 5 degrees.",
    Formation.INSERTION: "It succeeds when the peg is at least 10 mm deep in the hole.",
}
_BECAUSE = {
    "goal_missed": "The peg did not come to where the formation takes it",
    "missed_edge": "The motion ended before the peg could drop into the hole",
    "overshot": "The motion carried the peg past the hole",
    "tilted": "The peg is in the hole but does not stand upright",
    "compression_stop": "The peg met resistance in the hole until the wrist was at its limit",
    "wedged": "The peg is in the hole but was not pushed deep enough",
}


def _name(label: Label) -> str:
    return str(label.execution.formation).capitalize()


def _side(label: Label) -> str:
    if abs(label.offset_m) < CENTRED_M:
        return "centre"
    return "right" if label.offset_m > 0 else "left"


def place(label: Label) -> str:
    """Where the peg's bottom face is and how the peg leans, by the truth, in words."""
    what = f"{_where(label)}, {_height(label)}, {_lean(label.tilt_deg)}"
    return what[0].lower() + what[1:]


def _where(label: Label) -> str:
    side, distance = _side(label), abs(label.offset_m) * 1e3
    if side == "centre":
        return "Over the hole's centre"
    return f"{distance:.1f} mm to the {side} of the hole's centre"


def _height(label: Label) -> str:
    depth = label.truth.depth_m * 1e3
    return f"{abs(depth):.1f} mm {'below' if depth > 0 else 'above'} the surface"


def _lean(tilt_deg: float) -> str:
    if abs(tilt_deg) < 0.05:
        return "upright"
    return f"leaning {abs(tilt_deg):.1f} degrees to the {'left' if tilt_deg > 0 else 'right'}"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
