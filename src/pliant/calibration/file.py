"""Put calibrated values into a cell's file and leave everything else in it as a person wrote it.

Only the values' own characters are replaced: comments, order, layout and line ends stay. A library
that keeps comments writes the whole file anew, in a layout of its own.
"""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from pliant import files
from pliant.errors import InputError
from pliant.files import Document, Place
from pliant.ur5e import configuration

Fields = Mapping[str, Mapping[str, Any]]
"""Values by section and field, as the file has them: millimetres and degrees."""


def put(path: Path, fields: Fields) -> list[str]:
    """Replace the values in the file, all or none; returns a line "section.field: old -> new" each.

    Raises:
        InputError: the file cannot be read or written, or would not be a cell's file any more.
    """
    before = document = files.read_yaml(path, configuration.KIND)
    document.fields()
    lines = []
    for section, values in fields.items():
        for name, value in values.items():
            old = _text(document, (section, name))
            document = _with(document, section, name, _plain(value))
            lines.append(
                f"{section}.{name}: {old or 'absent'} -> {files.yaml_value(_plain(value))}"
            )
    configuration.checked(document)
    if files.read_yaml(path, configuration.KIND).text != before.text:
        raise InputError(f"cell file '{path}' was changed meanwhile: calibrate again")
    files.write_text(path, document.text)
    return lines


def _with(document: Document, section: str, name: str, value: Any) -> Document:
    """The document with one field's value replaced, or added where there was none."""
    wanted = deepcopy(document.value)
    wanted[section] = (wanted.get(section) or {}) | {name: value}
    text = _put(document, section, name, value)
    try:
        changed = files.parse_yaml(text.encode(), document.what)
    except InputError as error:
        raise _cannot(document, section, name, value) from error
    if changed.value != wanted:
        raise _cannot(document, section, name, value)
    return changed


def _cannot(document: Document, section: str, name: str, value: Any) -> InputError:
    return document.error(
        (section, name),
        f"{section}.{name} cannot be put where it stands: write '{name}:"
        f" {files.yaml_value(value)}' there yourself",
    )


def _put(document: Document, section: str, name: str, value: Any) -> str:
    text, written = document.text, files.yaml_value(value)
    if (section, name) in document.marks:
        return _replaced(document, (section, name), value)
    fields = document.value.get(section)
    if section not in document.value:
        return _added(document, (), section, {name: value})
    if fields is None:  # "colours: null"
        mark = document.marks[section,]
        return f"{text[: mark.start]}{{{name}: {written}}}{text[mark.end :]}"
    if not isinstance(fields, dict):
        raise document.error((section,), f"{section} must be a section with fields")
    return _added(document, (section,), name, value)


def _replaced(document: Document, place: Place, value: Any) -> str:
    """The document's text with a value in place of another; of a list as long as before, item by
    item, so that the layout and the comments between the items stay."""
    found: Any = document.value
    for part in place:
        found = found[part]
    if isinstance(value, list) and isinstance(found, list) and 0 < len(found) == len(value):
        for index in reversed(range(len(value))):  # from the end: marks before it stay right
            text = _replaced(document, (*place, index), value[index])
            document = Document(document.what, document.value, document.marks, text=text)
        return document.text
    mark = document.marks[place]
    return document.text[: mark.start] + files.yaml_value(value) + document.text[mark.end :]


def _added(document: Document, place: Place, name: str, value: Any) -> str:
    """The document's text with one field more in the section at `place`."""
    text, mark = document.text, document.marks[place]
    line_end = "\r\n" if "\r\n" in text else "\n"
    fields: Any = document.value if not place else document.value[place[0]]
    if mark.is_flow:
        last = document.marks[*place, list(fields)[-1]].end if fields else mark.start + 1
        comma = ", " if fields else ""
        return f"{text[:last]}{comma}{name}: {files.yaml_value(value)}{text[last:]}"
    if not place:
        body = "".join(f"{line_end}  {n}: {files.yaml_value(v)}" for n, v in value.items())
        return f"{text.rstrip()}{line_end}{line_end}{name}:{body}{line_end}"
    indent = text[text.rfind("\n", 0, mark.start) + 1 : mark.start]
    line = f"{name}: {files.yaml_value(value)}{line_end}"
    return f"{text[: mark.start]}{line}{indent}{text[mark.start :]}"


def _text(document: Document, place: Place) -> str:
    """A value's text as it is written, "" where there is none."""
    mark = document.marks.get(place)
    return files.shortened(document.text[mark.start : mark.end]) if mark else ""


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
