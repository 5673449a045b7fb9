"""Checks a document as a model's instance, and says what is not valid in the words of whoever wrote
it."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from pliant.errors import did_you_mean
from pliant.files.document import Document, Place, spoken

T = TypeVar("T")


def checked(document: Document, adapter: TypeAdapter[T]) -> T:
    """A document as a model's instance. A number must be a number: neither true nor quoted.

    Raises:
        InputError: a field is missing, unknown or not valid.
    """
    try:
        return adapter.validate_json(json.dumps(document.value), strict=True)
    except ValidationError as error:
        findings = error.errors(include_url=False)
        found = min(findings, key=lambda f: f["type"] != "extra_forbidden")  # a misspelt name
        raise document.error(*_finding(found, document, adapter)) from error


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
    """The place of a validation's finding, and what it says: field, value as written, what is
    valid."""
    place = _place(found, document.value)
    where, context = spoken(place), found.get("ctx", {})
    what = found["msg"].removeprefix("Value error, ")
    for theirs, ours in _OURS:
        what = what.replace(theirs, ours)
    if found["loc"][-1:] == ("[key]",):
        names = re.findall("'([^']*)'", context.get("expected", ""))
        return place, f"there is no '{where}'{_known(place[-1], names)}"
    match found["type"]:
        case "missing" if isinstance(place[-1], int):
            value, number = document.written(place[:-1]), place[-1] + 1
            return place, f"{spoken(place[:-1])} is {value}: item {number} is missing"
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
            return place, f"{spoken((*place, field))} is missing{document.also}"
        case "union_tag_invalid":
            place = (*place, str(context["discriminator"]).strip("'"))
            where = spoken(place)
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
    """The place where a finding's value stands: its location without the names of a union's
    branches."""
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


def _known(name: object, valid: list[str]) -> str:
    return did_you_mean(name, valid) or f"; valid are {', '.join(valid)}"


def _near(document: Document, place: Place, expected: str) -> str:
    return did_you_mean(document.marks[place].text, re.findall("'([^']*)'", expected))
