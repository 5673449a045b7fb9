"""The prompt, which is what a model is told and shown (Sec. V): the static part first, so that
servers can cache it, then the goal picture, the situation, and the picture taken after the skill.

It sees what the case holds and no more; numbers are in millimetres and degrees, as their names say.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from string import Template

import numpy as np
from numpy.typing import NDArray
from pydantic_ai.messages import BinaryContent, UserContent

from pliant import pictures
from pliant.belief import JUMP_M, Belief
from pliant.cell import Stop
from pliant.envelope import Limits
from pliant.errors import InputError
from pliant.formations import OWNED
from pliant.methods.words import words_of
from pliant.pose import Axis, Partial, describe
from pliant.reasoners.vlm import brief
from pliant.reasoners.vlm.figures import figures
from pliant.reasoners.vlm.settings import Settings
from pliant.reasoners.vlm.telling import (
    NOT_MADE,
    goal,
    in_units,
    of_check,
    of_checks,
    tells_measurements,
    tenths,
)
from pliant.records import Case, FailureAnalysis, Verdict
from pliant.table import Table
from pliant.vision.scene import Measured, Scene
from pliant.vision.surround import OBLIQUE

ASKED = {
    "judge": "judge this execution.",
    "probe": "say whether you need a probe before you analyse this failure.",
    "analyse": "analyse this failure.",
    "plan": "plan the recovery.",
    "both": "analyse this failure, and plan the recovery.",
}
"""The words with which a request ends, by its stage; "both" asks for analysis and plan at once."""


@dataclass(frozen=True, kw_only=True)
class _Words:
    """The words around what is told: in full, or in brief."""

    between: str  # two sections
    goal: str
    side: str
    front: str
    above: str
    asked: str


_IN_FULL = _Words(
    between="\n\n",
    goal="Goal picture: how {formation} looked when it succeeded with the {peg} peg.",
    side="Picture taken after this {formation}:",
    front="The same from the front:",
    above="The hole from above and aside, before the peg came down:",
    asked="Asked of you now: {asked} Give your answer in the required structure.",
)
_IN_BRIEF = _Words(
    between="\n",
    goal="Goal, {peg}:",
    side="Side:",
    front="Front:",
    above="Above:",
    asked="Asked: {asked}",
)
_BELIEVED = {
    "hole_x": ("hole", Axis.X),
    "hole_y": ("hole", Axis.Y),
    "surface_z": ("board", Axis.Z),
    "board_yaw": ("board", Axis.YAW),
    "grasp_roll": ("peg's angle in the grasp", Axis.ROLL),
    "upright_roll": ("hand, for the peg to hang upright", Axis.ROLL),
    "upright_pitch": ("hand, for the peg to hang upright", Axis.PITCH),
}


def instructions(settings: Settings, case: Case, limits: Limits) -> str:
    """The static part: the task with its method's skills, the picture, and what is asked in each
    stage that the model decides; or the task in brief. It is the same for all requests of a trial.

    Raises:
        InputError: the method has no words for a model.
    """
    words = case.method.words
    if "task" not in words:
        raise InputError(
            f"method {case.method.name} has no words for a model: its `words` must hold a 'task',"
            " which says what its skills do"
        )
    stages = (f"plan_{settings.plan}" if s == "plan" else s for s in settings.stages)
    values = figures(case, settings, limits)
    common = words_of("pliant.reasoners.vlm")  # which do for any method
    names = ("brief",) if settings.brief else ("task", "picture", *stages)
    prompts = (words.get(name) or common[name] for name in names)
    return "\n\n".join(Template(text).substitute(values).strip() for text in prompts)


def situation(
    case: Case,
    settings: Settings,
    *,
    asked: str,
    goal_picture: bool = False,
    verdict: Verdict | None = None,
    analysis: FailureAnalysis | None = None,
) -> list[UserContent]:
    """The case as text and pictures, with the verdict or the analysis that came before, and last
    what is `asked` of it."""
    content: list[UserContent] = []
    words = _IN_BRIEF if settings.brief else _IN_FULL
    formation = case.outcome.step.formation
    shown = case.teaching.demonstrations.get(formation) if goal_picture else None
    if shown is not None:
        content += [
            words.goal.format(formation=formation, peg=shown.peg),
            picture(shown.view.image, settings),
        ]
    sections = brief.sections if settings.brief else _sections
    content.append(words.between.join(sections(case, settings, verdict, analysis)))
    if settings.picture:
        views = case.outcome.looks[-1].observation.views
        content += [
            words.side.format(formation=formation),
            picture(views["side"].image, settings),
        ]
        if "front" in views:
            content += [words.front, picture(views["front"].image, settings)]
    for number, probed in enumerate(case.probes, start=1):
        for name, view in probed.looks[-1].observation.views.items():
            content += [f"Probe {number}, {name} camera:", picture(view.image, settings)]
    above = _from_above(case) if settings.oblique_picture else None
    if above is not None:
        content += [
            "The hole from above and aside, before the peg came down:",
            picture(above, settings),
        ]
    content.append(words.asked.format(asked=asked))
    return content


def _from_above(case: Case) -> NDArray[np.uint8] | None:
    """The last picture that the oblique camera took in this trial; None: it took none."""
    for outcome in reversed(case.outcomes):
        for look in reversed(outcome.looks):
            view = look.observation.views.get(OBLIQUE)
            if view is not None:
                return view.image
    return None


def _sections(
    case: Case,
    settings: Settings,
    verdict: Verdict | None,
    analysis: FailureAnalysis | None,
) -> Iterable[str]:
    follows = case.method.follows_belief
    yield _goals(case)
    if settings.history and case.history:
        yield _history(case, settings)
    yield _executed(case, settings)
    if tells_measurements(settings, case):
        yield _seen(case) if follows else _measured(case)
    if case.probes:
        yield _probes(case)
    if verdict is not None:
        yield f"## Verdict\nfailure: {verdict.reason}" + (
            f"\nconflict: {verdict.conflict}" if verdict.conflict else ""
        )
    if analysis is not None:
        shift: Partial = {a: v for a, v in analysis.motion.items() if a not in (Axis.Y, Axis.Z)}
        changes = [f"{f} {describe(by)}" for f, by in analysis.changes.items()]
        yield (
            f"## Analysis\nwhat happened: {analysis.what}\nwhy: {analysis.why}\n"
            f"how to recover: {analysis.how}\n"
            f"changes of the goals: {'; '.join(changes) or 'none'}"
            + (f"\nshift from the belief: {describe(shift)}" if shift else "")
        )


def _probes(case: Case) -> str:
    """The section on the probes made since the failure."""
    lines = ["## Probes since, the peg lifted out"]
    lines += [f"{number}: {probed}" for number, probed in enumerate(case.probes, start=1)]
    return "\n".join([*lines, f"{case.probes_left} left in this trial"])


def _goals(case: Case) -> str:
    """The section with the goals in force, beside the taught ones where the skills go by the
    difference."""
    head, rows = ["skill", "goal", "shift from the taught"], []
    for formation, axes in OWNED.items():
        goal, taught = (g.formations[formation] for g in (case.goals, case.teaching.goals))
        shift = {axis: goal[axis] - taught[axis] for axis in axes}
        rows.append([formation, in_units(goal, axes), in_units(shift, axes)])
    told = 3 if case.method.follows_belief else 2
    return "## Current goals\n" + Table(head[:told], [row[:told] for row in rows]).markdown()


def _history(case: Case, settings: Settings) -> str:
    told = case.history[-settings.history :]
    rows = [
        [
            str(e.index + 1),
            str(e.formation) + (" after a retreat" if e.outcome.step.retreat else ""),
            goal(e.outcome.step, case),
            *of_checks(e.evidence, settings, case).values(),
            "success" if e.verdict.success else "failure",
        ]
        for e in told
    ]
    names = of_checks(told[0].evidence, settings, case)
    table = Table(["no", "skill", "goal", *names, "judged"], rows).markdown()
    probes = [f"probe after no {e.index + 1}: {probed}" for e in told for probed in e.probes]
    return "\n".join(["## Earlier executions", table, *probes])


def _executed(case: Case, settings: Settings) -> str:
    outcome = case.outcome
    formation = outcome.step.formation
    checks = of_checks(case.evidence, settings, case)
    named = {axis for axes in case.method.plannable.values() for axis in axes}
    axes = [axis for axis in Axis if axis in named]
    ended = "ended by the compression limit" if outcome.stop is Stop.COMPRESSION else "ran its way"
    return "\n".join(
        [
            f"## Executed last: no {len(case.history) + 1}, {formation}"
            + (" after a retreat" if outcome.step.retreat else ""),
            f"goal: {goal(outcome.step, case)}",
            f"terminal pose: {in_units(outcome.pose, axes)}",
            f"skill: {ended}, peak_compression_mm {outcome.peak_compression_m * 1e3:.1f}",
            *(f"{name}: {told}" for name, told in checks.items() if told != NOT_MADE),
        ]
    )


def _measured(case: Case) -> str:
    """The section with pliant's own measurements, which the paper's model did not get."""
    lines = ["## Measured in the picture"]
    scene, belief = case.outcome.scene, case.belief
    if scene.peg is not None:
        lines.append(
            f"peg: tip_y_mm {tenths(scene.peg.tip_y.value * 1e3)},"
            f" tip_z_mm {tenths(scene.peg.tip_z.value * 1e3)},"
            f" tilt_deg {tenths(scene.peg.tilt_deg)} (positive: to the left)"
        )
    if belief.hole_y is not None:
        lines.append(f"hole: y_mm {tenths(belief.hole_y.value * 1e3)}")
    if belief.grasp_roll is not None:
        angle = Axis.ROLL.to_report(belief.grasp_roll.value)
        lines.append(f"peg's angle in the grasp: roll_deg {tenths(angle)}")
    metric = case.evidence["metric"]
    if metric is not None:
        lines.append(f"metric check: {of_check(metric)}")
    return "\n".join([*lines, *scene.problems])


def _seen(case: Case) -> str:
    """The section on what was measured after the skill, what was not, and what is believed of all
    looks."""
    look, belief = case.outcome.looks[-1], case.belief
    scene, across = look.scene, look.scene.across
    pressed = f"compression at rest: {tenths(look.observation.compression_m * 1e3)} mm"
    lines = ["## Measured after it", f"{len(case.outcome.motions)} motions; {pressed}"]
    if scene.peg is not None:
        tip_y, tip_z = scene.peg.tip_y, scene.peg.tip_z
        line = f"side camera, peg: tip_y_mm {_within(tip_y)}, tip_z_mm {_within(tip_z)}"
        lines.append(
            f"{line}, tilt_deg {_within(scene.peg.tilt, Axis.ROLL)} (positive: to the left)"
        )
    if scene.hole is not None:
        line = f"side camera, hole: y_mm {_within(scene.hole.y)}"
        lines.append(f"{line}, board z_mm {_within(scene.hole.surface_z)}")
    if across is not None:
        seen = {"tip_x_mm": across.tip_x, "pitch_deg": across.pitch, "hole_x_mm": across.hole_x}
        told = (
            f"{name} {_within(m, Axis.PITCH if name == 'pitch_deg' else Axis.X)}"
            for name, m in seen.items()
            if m is not None
        )
        lines.append(f"front camera: {', '.join(told) or 'nothing measured'}")
        lines += [f"front camera: no {name} measured" for name, m in seen.items() if m is None]
    else:
        lines.append("front camera: no picture")
    if scene.board_yaw is not None:
        lines.append(f"oblique camera: board yaw_deg {_within(scene.board_yaw, Axis.YAW)}")
    lines += [f"not measured: {problem}" for problem in scene.problems]
    lines.append("## Believed, from all looks; ± one standard deviation of a reading")
    for name, (what, axis) in _BELIEVED.items():
        value = getattr(belief, name)
        held = "not seen yet" if value is None else _within(value, axis)
        lines.append(f"{what}: {axis}_{axis.report_unit} {held}")
    return "\n".join([*lines, *_disbelieved(scene, belief)])


def _disbelieved(scene: Scene, belief: Belief) -> list[str]:
    """The lines on readings of this look that the belief does not follow."""
    across = scene.across
    pairs = {
        "hole y_mm": (None if scene.hole is None else scene.hole.y, belief.hole_y),
        "board z_mm": (None if scene.hole is None else scene.hole.surface_z, belief.surface_z),
        "hole x_mm": (None if across is None else across.hole_x, belief.hole_x),
    }
    return [
        f"not believed: {name} {_within(reading)}, as it is {_within(held)} by the looks before"
        for name, (reading, held) in pairs.items()
        if reading is not None and held is not None and abs(reading.value - held.value) > JUMP_M
    ]


def _within(measured: Measured, axis: Axis = Axis.Y) -> str:
    """A value and its standard deviation in the axis's unit."""
    return f"{tenths(axis.to_report(measured.value))} ± {tenths(axis.to_report(measured.sd))}"


def shown(picture: BinaryContent) -> NDArray[np.uint8]:
    """A picture of a request (height, width, 3), RGB."""
    return pictures.decoded(picture.data)


def picture(image: NDArray[np.uint8], settings: Settings) -> BinaryContent:
    """The part of a picture (height, width, 3), RGB, that is sent, as PNG of the width that is."""
    if settings.picture_crop is not None:
        left, top, width, height = settings.picture_crop
        image = np.ascontiguousarray(image[top : top + height, left : left + width])
    most = settings.picture_px
    sent = image if most is None or image.shape[1] <= most else pictures.shrunk(image, most)
    return BinaryContent(pictures.encoded(sent), media_type="image/png")
