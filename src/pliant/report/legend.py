"""The words that a trial's page uses, folded, with a sketch of the directions: for whoever opens it
without having read the documents. What every word means stands in docs/glossary.md."""

from collections.abc import Sequence
from contextlib import suppress

from pliant.conditions import CONDITIONS
from pliant.errors import InputError
from pliant.html import Html, join, tag
from pliant.levels import load_level
from pliant.records import Trial
from pliant.report import words
from pliant.report.parts import section

_CHECKS = (
    ("pose", "within 1 mm and 0.5° of the goal on the axes that the formation owns"),
    ("compression", "its limit ended no motion"),
    (
        "Table I",
        "the paper's rule on the picture. Its p_gy and p_ey are y of the goal and of the pose"
        " reached: too big where the peg stands right of the hole, too small where left",
    ),
    ("goal picture", "how far the picture is from the one that was taught"),
    ("metric *", "depth and place of the peg, in millimetres from the picture"),
    ("*", "added by pliant; the others are the paper's"),
)
_REASONERS = {
    "rules": "judges and plans by what is measured in the pictures; no model is asked",
    "none": "never recovers: the taught plan, once",
    "retry": "starts the same attempt again",
    "sweep": "searches blindly, further at each failure",
    "messages": "plans by the words of Table I alone, in fixed steps",
    "oracle": "plans as the rules do, from the truth; for comparison",
    "vlm": "a vision-language model judges and plans",
}
_METHODS = {
    "planar": "the paper's way to insert: straight motions to goals that were taught, one camera",
    "guided": "pliant's way to insert: guided by what several cameras show and the wrist feels",
}
_WORDS = (
    (
        "execution",
        "one step that was done: a motion toward one of the five states that an insertion goes"
        " through. Approach: above the board, leaning. Contact: pressed on it. Fit: slid until the"
        " tip drops into the hole. Align: back over the hole, to stand up. Insertion: down",
    ),
    ("goal", "where a step is sent to; a formation's goal names only the axes that it owns"),
    ("compression", "how far the soft wrist is pressed along its axis, from hanging free"),
    (
        "low corner, trailing corner",
        "the lower corners of the peg in the picture: it leans, so that the left one is low, and"
        " goes ahead in Fit; the right one trails",
    ),
    (
        "near rim, far wall",
        "the hole's edge at its right, which Fit comes to first, and its wall at the left. −47.9 mm"
        " past the near rim: the trailing corner stands 47.9 mm to the right of that edge",
    ),
    ("judged, inserted", "by the reasoner's last verdict; by the truth: the peg is 10 mm deep"),
    ("verdict", "the reasoner's judgement on an execution, from the votes of the checks"),
)


def legend(trial: Trial) -> Html:
    """The words on the page of a trial."""
    return tag(
        "details",
        tag("summary", "Words on this page"),
        tag(
            "div",
            section("Words", _list([*_named(trial), *_WORDS])),
            tag(
                "div",
                section("Directions", _directions()),
                section("Checks", _list(_CHECKS)),
            ),
            class_="parts",
        ),
        tag("p", "Every word: docs/glossary.md in a checkout of pliant.", class_="hint"),
        id="words",
        class_="legend",
    )


def _named(trial: Trial) -> list[tuple[str, str]]:
    """What the title names, where it is pliant's own."""
    named = []
    with suppress(InputError):  # a level of another version of pliant
        named.append((trial.level, f"the level of difficulty: {load_level(trial.level).tests}"))
    base = trial.condition.removesuffix("-own")
    if base in CONDITIONS:
        drawn = [words.drawn(name, 0.0)[0] for name in CONDITIONS[base].ranges]
        said = f"drawn at random: {', '.join(drawn)}" if drawn else "nothing is drawn at random"
        named.append((f"condition {trial.condition}", said))
    named.append(("seed", "decides all that is drawn: the same seed gives the same trial"))
    for name, known in ((trial.reasoner, _REASONERS), (trial.method, _METHODS)):
        if name in known:
            named.append((name, known[name]))
    return named


def _list(pairs: Sequence[tuple[str, str]]) -> Html:
    return tag("dl", *(join(tag("dt", name), tag("dd", said)) for name, said in pairs))


def _directions() -> Html:
    """A sketch of the axes as the side camera sees them."""
    ink, soft = "currentColor", "var(--soft)"
    board = tag("path", d="M10 96H92M148 96H250", stroke=ink, stroke_width="3")
    hole = tag("path", d="M92 96V130M148 96V130", stroke=soft, stroke_width="2")
    axes = tag(
        "path",
        d="M120 96H228M228 96l-9-5v10zM120 96V24M120 24l-5 9h10z",
        stroke="var(--link)",
        stroke_width="2",
        fill="var(--link)",
    )
    fit = tag("path", d="M196 60H150M150 60l9-5v10z", stroke=soft, stroke_width="2", fill=soft)
    texts = [
        tag("text", said, x=x, y=y, fill=ink, font_size="13", stroke="none")
        for said, x, y in (
            ("+y", "232", "88"),
            ("+z", "128", "28"),
            ("Fit", "166", "52"),
            ("near rim", "152", "116"),
            ("far wall", "40", "116"),
        )
    ]
    label = "The picture of the side camera: y to the right, z up, the origin in the hole's middle"
    drawn = tag(
        "svg",
        board,
        hole,
        axes,
        fit,
        *texts,
        viewBox="0 0 260 136",
        width="260",
        height="136",
        fill="none",
        role="img",
        aria_label=label,
    )
    said = (
        "As the side camera sees it: y to the right, z up, x toward the camera; the origin is the"
        " nominal hole's middle on the board. Poses are of the wrist's hinge point. Fit slides to"
        " −y, to the left; a positive roll leans the peg's top to the left."
    )
    return join(drawn, tag("p", said, class_="hint"))
