"""A run as conversations to tune a vision-language model on: what it would be told and shown when
it is asked to judge, to analyse and to plan, and the reply that the truth gives.

One conversation a line, as fine-tuning tools read them: `messages` of roles system, user and
assistant, whose content is a list of texts and of places of pictures, and the `images` in order.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic_ai.messages import BinaryContent, UserContent

from pliant import pictures
from pliant.console import Told, untold
from pliant.envelope import Limits
from pliant.experiment.success import KINDS
from pliant.export.labels import Label, case_of, causes, correction, labels
from pliant.export.output import (
    SPLIT_RULE,
    Lines,
    in_paragraphs,
    lines_matter,
    origin,
    write_lines,
)
from pliant.export.questions import place
from pliant.export.source import Saved, Source, counts
from pliant.formations import OWNED, RECOVERABLE, Formation
from pliant.reasoners.vlm import plans, prompt
from pliant.reasoners.vlm.reasoner import as_told, unasked
from pliant.reasoners.vlm.replies import (
    Judgement,
    absolute_plan,
    analysis_form,
    bounded_plan,
    change_field,
    motion_field,
    shift_field,
    shifted,
)
from pliant.reasoners.vlm.settings import Plans, Settings
from pliant.records import Case, Recovery, Trial, Verdict
from pliant.recovery import changes
from pliant.store import PICTURES, load_trial
from pliant.table import Table

STAGES = ("judge", "analyse", "plan")
_TOUCHING_M = 0.001  # a corner so near to the board's surface stands on it
_SUCCEEDED = "success"
_VOTE = {True: "success", False: "failure", None: "not available"}
_BY = "vlm"  # who signs what comes back to the model: itself


@dataclass(frozen=True, kw_only=True)
class Conversation:
    """A request and its right reply. `kind` is the truth's kind of failure, or "success"."""

    stage: str
    kind: str
    system: str
    user: tuple[UserContent, ...]
    reply: BaseModel


def write(
    source: Source, out: Path, settings: Settings | None = None, *, progress: Told = untold
) -> dict[str, int]:
    """Write train.jsonl, test.jsonl and their pictures; return how many conversations each has.
    `settings` choose what the model is told, as when it is asked; `progress` is told how many of
    how many trials are done.

    Raises:
        InputError: `out` holds something, a trial's record is broken, or no truth is known.
    """
    add = partial(_add, settings or Settings())
    card = partial(_card, source)
    return write_lines(source, out, add, card, made="replies", progress=progress)


def conversations(trial: Trial, settings: Settings) -> Iterator[tuple[Label, Conversation]]:
    """The conversations about each execution whose truth is known and of which a model is asked:
    its verdict where the checks do not give it, and after a failure the analysis and the plan."""
    for label in labels(trial):
        case = case_of(trial, label)
        if label.execution.formation not in RECOVERABLE:
            continue
        judged, known = _judgement(label, case), unasked(case)
        if known is None:
            yield label, _asked(case, settings, "judge", label, judged)
        if label.success:
            continue
        recovery = correction(trial, label)
        if recovery is None:
            continue
        verdict = known or Verdict(
            success=False, reason=judged.reason, votes={}, conflict=judged.conflict or None, by=_BY
        )
        verdict = as_told(verdict, case, settings, _BY)
        analysis = _analysis(trial, label, case, recovery)
        yield label, _asked(case, settings, "analyse", label, analysis, verdict)
        plan = _plan(case, settings, recovery)
        yield (
            label,
            _asked(case, settings, "plan", label, plan, verdict, plans.analysis_of(analysis)),
        )


def _asked(
    case: Case,
    settings: Settings,
    stage: str,
    label: Label,
    reply: BaseModel,
    verdict: Verdict | None = None,
    analysis: Any = None,
) -> Conversation:
    goal_picture = stage == "judge" and case.outcome.step.formation is Formation.INSERTION
    content = prompt.situation(
        case,
        settings,
        asked=prompt.ASKED[stage],
        goal_picture=goal_picture and settings.goal_picture,
        verdict=verdict,
        analysis=analysis,
    )
    return Conversation(
        stage=stage,
        kind=label.kind or _SUCCEEDED,
        system=prompt.instructions(settings, case, Limits()),
        user=tuple(content),
        reply=reply,
    )


# --- the right replies ---------------------------------------------------------------------------


def _judgement(label: Label, case: Case) -> Judgement:
    votes = case.evidence.votes
    told = {name: votes.get(name) for name in ("pose", "compression", "table_i")}
    against = [name for name, vote in told.items() if vote is not None and vote != label.success]
    names = " and ".join(_NAMES[name] for name in against)
    conflict = f"{names} {'disagree' if len(against) > 1 else 'disagrees'} with the picture"
    reached = "the skill succeeded" if label.success else KINDS[label.kind or ""].lower()
    return Judgement(
        pose_check=_VOTE[told["pose"]],  # type: ignore[arg-type]
        compression_check=_VOTE[told["compression"]],  # type: ignore[arg-type]
        table_i=_VOTE[told["table_i"]],  # type: ignore[arg-type]
        picture=_VOTE[label.success],  # type: ignore[arg-type]
        conflict=conflict if against else "",
        reason=f"The centre of the peg's bottom face is {place(label)}: {reached}.",
        success=label.success,
    )


def _analysis(trial: Trial, label: Label, case: Case, recovery: Recovery) -> Any:
    left, right = _corners(label, case)
    why = causes(trial)
    wrong = next((f for f, by in _changes(case, recovery).items() if by), None)
    form = analysis_form(case.method)
    return form(
        bottom_left_corner=left,  # type: ignore[arg-type]
        bottom_right_corner=right,  # type: ignore[arg-type]
        what_happened=f"{KINDS[label.kind or ''].capitalize()}; it is {place(label)}",
        why=f"In this trial {', '.join(why)}" if why else "Nothing in this trial is off nominal",
        wrong_goal="none" if wrong is None else wrong.partition("_")[0],  # type: ignore[arg-type]
        how_to_recover=recovery.analysis.how,
        **_changes(case, recovery),
        **{motion_field(axis): 0 for axis in shifted(case.method)},
    )


def _plan(case: Case, settings: Settings, recovery: Recovery) -> BaseModel:
    if settings.plan is Plans.ABSOLUTE:
        return _absolute(case, recovery)
    most_mm = min(settings.step_limit_mm, Limits().goal_step_m * 1e3)
    first = recovery.steps[0] if recovery.steps else None
    names = bounded_plan(most_mm, case.method).model_fields
    fields: dict[str, Any] = {
        **{name: 0 for name in names if name.endswith(("_mm", "_deg"))},
        **_changes(case, recovery),
        "resume_from": "stop" if first is None else str(first.formation),
        "retreat_first": first is not None and first.retreat,
    }
    return bounded_plan(most_mm, case.method)(**fields)


def _absolute(case: Case, recovery: Recovery) -> BaseModel:
    """The plan as skills with goals: those in force, changed by whole millimetres."""
    told = _changes(case, recovery)
    steps = []
    for step in recovery.steps:
        formation, axis = step.formation, OWNED[step.formation][0]
        now_mm = case.goals.formations[formation][axis] * 1e3
        steps.append(
            {
                "skill": str(formation),
                "goal_mm": round(now_mm + told[change_field(formation, axis)], 1),
                "retreat_first": step.retreat,
                **{shift_field(axis): 0.0 for axis in shifted(case.method)},
            }
        )
    return absolute_plan(case.method).model_validate({"steps": steps})


def _changes(case: Case, recovery: Recovery) -> dict[str, int]:
    """The change of each goal in whole millimetres, by its field."""
    told = {(f, OWNED[f][0]): 0 for f in RECOVERABLE}
    for step in recovery.steps:
        axis = OWNED[step.formation][0]
        told[step.formation, axis] = round(changes(step, case)[axis] * 1e3)
    return {change_field(formation, axis): by for (formation, axis), by in told.items()}


def _corners(label: Label, case: Case) -> tuple[str, str]:
    """Where the peg's bottom-left and bottom-right corner are."""
    lean = case.task.peg.half_extents[1] * math.sin(label.truth.tilt_rad)
    return _corner(label.truth.depth_m + lean), _corner(label.truth.depth_m - lean)


def _corner(depth_m: float) -> str:
    if abs(depth_m) <= _TOUCHING_M:
        return "on the board"
    return "in the hole" if depth_m > 0 else "above the board"


_NAMES = {"pose": "the pose check", "compression": "the compression check", "table_i": "Table I"}


# --- the files -----------------------------------------------------------------------------------


def _add(settings: Settings, lines: Lines, saved: Saved) -> None:
    """Write a trial's conversations, and their pictures."""
    trial = load_trial(saved.folder)
    for label, told in conversations(trial, settings):
        shown = [item for item in told.user if isinstance(item, BinaryContent)]
        names = [f"{pictures.name_of(prompt.shown(item))}.png" for item in shown]
        for name, item in zip(names, shown, strict=True):
            if not (lines.pictures / name).exists():
                (lines.pictures / name).write_bytes(item.data)
        line = {
            "messages": [
                _message("system", told.system),
                _message("user", *told.user),
                _message("assistant", told.reply.model_dump_json()),
            ],
            "images": [f"{PICTURES}/{name}" for name in names],
            "stage": told.stage,
            "kind": told.kind,
            "method": trial.method,
            "peg": trial.task.peg.name,
            "formation": str(label.execution.formation),
            "trial_id": trial.trial_id,
            "seed": trial.seed,
            "execution": label.execution.index,
        }
        lines.add(line, saved.split, trial.method, told.stage, told.kind)


def _message(role: str, *content: UserContent) -> dict[str, Any]:
    """A message in a line: its texts, and the places of its pictures."""
    parts = [
        {"type": "image"}
        if isinstance(item, BinaryContent)
        else {"type": "text", "text": str(item)}
        for item in content
    ]
    return {"role": role, "content": parts}


def _card(source: Source, lines: Lines) -> str:
    found, trials, present = lines.totals(), counts(source.saved), lines.present()
    rows = [[split, trials[split], found[split]] for split in present]
    return in_paragraphs(
        lines_matter("image-text-to-text", lines),
        "# Judge, analyse, plan: conversations about peg insertion",
        "Each line is one request as pliant sends it to a model, word for word, with its pictures,"
        " and the reply that the simulation's truth gives, in the structure that pliant asks for.",
        "## Origin",
        origin(source),
        "## Counts",
        Table(["split", "trials", "conversations"], rows).markdown(),
        SPLIT_RULE,
        lines.kinds(
            ["method", "stage", "kind"], lambda key: (key[0], STAGES.index(key[1]), key[2])
        ),
        "\n".join(f"- {kind}: {meaning}" for kind, meaning in KINDS.items()),
        "Successes outnumber failures, as they do in trials: weigh or choose. What was right to do"
        " is pliant's rules with the truth in place of every measurement: a good next step, not the"
        " only one. Nothing is withheld from the requests or corrupted in them: a model that is"
        " tuned on them alone may learn to read the checks and not to look.",
        "## Fields",
        Table(["field", "meaning"], _FIELDS).markdown(),
    )


_FIELDS = [
    ["`messages`", "system, user, assistant; a content is a list of texts and places of pictures"],
    ["`images`", "the pictures' files, in the order of their places"],
    ["`stage`", ", ".join(STAGES)],
    ["`kind`", "what was true: success, or the kind of failure; not for the model"],
    ["`method`, `peg`, `formation`", "what was executed"],
    ["`trial_id`, `seed`, `execution`", "where it comes from; not for the model"],
]
