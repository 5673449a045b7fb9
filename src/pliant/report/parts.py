"""The small parts that pages share: badges, facts, tables, notices."""

from collections.abc import Collection, Sequence

from pliant.html import Html, tag
from pliant.html import text as as_text
from pliant.table import Table


def outcome(success: bool) -> str:
    return "success" if success else "failure"


def badge(name: str, success: bool) -> Html:
    """A badge: a word with a tick or a cross, on the verdict's colour."""
    return tag("span", f"{'✓' if success else '✗'} {name}", class_=f"badge {outcome(success)}")


def notice(text: str) -> Html:
    """A notice of something that must not be overlooked."""
    return tag("p", text, class_="notice", role="note")


def section(title: str, *content: Html) -> Html:
    return tag("section", tag("h4", title), *content)


def chapter(title: str, name: str, *content: Html) -> Html:
    """A part of a page under a heading that can be linked to."""
    return tag("section", tag("h2", title, id=name), *content, aria_labelledby=name)


def facts(pairs: Sequence[tuple[str, str]]) -> Html:
    """A list of names and values."""
    rows = (tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs)
    return tag("dl", *rows, class_="facts")


def truth_box(pairs: Sequence[tuple[str, str]]) -> Html:
    """A box of facts that only the experiment knows, set apart."""
    title = tag("h4", "Ground truth, not seen by the method")
    return tag("aside", title, facts(pairs), class_="truth")


def table(shown: Table, caption: str, *, numbers: Collection[str] = ()) -> Html:
    """A table of texts and markup, with numbers in the columns so named."""
    classes = ["number" if name in numbers else None for name in shown.head]
    rows = [
        tag(
            "tr",
            *(
                tag("td", as_text(cell), class_=kind)
                for cell, kind in zip(row, classes, strict=True)
            ),
        )
        for row in shown.rows
    ]
    return scrolled(shown.head, rows, caption)


def scrolled(head: Sequence[str], rows: Sequence[Html], caption: str) -> Html:
    """A table that scrolls sideways, by keys too, where it is wider than the page."""
    columns = (tag("th", name, scope="col") for name in head)
    return tag(
        "div",
        tag(
            "table",
            tag("caption", caption),
            tag("thead", tag("tr", *columns)),
            tag("tbody", *rows),
        ),
        class_="scroll",
        tabindex="0",
        role="region",
        aria_label=caption,
    )
