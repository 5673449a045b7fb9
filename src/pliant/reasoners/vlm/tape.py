"""A recording of everything that was asked of a model and what it replied, as JSON lines.

The first line says what made it. A picture stands once, by its hash, before the first request that
shows it. A request is found again by its words, output schema and sampling, not by its pictures:
another machine's renderer may draw them a little differently, which is reported. Each line ends in
a hash of itself, so that one that was damaged is not taken for what a model said.
"""

import base64
import hashlib
import json
from collections import defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from itertools import zip_longest
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic_ai.messages import ModelResponse

from pliant import folders
from pliant.errors import InputError

TAPE_SCHEMA = 1
_CLIENTS = ("pliant", "pydantic-ai-slim", "openai", "anthropic", "google-genai")

RESPONSE = TypeAdapter(ModelResponse)

Document = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Request:
    """A request as it was sent: `words` is everything but the pictures, as plain JSON; `pictures`
    are PNG."""

    words: Document
    pictures: tuple[bytes, ...]


@dataclass(frozen=True, kw_only=True)
class Reply:
    """A reply as it came back, or the error in its place."""

    message: ModelResponse | None
    error: str
    latency_s: float
    same_pictures: bool = True


class Tape:
    """A tape that requests pass by: a recording is written, a replay answers them itself. This one
    records nothing and replays nothing."""

    def find(self, request: Request) -> Reply | None:
        """The recorded reply; None: ask the model."""
        return None

    def keep(self, request: Request, reply: Reply) -> None:
        """Record a request with its reply."""


@dataclass
class Recorder(Tape):
    """Writes a recording; one that was in the file before is replaced.

    Raises:
        InputError: the file cannot be written, is a link, or holds something else than a recording.
    """

    path: Path
    _written: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        if self.path.is_symlink():
            raise InputError(
                f"'{self.path}' is a link, and a recording is not written through one: choose"
                " another file"
            )
        if self.path.is_file() and self.path.stat().st_size and not _is_recording(self.path):
            raise InputError(
                f"'{self.path}' holds something else than a recording: choose another file"
            )
        versions = {name: _version(name) for name in _CLIENTS}
        head = {"tape": TAPE_SCHEMA, "versions": {k: v for k, v in versions.items() if v}}
        self._write([head], anew=True)

    def keep(self, request: Request, reply: Reply) -> None:
        named = {_hash(png): png for png in request.pictures}
        lines: list[Document] = [
            {"picture": name, "png": base64.b64encode(png).decode()}
            for name, png in named.items()
            if name not in self._written
        ]
        exchange = {
            "request": request.words,
            "pictures": [_hash(png) for png in request.pictures],
            "reply": reply.message and RESPONSE.dump_python(reply.message, mode="json"),
            "error": reply.error,
            "latency_s": reply.latency_s,
        }
        self._write([*lines, exchange])
        self._written |= named.keys()

    def _write(self, lines: list[Document], *, anew: bool = False) -> None:
        sealed = ({**line, "hash": _hash_of(line)} for line in lines)
        text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in sealed)
        try:
            if anew:
                with folders.whole(self.path) as partial:
                    partial.write_text(text, encoding="utf-8")
            else:
                folders.append(self.path, text.encode())
        except OSError as error:
            raise InputError(
                f"recording '{self.path}' cannot be written: {error.strerror}; choose another file"
            ) from error


@dataclass
class Replayer(Tape):
    """Answers from a recording. The same request, asked again, gets the next recorded reply.

    Raises:
        InputError: the recording cannot be read, or a line of it is broken.
    """

    path: Path
    _exchanges: dict[str, deque[tuple[Document, ModelResponse | None]]] = field(
        default_factory=lambda: defaultdict(deque)
    )
    _order: list[Document] = field(default_factory=list)
    _pictures: set[str] = field(default_factory=set)
    _used: int = 0

    def __post_init__(self) -> None:
        for number, line in enumerate(_lines(self.path), start=1):
            try:
                self._read(_parsed(line), number)
            except (ValueError, KeyError, TypeError, RecursionError) as error:
                why = f"{type(error).__name__}: {error}".splitlines()[0][:200]
                raise InputError(
                    f"recording '{self.path}', line {number}, is broken ({why}): record it again"
                ) from error
        if not self._order:
            raise InputError(f"recording '{self.path}' holds no exchange: record it again")

    @property
    def model(self) -> str:
        """The model that replied."""
        names = (e["reply"]["model_name"] for e in self._order if e["reply"] is not None)
        return next(filter(None, names), "none")

    def find(self, request: Request) -> Reply | None:
        """The recorded reply; raises InputError where the recording has no such request left: it
        says what differs."""
        waiting = self._exchanges.get(_hash_of(request.words))
        if not waiting:
            raise InputError(self._mismatch(request))
        found, message = waiting.popleft()
        self._used += 1
        return Reply(
            message=message,
            error=found["error"],
            latency_s=float(found["latency_s"]),
            same_pictures=found["pictures"] == [_hash(png) for png in request.pictures],
        )

    def _read(self, line: Document, number: int) -> None:
        if number == 1:
            if line["tape"] != TAPE_SCHEMA:
                raise ValueError(f"its schema is {line['tape']!r}, this pliant reads {TAPE_SCHEMA}")
        elif "picture" in line:
            if _hash(base64.b64decode(line["png"], validate=True)) != line["picture"]:
                raise ValueError("the picture is not the one that was recorded")
            self._pictures.add(line["picture"])
        else:
            message = None
            if line["reply"] is not None:
                message = RESPONSE.validate_python(line["reply"])
            elif not line["error"]:
                raise ValueError("it has neither a reply nor an error")
            if not self._pictures.issuperset(line["pictures"]):
                raise ValueError("a picture that it shows is missing")
            self._exchanges[_hash_of(line["request"])].append((line, message))
            self._order.append(line)

    def _mismatch(self, request: Request) -> str:
        if self._used >= len(self._order):
            return (
                f"recording '{self.path}' has ended: all its {self._used} replies are used, and the"
                " trial asks on; replay it with the options it was recorded with"
            )
        expected = self._order[self._used]["request"]
        return (
            f"recording '{self.path}' holds no reply to request {self._used + 1}: it differs from"
            f" the recorded one in {_difference(expected, request.words)}; replay it with the"
            " options it was recorded with"
        )


def _lines(path: Path) -> list[bytes]:
    try:
        return path.read_bytes().splitlines()
    except OSError as error:
        raise InputError(
            f"recording '{path}' cannot be read: {error.strerror}; name a file made by --record"
        ) from error


def _parsed(line: bytes) -> Document:
    parsed = json.loads(line)
    if not isinstance(parsed, dict):
        raise ValueError("it is not a JSON object")
    if parsed.pop("hash", None) != _hash_of(parsed):
        raise ValueError("it is not as it was written")
    return parsed


def _is_recording(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return "tape" in _parsed(file.readline(10_000))
    except (OSError, ValueError, RecursionError):
        return False


def _difference(one: Document, other: Document) -> str:
    """The first place where two requests' words differ, in a few words."""
    for name in sorted({*one, *other}):
        ours, theirs = _text(other.get(name)), _text(one.get(name))
        if ours != theirs:
            pairs = zip_longest(theirs.splitlines(), ours.splitlines(), fillvalue="")
            was, now = next((a, b) for a, b in pairs if a != b)
            return f"{name}: '{was[:80]}' was recorded, now it is '{now[:80]}'"
    return "nothing: it was used already"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, indent=0, sort_keys=True)


def _hash_of(document: Document) -> str:
    return _hash(json.dumps(document, sort_keys=True).encode())


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
