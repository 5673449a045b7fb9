"""Values without quotes: those that everyone reads alike, and what to write instead of the rest."""

import math
import re
from collections.abc import Callable
from typing import Any

MOST_DIGITS = 40  # of a number

_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_NUMBER = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, bool | None] = dict.fromkeys(("~", "null", "Null", "NULL"))
_WORDS |= dict.fromkeys(("true", "True", "TRUE"), True)
_WORDS |= dict.fromkeys(("false", "False", "FALSE"), False)
ODD_SPACE = re.compile("[\x85\xa0\u1680\u2000-\u200f\u2028-\u202f\u205f\u2060\u3000\ufeff]")


def plain_scalar(text: str) -> Any:
    """The value that a text without quotes stands for: null, true or false, a number or a text.

    Raises:
        ValueError: it is no number that everyone reads alike, nor surely a text. The message says
            what to write.
    """
    if text in _WORDS:
        return _WORDS[text]
    if _NUMBER.fullmatch(text):
        if len(text) > MOST_DIGITS:
            raise ValueError(
                f"a number of more than {MOST_DIGITS} digits: if it is a name, quote it"
            )
        if _INTEGER.fullmatch(text):
            return int(text)
        if not math.isfinite(number := float(text)):
            raise ValueError("this number is too large to count with")
        return number
    for pattern, advice in _DOUBTFUL:
        if re.fullmatch(pattern, text):
            raise ValueError(advice(text))
    if odd := ODD_SPACE.search(text):
        raise ValueError(
            f"the space U+{ord(odd[0]):04X} is no plain one: write a plain one, or quote it"
        )
    return text


def _instead(number: Callable[[str], object]) -> Callable[[str], str]:
    """Make the advice for what some take for a number and others do not. What is long is a name."""

    def advice(text: str) -> str:
        if len(text) > MOST_DIGITS:
            return 'some readers take it for a number: quote it, "..."'
        if len(text) > 8 and text.isdecimal():
            return f'some readers take it for another number: quote it, "{text}"'
        return (
            f"not every reader takes it for the same: write {number(text)} for a number, or quote"
            f' it, "{text}"'
        )

    return advice


def _sexagesimal(text: str) -> str:
    sign = "-" if text.startswith("-") else ""
    total = 0.0
    for part in text.lstrip("+-").replace("_", "").split(":"):
        total = total * 60 + float(part)
    return f"{sign}{total:.15g}"


def _decimal(text: str) -> str:
    sign = "-" if text.startswith("-") else ""
    return sign + re.sub(r"^0+(?=[0-9])", "", text.lstrip("+-").replace("_", ""))


_DOUBTFUL: tuple[tuple[str, Callable[[str], str]], ...] = (
    (
        "(?i:yes|no|on|off)",
        lambda text: (
            f'some readers take it for true or false: write that, or quote it, "{text}", or'
            " write a number"
        ),
    ),
    (r"[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?", _instead(_sexagesimal)),
    (r"[-+]?0[0-9_]+(\.[0-9_]*)?([eE][-+]?[0-9]+)?", _instead(_decimal)),
    (r"[-+]?[1-9][0-9]*_[0-9_]*(\.[0-9_]*)?|[-+]?[0-9]*\.[0-9_]*_[0-9_]*", _instead(_decimal)),
    (r"[-+]?0(x[0-9a-fA-F_]+|o[0-7_]+|b[01_]+)", _instead(lambda text: int(text.rstrip("_"), 0))),
    (r"[-+]?[0-9]+,[0-9]+", _instead(lambda text: text.replace(",", "."))),
    (r"[\u2010-\u2015\u2212][0-9.]+", _instead(lambda text: f"-{text[1:]}")),
    (r"[-+]?\.(?i:inf|nan)", lambda text: "a number must be finite"),
    (
        r"[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}([Tt \t].*)?",
        lambda text: f'a date is text: quote it, "{shortened(text)}"',
    ),
)


def shortened(text: str) -> str:
    """A text in one line of at most 60 characters."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:40]} ... ({len(text)} characters)"
