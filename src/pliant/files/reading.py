"""Reads the YAML that a person writes, strictly.

It takes nothing that two readers of YAML understand differently: `010`, `1:30`, `on`, a date, a
field given twice. Whatever is refused is refused in one line with the file, the line, the text as
written and what to write instead. It stands on PyYAML's events, which say where each value begins
and are read one by one, so that nothing is built before it is judged.
"""

import re
import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from pliant.errors import InputError
from pliant.files.document import Document, Place, TextMark, refusal, spoken
from pliant.files.scalars import ODD_SPACE, plain_scalar, shortened
from pliant.text import in_a_line

MOST_BYTES = 100_000  # of a file that a person writes
MOST_VALUES = 5_000  # in it: read in about a second
DEEPEST = 50  # lists and sections in one another


def read_yaml(path: Path, kind: str, advice: str = "") -> Document:
    """Read a file that a person writes. `kind` names it in messages, such as "peg file"; `advice`
    says what to do where there is no such file or nothing in it.

    Raises:
        InputError: it cannot be read, is no text in UTF-8, is too large, or is not YAML that is
            understood in one way only.
    """
    what = in_a_line(f"{kind} '{path}'")
    also = f"; {advice}" if advice else ""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"{what} cannot be read: it is not a file{also}")
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{what} cannot be read: {error.strerror}{also}") from error
    except ValueError as error:  # of a name that no file can have
        raise InputError(f"{what} cannot be read: {error}{also}") from error
    return parse_yaml(content, what, advice)


def parse_yaml(content: bytes, what: str, advice: str = "") -> Document:
    """Read a file's content as `read_yaml` reads a file; raises as that does."""
    if len(content) > MOST_BYTES:
        raise InputError(
            f"{what} is larger than {MOST_BYTES // 1000} kB: it must be YAML that a person writes"
        )
    text = _text(content, what)
    return _Builder(what, text, advice).document()


def _text(content: bytes, what: str) -> str:
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{content[error.start]:02x}"
        raise refusal(what, f"{byte} is not UTF-8: save the file as UTF-8 text", line) from error
    if found := yaml.reader.Reader.NON_PRINTABLE.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise refusal(what, f"the character U+{ord(found[0]):04X} is not text: remove it", line)
    return text


class _Builder:
    """Plain data from PyYAML's events, each judged as it comes. (They are `Any` here: the library's
    type hints do not say that those of a parser have marks.)"""

    def __init__(self, what: str, text: str, advice: str) -> None:
        self._what, self._text, self._advice = what, text, advice
        self._marks: dict[Place, TextMark] = {}
        self._events = self._parsed()

    def document(self) -> Document:
        value = None
        next(self._events)  # the stream's start
        event = next(self._events)
        if isinstance(event, yaml.DocumentStartEvent):
            value = self._value(next(self._events), ())
            next(self._events)  # the document's end
            event = next(self._events)
        if isinstance(event, yaml.DocumentStartEvent):
            raise self._refused(event, "a second document begins: keep one in a file")
        return Document(self._what, value, self._marks, self._advice, self._text)

    def _parsed(self) -> Iterator[Any]:
        try:
            yield from yaml.parse(self._text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = mark.line + 1 if mark else 1
            problem = _plainly(error, self._text.splitlines()[line - 1 : line])
            raise refusal(self._what, f"it is not YAML: {problem}", line) from error
        except (ValueError, OverflowError) as error:  # PyYAML lets them through: \U99999999
            raise InputError(f"{self._what} is not YAML: {shortened(str(error))}") from error

    def _value(self, event: Any, place: Place) -> Any:
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise self._refused(
                event, f"'{self._word(event)}' makes or is an alias: write the value out"
            )
        if getattr(event, "tag", None):
            raise self._refused(event, f"'{self._word(event)}' is a tag: write the value without")
        if len(place) > DEEPEST:
            raise self._refused(event, f"more than {DEEPEST} lists or sections in one another")
        if len(self._marks) > MOST_VALUES:
            raise self._refused(event, f"more than {MOST_VALUES} values in one file")
        self._marks[place] = self._mark(event)
        match event:
            case yaml.ScalarEvent():
                return self._scalar(event, place)
            case yaml.SequenceStartEvent():
                return self._list(place)
            case _:
                return self._section(place)

    def _list(self, place: Place) -> list[Any]:
        items: list[Any] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._value(event, (*place, len(items))))
        self._close(place, event, len(items) - 1 if items else None)
        return items

    def _section(self, place: Place) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        lines: dict[str, int] = {}
        event: Any
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                raise self._refused(event, "a field's name must be text")
            name = self._value(event, (*place, event.value))
            if not isinstance(name, str):
                raise self._refused(
                    event, f"'{shortened(event.value)}' as a field's name must be text: quote it"
                )
            if name == "<<" and not event.style:
                raise self._refused(event, "'<<' merges another section: write its fields out")
            if name in lines:
                raise self._refused(
                    event,
                    f"'{shortened(spoken((*place, name)))}' stands on line"
                    f" {lines[name]} already: keep one of the two",
                )
            lines[name] = self._marks[*place, name].line
            value = next(self._events)
            fields[name] = self._value(value, (*place, name))
            if isinstance(value, yaml.CollectionStartEvent):  # its first item may be lines below
                mark = self._marks[*place, name]
                self._marks[*place, name] = replace(mark, line=lines[name])
        self._close(place, event, name if fields else None)
        return fields

    def _scalar(self, event: Any, place: Place) -> Any:
        text = event.value
        if found := re.search("[\0-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff]", text):
            raise self._refused(
                event, f"a text holds the character U+{ord(found[0]):04X}: remove it"
            )
        if event.style or not place:  # a whole file of one text is no fields to anyone
            return text
        name = spoken(place)
        if not text:
            raise self._refused(event, f"{name} is empty: write null, or remove it")
        try:
            return plain_scalar(text)
        except ValueError as error:
            raise self._refused(event, f"{name} is {shortened(text)}: {error}") from error

    def _mark(self, event: Any) -> TextMark:
        is_scalar = isinstance(event, yaml.ScalarEvent)
        return TextMark(
            line=event.start_mark.line + 1,
            start=event.start_mark.index,
            end=event.end_mark.index,
            text=event.value if is_scalar else "",
            is_quoted=is_scalar and bool(event.style),
            is_flow=bool(getattr(event, "flow_style", False)),
        )

    def _close(self, place: Place, event: Any, last: str | int | None) -> None:
        """Note where a list or section ends: in block style with its last item, since the event
        comes only after the comments that follow."""
        mark = self._marks[place]
        end = event.end_mark.index
        if last is not None and not mark.is_flow:
            end = self._marks[*place, last].end
        self._marks[place] = replace(mark, end=end)

    def _word(self, event: Any) -> str:
        """The first word of what is written where a YAML event begins."""
        return shortened(self._text[event.start_mark.index :].split(maxsplit=1)[0])

    def _refused(self, event: Any, message: str) -> InputError:
        return refusal(self._what, message, event.start_mark.line + 1)


def _plainly(error: yaml.MarkedYAMLError, line: list[str]) -> str:
    """A parser's finding, in words that say what to do."""
    source = line[0] if line else ""
    problem = shortened(f"{error.problem or error.context}")
    if "\\t" in problem:
        return "a tab: put spaces in its place"
    if odd := ODD_SPACE.search(source):
        return f"{problem}: the space U+{ord(odd[0]):04X} is no plain one"
    return f"{problem}: '{shortened(source)}'" if source.strip() else problem
