"""A transcript of what was said to a model and by it: each call with its pictures, its words, and
what became of them. A model's words are data, and shown as text."""

from pliant.records import Exchange
from pliant.report import words
from pliant.report.html import Html, tag
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
    thumbnails = []
    for n, image in enumerate(exchange.pictures, start=1):
        source = f"{PICTURES}/{pictures.path(image).name}"
        height, width = image.shape[:2]
        alt = f"Picture {n} of {len(exchange.pictures)} that call {number} sent"
        shown = tag(
            "img", src=source, alt=alt, width=str(width), height=str(height), loading="lazy"
        )
        thumbnails.append(tag("li", tag("a", shown, href=source)))
    return tag("ul", *thumbnails, class_="thumbnails") if thumbnails else Html("")
