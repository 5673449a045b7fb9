"""Other words for the same: of what is asked, and of what is answered. The last phrase of each
question, and the last of each answer's words, are never trained on or never asked for: they are
held out, to see whether they are understood."""

import re
from typing import Any

import numpy as np

ASKED = {
    "judge": (
        "judge this execution.",
        "say whether it succeeded.",
        "did the skill reach its formation?",
        "is this a success or a failure?",
        "tell whether the skill did its work.",
    ),
    "analyse": (
        "analyse this failure.",
        "say what went wrong, and why.",
        "explain the failure.",
        "why did it fail?",
        "find the cause of this failure.",
    ),
    "plan": (
        "plan the recovery.",
        "say what to do next.",
        "which skills come next, and with which goals?",
        "plan the next steps.",
        "how shall it go on?",
    ),
}
"""The questions by stage: as they are asked, then other words, the last of them held out."""

_SAME = (
    ("outside the hole or astride its rim, and short of its centre (to its right)",
     "the peg stopped short, right of the hole's centre, and is not in it",
     "not in the hole: too far right, on the board or the near rim"),
    ("outside the hole or astride its rim, and beyond its centre (to its left)",
     "the peg went past the hole and stands to its left",
     "not in the hole: carried over it, to the left of its centre"),
    ("in the hole, and the peg leans more than 5 degrees after Align",
     "the peg is in the hole and still leans too much",
     "in the hole, but not upright within 5 degrees"),
    ("in the hole, and the compression limit ended the push",
     "the springs were pressed to their limit with the peg in the hole",
     "in the hole, jammed: the compression limit stopped it"),
    ("in the hole, not deep enough, and not stopped by the compression limit",
     "the peg is in the hole and not deep enough, though nothing stopped it",
     "in the hole, too shallow, without a compression stop"),
    ("the skill succeeded", "it succeeded", "the formation is reached"),
    ("the centre of the peg's bottom face is",
     "the peg's bottom is",
     "its bottom face's centre is"),
    ("disagrees with the picture", "says otherwise than the picture", "contradicts the picture"),
    ("disagree with the picture", "say otherwise than the picture", "contradict the picture"),
    ("in this trial", "here", "it comes from this:"),
    ("nothing in this trial is off nominal", "all is nominal here", "no cause is known"),
)  # fmt: skip


PLACE = re.compile(r"The centre of the peg's bottom face is [^:]*: (\w)")
"""Where a reason says how the peg lies, before what that means."""
_IT_IS = re.compile(r"; it is [^;\"]*$")


def unseen(text: str) -> str:
    """What is said, or told of a verdict, without how the peg lies: no picture shows it."""
    return _IT_IS.sub("", PLACE.sub(lambda found: found[1].upper(), text))


def reworded(reply: dict[str, Any], draw: np.random.Generator) -> dict[str, Any]:
    """The reply with other words of the same meaning, as often as not."""
    if draw.uniform() < 0.5:
        return reply
    return {k: _other(v, draw) if isinstance(v, str) else v for k, v in reply.items()}


def _other(text: str, draw: np.random.Generator) -> str:
    for first, *others in _SAME:
        found = re.search(re.escape(first), text, re.IGNORECASE)
        if found:
            word = str(draw.choice(others))
            if found.group()[0].isupper():
                word = word[0].upper() + word[1:]
            text = text[: found.start()] + word + text[found.end() :]
    return text
