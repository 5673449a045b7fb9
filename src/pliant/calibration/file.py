"""Put calibrated values into a cell's file and leave everything else in it as a person wrote it.

PyYAML knows where in the text a value stands but does not keep comments; so only the values' own
characters are replaced.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pliant.errors import InputError
from pliant.ur5e import configuration

Fields = Mapping[str, Mapping[str, Any]]
"""Values by section and field, as the file has them: millimetres and degrees."""


def put(path: Path, fields: Fields) -> list[str]:
    """Replace the values in the file, all or none; returns a line "section.field: old -> new" each.

    Raises:
        InputError: the file cannot be read or written, or would not be a cell's file any more.
    """
    try:
        text = before = path.read_text()
    except OSError as error:
        raise InputError(f"cell file '{path}' cannot be read: {error.strerror}") from error
    lines = []
    for section, values in fields.items():
        for name, value in values.items():
            text, old = _with(text, section, name, _flow(value))
            lines.append(f"{section}.{name}: {old or 'absent'} -> {_flow(value)}")
    partial = path.with_name(f".{path.name}.part")
    try:
        partial.write_text(text)
        _check(partial, path)
        if path.read_text() != before:
            raise InputError(f"cell file '{path}' was changed meanwhile: calibrate again")
        partial.chmod(path.stat().st_mode)
        partial.replace(path)
    except OSError as error:
        raise InputError(f"cell file '{path}' cannot be written: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)
    return lines


def _check(partial: Path, path: Path) -> None:
    try:
        configuration.load(partial)
    except InputError as error:
        raise InputError(str(error).replace(str(partial), str(path))) from error


def _with(text: str, section: str, name: str, value: str) -> tuple[str, str]:
    """The text with a field's value replaced, and the old value's text, "" where there was none."""
    root = _mapping(yaml.compose(text), "the file")
    found = _entry(root, section)
    if found is None or _is_null(found[1]):
        if found is not None:  # "colours: null"
            start = found[1].start_mark.index
            return f"{text[:start]}{{{name}: {value}}}{text[found[1].end_mark.index :]}", ""
        return f"{text.rstrip()}\n\n{section}:\n  {name}: {value}\n", ""
    mapping = _mapping(found[1], section)
    entry = _entry(mapping, name)
    if entry is not None:
        start, end = entry[1].start_mark.index, _end(entry[1])
        return text[:start] + value + text[end:], text[start:end]
    if mapping.flow_style:
        end = mapping.end_mark.index - 1  # before the brace
        comma = ", " if mapping.value else ""
        return f"{text[:end]}{comma}{name}: {value}{text[end:]}", ""
    start = mapping.start_mark.index
    indent = " " * mapping.start_mark.column
    return f"{text[:start]}{name}: {value}\n{indent}{text[start:]}", ""


def _mapping(node: yaml.Node | None, where: str) -> yaml.MappingNode:
    if not isinstance(node, yaml.MappingNode):
        raise InputError(f"cell file: {where} holds no fields")
    return node


def _entry(mapping: yaml.MappingNode, name: str) -> tuple[yaml.Node, yaml.Node] | None:
    return next(((k, v) for k, v in mapping.value if k.value == name), None)


def _is_null(node: yaml.Node) -> bool:
    return node.tag == "tag:yaml.org,2002:null"


def _end(node: yaml.Node) -> int:
    """Where a value's text ends. Of a block it is the last item's: its own mark lies beyond the
    comments that follow."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(node, yaml.MappingNode) else last)
    return int(node.end_mark.index)


def _flow(value: Any) -> str:
    """A value in one line."""
    text = yaml.safe_dump(_plain(value), default_flow_style=True, width=10_000)
    return text.removesuffix("\n").removesuffix("\n...")


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
