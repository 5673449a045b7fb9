"""Text from outside, made fit for a record, a terminal and a page."""

import os

_SECRET = ("KEY", "TOKEN", "SECRET")  # how the names of variables that hold one end
_SHORTEST_SECRET = 8  # characters; a shorter value occurs in ordinary text
_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"  # which some languages write with
_MOST_LINE = 500  # characters


def printable(text: str) -> str:
    """The text with what a terminal would obey, or no file can hold, replaced."""
    return "".join(map(_printable, text))


def _printable(c: str) -> str:
    if c.isprintable() or c == "\n" or c in _JOINERS:
        return c
    return " " if c.isspace() else "\N{REPLACEMENT CHARACTER}"


def without_keys(text: str) -> str:
    """The text without the keys that the environment holds: a server may send back what it got."""
    for name, value in os.environ.items():
        if name.endswith(_SECRET) and len(value) >= _SHORTEST_SECRET:
            text = text.replace(value, f"<{name}>")
    return text


def one_line(text: str) -> str:
    """The text in one line of bounded length."""
    return " ".join(printable(without_keys(text)[: 4 * _MOST_LINE]).split())[:_MOST_LINE]
