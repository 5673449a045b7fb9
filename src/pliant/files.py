"""The one way in and out of files: text is UTF-8, YAML is read strictly, and a file is written
whole or not at all.

What a person writes is read by `read_yaml`. It takes nothing that two readers of YAML understand
differently: `010`, `1:30`, `on`, a date, a field given twice. Whatever is refused is refused in one
line with the file, the line, the text as written and what to write instead. It stands on PyYAML's
events, which say where each value begins and are read one by one, so that nothing is built before
it is judged.
"""

import json
import math
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from pliant import folders
from pliant.errors import InputError, did_you_mean
from pliant.text import in_a_line

MOST_BYTES = 100_000  # of a file that a person writes
MOST_VALUES = 5_000  # in it: read in about a second
DEEPEST = 50  # lists and sections in one another
MOST_DIGITS = 40  # of a number

Place = tuple[str | int, ...]
"""Where a value stands in a document: names of fields, and places in lists from 0."""
T = TypeVar("T")


@dataclass(frozen=True)
class Mark:
    """Where a value begins, on a line from 1 and at a character of the text from 0, where it ends,
    and how it is written: its `text` without quotes, "" for a list or a section."""

    line: int
    start: int
    end: int
    text: str = ""
    is_quoted: bool = False
    is_flow: bool = False


@dataclass(frozen=True)
class Document:
    """What a person wrote: plain data, and where in the text each value and each field stands.

    `what` names the file in messages, as in "cell file 'cell.yaml'"; `advice` says where to begin.
    """

    what: str
    value: Any
    marks: Mapping[Place, Mark]
    advice: str = ""
    text: str = ""
    is_part: bool = False

    def error(self, place: Place, message: str) -> InputError:
        """The error for a value, in one line with the file and the line on which it stands."""
        while place not in self.marks and place:
            place = place[:-1]
        has_line = bool(place) or self.is_part
        return _error(self.what, message, self.marks[place].line if has_line else None)

    @contextmanager
    def at(self, place: Place) -> Iterator[None]:
        """Raises an InputError from within as one about the value at `place`."""
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

    def checked(self, adapter: TypeAdapter[T]) -> T:
        """The document as a model's instance. A number must be a number: neither true nor quoted.

        Raises:
            InputError: a field is missing, unknown or not valid.
        """
        try:
            return adapter.validate_json(json.dumps(self.value), strict=True)
        except ValidationError as error:
            findings = error.errors(include_url=False)
            found = min(findings, key=lambda f: f["type"] != "extra_forbidden")  # a misspelt name
            raise self.error(*_finding(found, self, adapter)) from error

    @property
    def also(self) -> str:
        return f"; {self.advice}" if self.advice else ""


class Fields(BaseModel):
    """A section of a file that a person writes: frozen, and with no other fields than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def shortened(text: str) -> str:
    """A text in one line of at most 60 characters."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:40]} ... ({len(text)} characters)"


# --- in ------------------------------------------------------------------------------------------


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
    """A file's content as `read_yaml` reads it; raises as that does."""
    if len(content) > MOST_BYTES:
        raise InputError(
            f"{what} is larger than {MOST_BYTES // 1000} kB: it must be YAML that a person writes"
        )
    text = _text(content, what)
    return _Builder(what, text, advice).document()


def _error(what: str, message: str, line: int | None = None) -> InputError:
    """An error about a file. A field's name or the file's may hold the end of a line."""
    where = f", line {line}" if line else ""
    return InputError(in_a_line(f"{what}{where}: {message}"))


def _text(content: bytes, what: str) -> str:
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{content[error.start]:02x}"
        raise _error(what, f"{byte} is not UTF-8: save the file as UTF-8 text", line) from error
    if found := yaml.reader.Reader.NON_PRINTABLE.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise _error(what, f"the character U+{ord(found[0]):04X} is not text: remove it", line)
    return text


class _Builder:
    """Plain data from PyYAML's events, each judged as it comes. (They are `Any` here: the stubs do
    not know that those of a parser have marks.)"""

    def __init__(self, what: str, text: str, advice: str) -> None:
        self._what, self._text, self._advice = what, text, advice
        self._marks: dict[Place, Mark] = {}
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
            raise _error(self._what, f"it is not YAML: {problem}", line) from error
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
                    f"'{shortened(_spoken((*place, name)))}' stands on line"
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
        name = _spoken(place)
        if not text:
            raise self._refused(event, f"{name} is empty: write null, or remove it")
        try:
            return plain_scalar(text)
        except ValueError as error:
            raise self._refused(event, f"{name} is {shortened(text)}: {error}") from error

    def _mark(self, event: Any) -> Mark:
        is_scalar = isinstance(event, yaml.ScalarEvent)
        return Mark(
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
        """The first word of what is written there."""
        return shortened(self._text[event.start_mark.index :].split(maxsplit=1)[0])

    def _refused(self, event: Any, message: str) -> InputError:
        return _error(self._what, message, event.start_mark.line + 1)


def _plainly(error: yaml.MarkedYAMLError, line: list[str]) -> str:
    """A parser's finding, in words that say what to do."""
    source = line[0] if line else ""
    problem = shortened(f"{error.problem or error.context}")
    if "\\t" in problem:
        return "a tab: put spaces in its place"
    if odd := _ODD_SPACE.search(source):
        return f"{problem}: the space U+{ord(odd[0]):04X} is no plain one"
    return f"{problem}: '{shortened(source)}'" if source.strip() else problem


# --- values --------------------------------------------------------------------------------------

_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_NUMBER = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, bool | None] = dict.fromkeys(("~", "null", "Null", "NULL"))
_WORDS |= dict.fromkeys(("true", "True", "TRUE"), True)
_WORDS |= dict.fromkeys(("false", "False", "FALSE"), False)
_ODD_SPACE = re.compile("[\x85\xa0\u1680\u2000-\u200f\u2028-\u202f\u205f\u2060\u3000\ufeff]")


def plain_scalar(text: str) -> Any:
    """What a value without quotes means: null, true or false, a number or a text.

    Raises:
        ValueError: it is no number that everyone reads alike, nor surely a text. The message says
            what to write.
    """
    if text in _WORDS:
        return _WORDS[text]
    if _NUMBER.fullmatch(text):
        if len(text) > MOST_DIGITS:
            raise ValueError(
                f"a number of more than {MOST_DIGITS} digits: if it is a name, quote it"
            )
        if _INTEGER.fullmatch(text):
            return int(text)
        if not math.isfinite(number := float(text)):
            raise ValueError("this number is too large to count with")
        return number
    for pattern, advice in _DOUBTFUL:
        if re.fullmatch(pattern, text):
            raise ValueError(advice(text))
    if odd := _ODD_SPACE.search(text):
        raise ValueError(
            f"the space U+{ord(odd[0]):04X} is no plain one: write a plain one, or quote it"
        )
    return text


def _instead(number: Callable[[str], object]) -> Callable[[str], str]:
    """Advice for what some take for a number and others do not. What is long is a name."""

    def advice(text: str) -> str:
        if len(text) > MOST_DIGITS:
            return 'some readers take it for a number: quote it, "..."'
        if len(text) > 8 and text.isdecimal():
            return f'some readers take it for another number: quote it, "{text}"'
        return (
            f"not every reader takes it for the same: write {number(text)} for a number, or quote"
            f' it, "{text}"'
        )

    return advice


def _sexagesimal(text: str) -> str:
    sign = "-" if text.startswith("-") else ""
    total = 0.0
    for part in text.lstrip("+-").replace("_", "").split(":"):
        total = total * 60 + float(part)
    return f"{sign}{total:.15g}"


def _decimal(text: str) -> str:
    sign = "-" if text.startswith("-") else ""
    return sign + re.sub(r"^0+(?=[0-9])", "", text.lstrip("+-").replace("_", ""))


_DOUBTFUL: tuple[tuple[str, Callable[[str], str]], ...] = (
    (
        "(?i:yes|no|on|off)",
        lambda text: (
            f'some readers take it for true or false: write that, or quote it, "{text}", or'
            " write a number"
        ),
    ),
    (r"[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?", _instead(_sexagesimal)),
    (r"[-+]?0[0-9_]+(\.[0-9_]*)?([eE][-+]?[0-9]+)?", _instead(_decimal)),
    (r"[-+]?[1-9][0-9]*_[0-9_]*(\.[0-9_]*)?|[-+]?[0-9]*\.[0-9_]*_[0-9_]*", _instead(_decimal)),
    (r"[-+]?0(x[0-9a-fA-F_]+|o[0-7_]+|b[01_]+)", _instead(lambda text: int(text.rstrip("_"), 0))),
    (r"[-+]?[0-9]+,[0-9]+", _instead(lambda text: text.replace(",", "."))),
    (r"[\u2010-\u2015\u2212][0-9.]+", _instead(lambda text: f"-{text[1:]}")),
    (r"[-+]?\.(?i:inf|nan)", lambda text: "a number must be finite"),
    (
        r"[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}([Tt \t].*)?",
        lambda text: f'a date is text: quote it, "{shortened(text)}"',
    ),
)


_OURS = (
    ("Input should be ", "it must be "),
    ("a valid number", "a number"),
    ("a valid integer", "a whole number"),
    (" after validation", ""),
    ("Tuple should", "it should"),
    ("List should", "it should"),
)
"""Pydantic's words, and what they mean to whoever wrote a file."""


def _finding(
    found: ErrorDetails, document: Document, adapter: TypeAdapter[Any]
) -> tuple[Place, str]:
    """Where a validation's finding is, and what it says: field, value as written, what is valid."""
    place = _place(found, document.value)
    where, context = _spoken(place), found.get("ctx", {})
    what = found["msg"].removeprefix("Value error, ")
    for theirs, ours in _OURS:
        what = what.replace(theirs, ours)
    if found["loc"][-1:] == ("[key]",):
        names = re.findall("'([^']*)'", context.get("expected", ""))
        return place, f"there is no '{where}'{_known(place[-1], names)}"
    match found["type"]:
        case "missing" if isinstance(place[-1], int):
            value, number = document.written(place[:-1]), place[-1] + 1
            return place, f"{_spoken(place[:-1])} is {value}: item {number} is missing"
        case "missing":
            return place, f"{where} is missing{document.also}"
        case "extra_forbidden":
            names = _field_names(adapter.json_schema(), found["loc"])
            return place, f"there is no field '{where}'{_known(place[-1], names)}"
        case "value_error":  # of a model's own, which may name one of its fields
            named = re.match(r"\w+", what)
            if named and (*place, named[0]) in document.marks:
                return (*place, named[0]), f"{where}.{what}" if where else what
            return place, f"{where}: {what}" if where else what
        case "union_tag_not_found":
            field = str(context["discriminator"]).strip("'")
            return place, f"{_spoken((*place, field))} is missing{document.also}"
        case "union_tag_invalid":
            place = (*place, str(context["discriminator"]).strip("'"))
            where = _spoken(place)
            what = f"it must be one of {context['expected_tags']}"
            what += _near(document, place, context["expected_tags"])
        case "literal_error" | "enum":
            what += _near(document, place, context["expected"])
        case "model_type" | "dict_type" | "model_attributes_type":
            what = "it must be a section with fields"
        case "list_type" | "tuple_type":
            what = "it must be a list"
        case "string_type" if isinstance(found["input"], bool | int | float):
            what = f'it must be text: quote it, "{document.written(place)}"'
        case "float_type" | "int_type" if document.marks[place].is_quoted:
            what = f"{what}: without quotes"
    value = document.written(place)
    return place, f"{where or 'it'} is {value}: {what[:1].lower()}{what[1:]}"


def _place(found: ErrorDetails, value: Any) -> Place:
    """Where a finding's value stands: its location without the names of a union's branches."""
    place: Place = ()
    for part in found["loc"]:
        match value, part:
            case (dict(), str()) if part in value:
                place, value = (*place, part), value[part]
            case (list(), int()) if part < len(value):
                place, value = (*place, part), value[part]
    return (*place, found["loc"][-1]) if found["type"] == "missing" else place


def _field_names(schema: Mapping[str, Any], location: Place) -> list[str]:
    """The fields that a model's JSON schema has in the section in which a finding lies."""

    def opened(parts: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
        for part in parts:
            if "$ref" in part:
                yield from opened([schema["$defs"][part["$ref"].rsplit("/", 1)[-1]]])
            elif "anyOf" in part:
                yield from opened(part["anyOf"])
            else:
                yield part

    here: list[Mapping[str, Any]] = [schema]
    for name in location[:-1]:
        inner: list[Mapping[str, Any]] = []
        for part in opened(here):
            branches = part.get("discriminator", {}).get("mapping", {})
            if name in branches:
                inner.append({"$ref": branches[name]})
            elif isinstance(name, int):
                inner += [*part.get("prefixItems", [])[name : name + 1], part.get("items", {})]
            else:
                others = part.get("additionalProperties") or {}
                inner.append(part.get("properties", {}).get(name, others))
        here = inner
    return [name for part in opened(here) for name in part.get("properties", {})]


def _spoken(place: Place) -> str:
    """A place in words: fields with dots between them, items counted from 1."""
    parts = (f" (item {p + 1})" if isinstance(p, int) else f".{p}" for p in place)
    return "".join(parts).removeprefix(".").strip()


def _known(name: object, valid: list[str]) -> str:
    return did_you_mean(name, valid) or f"; valid are {', '.join(valid)}"


def _near(document: Document, place: Place, expected: str) -> str:
    return did_you_mean(document.marks[place].text, re.findall("'([^']*)'", expected))


# --- out -----------------------------------------------------------------------------------------


class _Dumper(yaml.SafeDumper):
    """Writes what `read_yaml` reads back the same."""


def _text_node(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    try:
        is_plain = plain_scalar(text) == text and text.isprintable()
    except ValueError:
        is_plain = False
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if is_plain else '"')


_Dumper.add_representer(str, _text_node)


def yaml_text(value: Any) -> str:
    """Plain data as YAML, which `read_yaml` reads back the same: sections in lines, the innermost
    lists and sections in one."""
    return yaml.dump(
        value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True
    )


def yaml_value(value: Any) -> str:
    """A value as YAML in one line."""
    text = yaml.dump(
        value, Dumper=_Dumper, default_flow_style=True, width=math.inf, allow_unicode=True
    )
    return str(text).removesuffix("\n").removesuffix("\n...")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file or none, making its folder. A file that was there keeps its mode; a link
    is replaced, and not followed.

    Raises:
        InputError: it cannot be written.
    """
    try:
        with folders.whole(path) as partial:
            partial.write_bytes(content)
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be written: {error.strerror}; choose another folder"
        ) from error


def write_text(path: Path, text: str) -> None:
    """Write a person's own file in UTF-8, as `write_bytes` does; where `path` is a link to a file,
    that file is replaced; a link that leads to nothing is replaced itself."""
    is_link = path.is_symlink() and path.is_file()
    write_bytes(path.resolve() if is_link else path, text.encode())
