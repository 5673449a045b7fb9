"""Turns a recorded decision into the text that the server makes of a request, and the reply.

The same decision is rendered several times: numbers that the model itself would have written before
are not exact, since its own are not.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import tokenizer as words
from wording import PLACE, unseen

_NUMBER = re.compile(r"\d+\.\d")
_VERDICT = re.compile(r"^Failure: (.*)$", re.MULTILINE)
_OTHERS = ("judged by checks", "judged by rules", "the execution failed", "judged by benchmark")

PLACES = (
    "The centre of the peg's bottom face is",
    "Its bottom face's centre is",
    "The peg's bottom is",
)


def measured(off_mm: float, depth_mm: float, lean_deg: float) -> str:
    """How the peg lies to the hole, in the words in which it stands in replies."""
    side = "right" if off_mm > 0 else "left"
    level = "below" if depth_mm > 0 else "above"
    lean = "left" if lean_deg > 0 else "right"
    return (
        f"{abs(off_mm):.1f} mm to the {side} of the hole's centre, {abs(depth_mm):.1f} mm {level}"
        f" the surface, leaning {abs(lean_deg):.1f} degrees to the {lean}:"
    )


def prompt(decision: dict[str, Any], draw: np.random.Generator, picture_tokens: int) -> str:
    """The request as the chat template renders it, up to where the reply begins."""
    user = joined(decision["user"])
    if decision["stage"] != "judge":
        user = _VERDICT.sub(lambda found: f"Failure: {_unsure(found[1], draw)}", user)
    user = user.replace("<image>", words.picture_text(picture_tokens))
    system = decision["system"]
    if decision["tool"]:
        system += f"\nTools: {decision['stage']}"  # the others are not offered to a server
    return turn("system", system) + turn("user", user) + f"{words.TURN}assistant\n"


def reply(decision: dict[str, Any], *, plain: bool) -> str:
    """The reply, as a call where functions are offered."""
    text = decision["plain" if plain else "reply"]
    if decision["tool"]:
        text = (
            f'{words.CALL}{{"name": "{decision["stage"]}", "arguments": {text}}}{words.END_OF_CALL}'
        )
    return text + words.END_OF_TURN


def joined(parts: Sequence[str]) -> str:
    """The parts of a request as the server joins them: a line's end between two texts."""
    text = ""
    for n, part in enumerate(parts):
        between = n > 0 and "<image>" not in (part, parts[n - 1])
        text += ("\n" if between else "") + part
    return text


def turn(role: str, text: str) -> str:
    return f"{words.TURN}{role}\n{text}{words.END_OF_TURN}\n"


def _unsure(verdict: str, draw: np.random.Generator) -> str:
    """The verdict as it may be told: with what the model measured, without, or by another."""
    u = draw.uniform()
    if not PLACE.match(verdict) or u < 0.25:
        return verdict
    if u < 0.80:
        size = draw.uniform(0.2, 1.5)
        return _NUMBER.sub(lambda n: _about(float(n[0]), size, draw), verdict)
    if u < 0.90:
        return unseen(verdict)
    return str(draw.choice(_OTHERS))


def _about(value: float, size: float, draw: np.random.Generator) -> str:
    return f"{max(0.0, value + size * float(draw.standard_normal())):.1f}"
