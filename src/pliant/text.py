"""Text from outside, such as the name of somebody's peg or what a model said, made fit for where it
is shown.

A terminal obeys some characters, others cannot be seen or turn the reading direction, and Markdown
has signs of its own. Text that is shown is never obeyed.
"""

import io
import re
from collections.abc import Mapping
from typing import Any, TextIO

_BIDI = [*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C]
_UNSHOWN = [*range(0x80, 0xA0), *range(0xD800, 0xE000), *_BIDI, 0x2028, 0x2029]
_SIGNS: dict[int, str] = {
    **{code: chr(0x2400 + code) for code in range(0x20) if chr(code) not in "\t\n"},
    0x7F: "\N{SYMBOL FOR DELETE}",
    **dict.fromkeys(_UNSHOWN, "\N{REPLACEMENT CHARACTER}"),
}
_LINES_END = "\N{SYMBOL FOR LINE FEED}"
_MARKS = re.compile(r"[\\`*\[\]<>|~&]|(?<!\w)_|_(?!\w)")
_LEADS = re.compile(r"(#+|[-+=]+|\d+[.)])(?=\s|$)")


def replace_unshowable(*streams: TextIO) -> None:
    """Make streams write "?" for a character that their terminal's encoding lacks, instead of
    raising an error at the first sign such as an inequality."""
    for stream in streams:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def visible(text: str) -> str:
    """The text with a sign in the place of each character that a terminal would obey, that nobody
    sees, or that cannot be written as UTF-8. Tabs and the ends of lines stay."""
    return text.replace("\r\n", "\n").translate(_SIGNS)


def in_a_line(text: str) -> str:
    """The text as `visible` gives it, with a sign for the end of a line, too: what is one line
    stays one."""
    return visible(text).replace("\n", _LINES_END).replace("\t", " ")


def escaped(value: Any) -> Any:
    """Plain data with every text in it, also the fields' names, as `markdown` gives it."""
    if isinstance(value, str):
        return markdown(value)
    if isinstance(value, Mapping):
        return {escaped(name): escaped(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [escaped(inner) for inner in value]
    return value


def rounded(value: float, digits: int) -> float:
    """A rounded number; what rounds to zero has no minus sign."""
    return round(value, digits) + 0.0


def code(text: str) -> str:
    """The text between backticks, in one line."""
    return f"`{in_a_line(text).replace('`', chr(39))}`"


def markdown(text: str) -> str:
    """The text as Markdown that shows just this text, in one line; an ordinary name stays as it
    is."""
    escaped = _MARKS.sub(lambda mark: f"\\{mark[0]}", in_a_line(text))
    return f"\\{escaped}" if _LEADS.match(escaped) else escaped
