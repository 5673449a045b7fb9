"""The frame of every page: head, style, script, and the plotting library beside it.

A page opens from a folder without network. Its content security policy lets nothing run but its own
script and the library, and nothing load but files from where it lies.
"""

import base64
import hashlib
from functools import lru_cache
from importlib.resources import files
from typing import Any

from pliant.html import Html, embedded, tag

LIBRARY = ("uPlot.iife.min.js", "uPlot.min.css", "uPlot.LICENSE")
ASSETS = "assets"
"""The folder for the plotting library, once per run."""

_STAMP = "pliant-made-from"


def document(
    title: str,
    *content: Html,
    script: str,
    style: str,
    data: Any,
    stamp: str = "",
    library: str | None = None,
) -> str:
    """The text of a whole page. `script` and `style` name pliant's own files, `data` is what the
    script reads, `stamp` says what the page was made from, `library` is the way to the library's
    folder."""
    code = own("common.js") + own(script)
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name=_STAMP, content=stamp) if stamp else Html(""),
        tag("meta", http_equiv="Content-Security-Policy", content=_policy(code)),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", f"{title} · pliant"),
        tag("link", rel="icon", href="data:,"),
        tag("link", rel="stylesheet", href=f"{library}/{LIBRARY[1]}") if library else Html(""),
        tag("style", Html(own("page.css") + own(style))),
    )
    body = tag(
        "body",
        tag("main", *content),
        embedded(data, "data"),
        tag("script", src=f"{library}/{LIBRARY[0]}") if library else Html(""),
        tag("script", Html(code)),
    )
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def stamp_of(page: str) -> str | None:
    """The stamp of a page, or of its beginning; None: it has none."""
    _, found, rest = page.partition(f'<meta name="{_STAMP}" content="')
    return rest.partition('"')[0] if found else None


@lru_cache
def own(name: str) -> str:
    """The text of one of the report's own files."""
    return (files("pliant.report") / name).read_text(encoding="utf-8")


def library_file(name: str) -> bytes:
    return (files("pliant.report") / "vendor" / name).read_bytes()


def _policy(code: str) -> str:
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    here = "'self' file:"
    return (
        f"default-src 'none'; script-src {here} 'sha256-{digest}';"
        f" style-src {here} 'unsafe-inline'; img-src {here} data:; media-src {here};"
        " base-uri 'none'; form-action 'none'"
    )
