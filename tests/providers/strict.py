"""A server that reads requests as strictly as a provider documents it, and replies in its shape.

Each provider's rules are a module of their own, with their sources. What they refuse comes back
with the provider's status and words, so that a test sees what a person would. Nothing here knows
pliant: a request that does not fit a provider's rules fails, whoever sends it.
"""

import base64
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
from loopback import Fields, Handler, Loopback, Received, loopback

CHARACTERS_PER_TOKEN = 4  # about what English takes


class Refused(Exception):
    """A request that is not allowed, with the status and the words for it."""

    def __init__(self, status: int, message: str, **details: Any) -> None:
        super().__init__(message)
        self.status, self.message, self.details = status, message, details


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a request asks, whatever its shape. `tools` are offered, `choice` must be called;
    `prefix` is all that a cache goes by, in order, and `marks` are its lengths up to which a client
    asks for it to be cached."""

    tools: tuple[str, ...]
    choice: str | None
    pictures: tuple[bytes, ...]
    text: str
    prefix: str
    marks: tuple[int, ...] = ()
    model: str = ""
    effort: str = ""


@dataclass(frozen=True, kw_only=True)
class Usage:
    """Tokens as a provider counts them: all that was sent, and of it read from and written to a
    cache."""

    sent: int
    read: int = 0
    written: int = 0
    received: int = 60
    thoughts: int = 0


@dataclass(frozen=True, kw_only=True)
class Said:
    """A reply in no provider's shape: a call of `tool`, or words; `end` is why it ended: done,
    length, or refusal."""

    tool: str = ""
    fields: Fields = field(default_factory=dict)
    words: str = ""
    thoughts: str = ""
    end: str = "done"


class Rules(Protocol):
    """A provider's rules."""

    variable: str
    """The environment variable that leads its client elsewhere."""
    suffix: str
    """What that variable's value ends with."""

    def read(self, received: Received) -> Asked:
        """What a request asks; raises Refused."""
        ...

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage: ...

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields: ...

    def error(self, refused: Refused) -> Fields: ...


Answer = Callable[[Asked], Said]


@dataclass
class Strict:
    """A running server: what it was asked, and what it refused."""

    loopback: Loopback
    rules: Rules
    asked: list[Asked] = field(default_factory=list)
    usages: list[Usage] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    @property
    def base_url(self) -> str:
        return self.loopback.base_url.removesuffix("/v1") + self.rules.suffix

    @property
    def bodies(self) -> list[Fields]:
        return [received.body for received in self.loopback.received]


@contextmanager
def strict(rules: Rules, answer: Answer) -> Iterator[Strict]:
    """Serve until the block ends; `answer` says what the model says, or raises Refused."""

    def behave(_: Loopback, handler: Handler) -> None:
        try:
            asked = rules.read(handler.received)
            usage = rules.cached(asked, server.asked)
            server.asked.append(asked)
            server.usages.append(usage)
            content = rules.reply(asked, answer(asked), usage)
        except (ArithmeticError, AssertionError, LookupError, TypeError, ValueError) as error:
            server.refused.append(f"the rules, or the test, broke: {error!r}")
            raise
        except Refused as error:
            server.refused.append(error.message)
            headers = error.details.get("headers", {})
            handler.send(json.dumps(rules.error(error)).encode(), status=error.status, **headers)
        else:
            handler.send(json.dumps(content).encode())

    with loopback(behave) as running:
        server = Strict(running, rules)
        yield server


# --- what several providers check alike ---------------------------------------------------------


def header(received: Received, name: str) -> str:
    """A header's value, however its name is written; empty: there is none."""
    found = (value for key, value in received.headers.items() if key.lower() == name.lower())
    return next(found, "")


def tokens(text: str) -> int:
    return len(text) // CHARACTERS_PER_TOKEN


def common(asked: Asked, earlier: list[Asked], *, least: int, step: int = 1) -> Usage:
    """The usage with a cache that works by itself: of the longest beginning that an earlier request
    had, in steps, if it is long enough."""
    longest = max((shared(asked.prefix, one.prefix) for one in earlier), default=0)
    read = longest // CHARACTERS_PER_TOKEN
    read = 0 if read < least else read - (read - least) % step
    return Usage(sent=tokens(asked.prefix), read=read)


def marked(asked: Asked, earlier: list[Asked], *, least: int) -> Usage:
    """The usage with a cache that holds what was marked, where it is long enough."""
    stored = {one.prefix[:mark] for one in earlier for mark in one.marks}
    usable = [m for m in asked.marks if tokens(asked.prefix[:m]) >= least]
    found = max((m for m in usable if asked.prefix[:m] in stored), default=0)
    last = max(usable, default=0)
    return Usage(
        sent=tokens(asked.prefix),
        read=tokens(asked.prefix[:found]),
        written=tokens(asked.prefix[:last]) - tokens(asked.prefix[:found]),
    )


def written(node: Any) -> str:
    """A part of a request as the text that a cache goes by; a picture is its hash, and counts as
    about 1,000 characters."""

    def short(node: Any) -> Any:
        if isinstance(node, dict):
            return {name: short(child) for name, child in node.items()}
        if isinstance(node, list):
            return [short(child) for child in node]
        if isinstance(node, str) and len(node) > 1000 and " " not in node:
            return hashlib.sha256(node.encode()).hexdigest() * 16
        return node

    return json.dumps(short(node))


def shared(one: str, other: str) -> int:
    differs = (n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
    return next(differs, min(len(one), len(other)))


def known(body: Mapping[str, Any], names: Mapping[str, Any] | frozenset[str]) -> str | None:
    """The first field that is unknown; None: none is."""
    return next((name for name in body if name not in names), None)


def picture(data: str, kind: str, *, kinds: tuple[str, ...], most: int = 5_000_000) -> bytes:
    """The picture in base64; raises ValueError where it is none, is not of the kind that it claims,
    or is too large."""
    if kind not in kinds:
        raise ValueError(f"unsupported image type {kind!r}")
    content = base64.b64decode(data, validate=True)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if image is None or not content.startswith(b"\x89PNG") == (kind == "image/png"):
        raise ValueError("the image data does not match its type")
    if len(content) > most:
        raise ValueError("image exceeds 5 MB maximum")
    return content


def walk(schema: Any) -> Iterator[Fields]:
    """A JSON schema and all schemas within it."""
    if not isinstance(schema, dict):
        return
    yield schema
    for name in ("properties", "$defs", "definitions"):
        for child in schema.get(name, {}).values():
            yield from walk(child)
    for name in ("anyOf", "allOf", "oneOf", "prefixItems"):
        for child in schema.get(name, []):
            yield from walk(child)
    for name in ("items", "additionalProperties", "not", "if", "then", "else"):
        yield from walk(schema.get(name))
