"""Markup that cannot be forgotten to be escaped: what is not `Html` becomes text.

Text from models and files may hold anything. Characters that would be invisible, change the reading
direction or cannot be written as UTF-8 are shown as signs.
"""

import json
from collections.abc import Iterable
from html import escape
from typing import Any

from pliant.text import visible


class Html(str):
    """A string of markup. Every other string is text, and escaped where it is put into markup."""

    __slots__ = ()


def join(*parts: str) -> Html:
    """Join markup and texts, one after the other."""
    return Html(
        "".join(part if isinstance(part, Html) else escape(visible(part)) for part in parts)
    )


def tag(name: str, /, *children: str, **attributes: str | bool | None) -> Html:
    """An element of markup. `class_="a"` and `aria_label="b"` are written class and aria-label; an
    attribute that is None or False is left out, one that is True has no value."""
    written = "".join(
        f" {_name(key)}" if value is True else f' {_name(key)}="{escape(visible(str(value)))}"'
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    if name in ("img", "meta", "link"):
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(*children)}</{name}>")


def row(name: str, cells: Iterable[object]) -> Html:
    """A row of a table, of cells that are elements of that name, th or td."""
    return tag("tr", *(tag(name, text(cell)) for cell in cells))


def text(cell: object) -> str:
    """A cell's markup or text."""
    return cell if isinstance(cell, str) else str(cell)


def embedded(data: Any, name: str) -> Html:
    """Data for the page's script, as JSON that no text in it can end."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return tag("script", Html(text), type="application/json", id=name)


def _name(key: str) -> str:
    return key.rstrip("_").replace("_", "-")
