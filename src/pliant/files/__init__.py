"""The one way in and out of files: text is UTF-8, YAML is read strictly, and a file is written
whole or not at all."""

from pliant.files.document import Document, Fields, Place
from pliant.files.findings import checked
from pliant.files.reading import parse_yaml, read_yaml
from pliant.files.scalars import shortened
from pliant.files.writing import (
    whole,
    write_bytes,
    write_json,
    write_text,
    yaml_text,
    yaml_value,
)

__all__ = [
    "Document",
    "Fields",
    "Place",
    "checked",
    "parse_yaml",
    "read_yaml",
    "shortened",
    "whole",
    "write_bytes",
    "write_json",
    "write_text",
    "yaml_text",
    "yaml_value",
]
