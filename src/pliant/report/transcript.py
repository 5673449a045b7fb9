"""A transcript of what was said to a model and by it: each call with its pictures, its words, and
what became of them. A model's words are data, and shown as text."""

from collections.abc import Sequence

from pliant.cell import Image
from pliant.html import Html, tag
from pliant.records import Exchange
from pliant.report import words
from pliant.store import PICTURES, Pictures


def transcript(exchanges: tuple[Exchange, ...], pictures: Pictures) -> Html:
    """The calls of a model in order, each folded; empty where there was none. `pictures` names the
    files."""
    if not exchanges:
        return Html("")
    calls = (tag("li", _call(n, e, pictures)) for n, e in enumerate(exchanges, start=1))
    return tag("ol", *calls, class_="calls")


def spent(exchange: Exchange) -> str:
    """Tokens, time and money of a call, in words."""
    cached = f" ({exchange.cached_tokens:,} cached)" if exchange.cached_tokens else ""
    cost = "cost not known" if exchange.cost_usd is None else f"{exchange.cost_usd:.4f} USD"
    return (
        f"{exchange.input_tokens:,} tokens in{cached}, {exchange.output_tokens:,} out,"
        f" {words.number(exchange.latency_s)} s, {cost}"
    )


def _call(number: int, exchange: Exchange, pictures: Pictures) -> Html:
    refused = exchange.refused
    return tag(
        "details",
        tag(
            "summary",
            tag("strong", f"Call {number}: {exchange.stage}"),
            f" · {exchange.model} · {spent(exchange)}",
            tag("span", " · ✗ not used", class_="vote no") if refused else Html(""),
        ),
        tag("p", f"✗ Not used: {refused}", class_="notice") if refused else Html(""),
        _pictures(number, exchange, pictures),
        tag("h5", "Request"),
        tag("pre", exchange.request or "(empty)", tabindex="0"),
        tag("h5", "Reply"),
        tag("pre", exchange.reply or "(none)", tabindex="0"),
    )


def _pictures(number: int, exchange: Exchange, pictures: Pictures) -> Html:
    total = len(exchange.pictures)
    told = [
        (image, f"Picture {n} of {total} that call {number} sent")
        for n, image in enumerate(exchange.pictures, start=1)
    ]
    return thumbnails(told, pictures)


def thumbnails(told: Sequence[tuple[Image, str]], pictures: Pictures) -> Html:
    """Pictures in small, each with its words, which open when clicked; empty where there is
    none."""
    shown = []
    for image, alt in told:
        source = f"{PICTURES}/{pictures.path(image).name}"
        height, width = image.shape[:2]
        small = tag(
            "img", src=source, alt=alt, width=str(width), height=str(height), loading="lazy"
        )
        shown.append(tag("li", tag("a", small, href=source)))
    return tag("ul", *shown, class_="thumbnails") if shown else Html("")
