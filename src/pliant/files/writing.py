"""Writes a file whole or not at all, and YAML that is read back the same."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from pliant import folders
from pliant.errors import InputError
from pliant.files.scalars import plain_scalar


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


@contextmanager
def whole(path: Path, advice: str = "choose another folder") -> Iterator[Path]:
    """A new file to write, which becomes `path` when the block ends well, as `folders.whole`.

    Raises:
        InputError: it cannot be written; it says `advice`.
    """
    try:
        with folders.whole(path) as partial:
            yield partial
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be written: {error.strerror or error}; {advice}"
        ) from error


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file or none, making its folder. A file that was there keeps its mode; a link
    is replaced, and not followed.

    Raises:
        InputError: it cannot be written.
    """
    with whole(path) as partial:
        partial.write_bytes(content)


def write_json(path: Path, document: Any, indent: int = 1) -> None:
    """Write plain data as JSON in lines, as `write_bytes` does."""
    write_bytes(path, (json.dumps(document, indent=indent) + "\n").encode())


def write_text(path: Path, text: str) -> None:
    """Write a person's own file in UTF-8, as `write_bytes` does; where `path` is a link to a file,
    that file is replaced; a link that leads to nothing is replaced itself."""
    is_link = path.is_symlink() and path.is_file()
    write_bytes(path.resolve() if is_link else path, text.encode())
