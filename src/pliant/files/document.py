"""A file that a person wrote: plain data, with the place in the text where each value stands."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel, ConfigDict

from pliant.errors import InputError
from pliant.files.scalars import shortened
from pliant.text import in_a_line

Place = tuple[str | int, ...]
"""The place where a value stands in a document: names of fields, and places in lists from 0."""


@dataclass(frozen=True)
class TextMark:
    """A value's place in the text: where it begins, on a line from 1 and at a character of the text
    from 0, where it ends, and how it is written: its `text` without quotes, "" for a list or a
    section."""

    line: int
    start: int
    end: int
    text: str = ""
    is_quoted: bool = False
    is_flow: bool = False


@dataclass(frozen=True)
class Document:
    """A file that a person wrote: plain data, and where in the text each value and each field
    stands.

    `what` names the file in messages, as in "cell file 'cell.yaml'"; `advice` says where to begin.
    """

    what: str
    value: Any
    marks: Mapping[Place, TextMark]
    advice: str = ""
    text: str = ""
    is_part: bool = False

    def error(self, place: Place, message: str) -> InputError:
        """The error for a value, in one line with the file and the line on which it stands."""
        while place not in self.marks and place:
            place = place[:-1]
        has_line = bool(place) or self.is_part
        return refusal(self.what, message, self.marks[place].line if has_line else None)

    @contextmanager
    def at(self, place: Place) -> Iterator[None]:
        """Raise an InputError from within as one about the value at `place`."""
        try:
            yield
        except InputError as error:
            raise self.error((*place, *error.place), str(error)) from error

    def written(self, place: Place) -> str:
        """A value as it is written, in few words."""
        mark = self.marks.get(place)
        if mark is None or not (mark.text or mark.is_quoted):
            value = self.part(place).value
            return "empty" if value is None else shortened(json.dumps(value, ensure_ascii=False))
        return shortened(f'"{mark.text}"' if mark.is_quoted else mark.text)

    def fields(self) -> dict[str, Any]:
        """The fields of a file that must hold some.

        Raises:
            InputError: it holds a list or a single value instead, or nothing.
        """
        if not isinstance(self.value, dict) or not self.value:
            raise InputError(f"{self.what} holds no fields{self.also}")
        return dict(self.value)

    def part(self, place: Place) -> "Document":
        """The list or section at `place`, as a document of its own on the same lines."""
        value = self.value
        for name in place:
            value = value[name]
        depth = len(place)
        marks = {p[depth:]: mark for p, mark in self.marks.items() if p[:depth] == place}
        return replace(self, value=value, marks=marks, is_part=True)

    @property
    def also(self) -> str:
        return f"; {self.advice}" if self.advice else ""


class Fields(BaseModel):
    """A section of a file that a person writes: frozen, and with no other fields than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def refusal(what: str, message: str, line: int | None = None) -> InputError:
    """An error about a file. A field's name or the file's may hold the end of a line."""
    where = f", line {line}" if line else ""
    return InputError(in_a_line(f"{what}{where}: {message}"))


def spoken(place: Place) -> str:
    """A place in words: fields with dots between them, items counted from 1."""
    parts = (f" (item {p + 1})" if isinstance(p, int) else f".{p}" for p in place)
    return "".join(parts).removeprefix(".").strip()
