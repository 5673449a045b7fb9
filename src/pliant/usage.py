"""What a command takes: its options as a page of help, and one line for every wrong one.

Options are declared once, in a command's signature and in the docstrings beside it. tyro reads them
there to parse a command line; this module reads the same to show them in groups, with defaults and
examples, and to say what was meant by an option that does not exist.
"""

import ast
import inspect
import io
import re
import shutil
import textwrap
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pliant.errors import InputError, did_you_mean

HELP = ("-h", "--help")
_WIDTHS = (60, 100)  # [columns] of a page, least and most
_NAMES = 20  # [columns] that the options' names take
_WORDS: Mapping[Any, str] = {str: "NAME", int: "N", float: "X", Path: "PATH"}
_FRAME, _RULE = " │|", re.compile(r"[╰+]?[─-]{5,}[╯+]?")  # of tyro's boxes, also in ASCII
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Option:
    """An option, or an argument that is known by its place: what stands behind its name, what it
    means, and its default; `group` is the title of those of a common dataclass."""

    name: str
    values: str
    meaning: str
    default: str = ""
    is_switch: bool = False
    is_positional: bool = False
    group: str = ""

    @property
    def written(self) -> str:
        """The option as a page of help shows it, such as `--seed N` or `--[no-]video`."""
        if self.is_positional:
            return self.values
        if self.is_switch:
            return f"--[no-]{self.name}" if self.default else f"--{self.name}"
        return f"--{self.name} {self.values}"

    @property
    def spellings(self) -> list[str]:
        """The words of a command line that name it."""
        if self.is_positional:
            return []
        return [f"--{self.name}"] + ([f"--no-{self.name}"] if self.is_switch else [])


@dataclass(frozen=True, kw_only=True)
class Usage:
    """What a page of help says beyond the signature: command lines to copy, with a word on each,
    and titles over options by name. What stands under no title comes last."""

    examples: Sequence[tuple[str, str]] = ()
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Shown:
    """A mark on an option that stands for several, saying of which dataclass they are fields."""

    kind: type


def options(command: Callable[..., Any]) -> list[Option]:
    """Every option of a command, in the order of its signature; a dataclass's in its place."""
    if is_dataclass(command):
        return [*_options("", command, command(), "")]
    hints = get_type_hints(command, include_extras=True)
    meanings = _arguments(inspect.getdoc(command) or "")
    found: list[Option] = []
    for name, parameter in inspect.signature(command).parameters.items():
        found += _options(name, hints[name], parameter.default, meanings.get(name, ""))
    return found


def page(name: str, command: Callable[..., Any], usage: Usage) -> str:
    """A command's page of help, as wide as the terminal but not more than 100 columns."""
    least, most = _WIDTHS
    width = max(least, min(most, shutil.get_terminal_size((most, 24)).columns))
    known = options(command)
    places = [option.written for option in known if option.is_positional]
    lines = [" ".join(["usage:", name, *places, "[options]"])]
    lines += [*textwrap.wrap(_summary(command), width), ""]
    wide = max((len(line) for line, _ in usage.examples), default=0)
    lines += [*(f"  {line:<{wide}}  # {said}" for line, said in usage.examples), ""]
    titled = {option: title for title, names in usage.groups.items() for option in names}
    groups: dict[str, list[Option]] = {title: [] for title in ("", *usage.groups)}
    for option in known:
        title = "" if option.is_positional else titled.get(option.name, option.group)
        groups.setdefault(title, []).append(option)
    for title, members in groups.items():
        if members:
            lines += [f"{title}:"] if title and len(groups) > 1 else []
            lines += [line for option in members for line in _row(option, width)]
    return "\n".join(lines)


def taken(words: Sequence[str], command: Callable[..., T], parse: Callable[[], T], prog: str) -> T:
    """What `parse` makes of a command line's words, whose first names `command`.

    Raises:
        InputError: an option does not exist, or a value cannot be one of it; what is valid is said.
    """
    known = options(command)
    spelled = [spelling for option in known for spelling in option.spellings]
    for word in words:
        if word == "--":
            break
        option = word.partition("=")[0].replace("_", "-")
        if re.match(r"--[a-z]", word) and option not in (*spelled, *HELP) and "--tyro" not in word:
            near = _meant(option, known) or f"; {prog} --help lists them"
            raise InputError(f"unknown option '{option}'{near}")
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            return parse()
    except SystemExit as ended:
        if not ended.code:
            raise
        raise InputError(f"{in_a_line(said.getvalue(), known)} ({prog} --help)") from None


def refuse_repeats(words: Sequence[str], command: Callable[..., Any]) -> None:
    """See that a command line, as it was written, gives no option twice: the last alone would
    count, and nobody would say so.

    Raises:
        InputError: an option is given twice, in any of its spellings.
    """
    names = {spelling: o for o in options(command) for spelling in o.spellings}
    seen: set[str] = set()
    for word in words:
        if word == "--":
            return
        option = names.get(word.partition("=")[0].replace("_", "-"))
        if option is None:
            continue
        if option.name in seen:
            several = (
                f"write all values behind one --{option.name}"
                if option.values.endswith("...")
                else "leave one out, since only one can count"
            )
            raise InputError(f"--{option.name} is given twice: {several}")
        seen.add(option.name)


def in_a_line(box: str, known: Sequence[Option]) -> str:
    """tyro's box as one line: what is wrong, and which values are valid."""
    lines = [line.strip(_FRAME) for line in box.strip().splitlines()[1:]]  # without its title
    parts = [[*part] for rule, part in groupby(lines, _RULE.fullmatch) if rule is None]
    text = " ".join(" ".join(parts[0] if parts else ()).split()).removesuffix(".")
    text = text.replace("[bold]", "").replace("[/bold]", "").replace("`", "'")
    if text.startswith("Missing from"):
        places = [option.values for option in known if option.is_positional]
        return f"{' '.join(places)} is missing: {known[0].meaning.rstrip('.')}"
    named = re.search(r"--[a-z-]+|(?<=for argument ')[a-z-]+", text)
    option = next((o for o in known if named and named[0] in (*o.spellings, o.name)), None)
    if text.startswith("Unrecognized"):
        word = text.partition(": ")[2].partition(",")[0]
        near = _meant(word, known) if word.startswith("-") else ""
        return f"'{word}' is no option, nor the value of one{near}"
    given = re.search(r"(?:invalid choice |base 10: |to float: )'(.*?)'(?: |$)", text)
    if option is None:
        return text[:1].lower() + text[1:]
    if given:
        near = did_you_mean(given[1], option.values.strip("[]").split("|"))
        what = option.name if option.is_positional else f"--{option.name}"
        return f"{what} is '{given[1]}': it must be {_said(option)}{near}"
    count = len(option.values.split())
    if "Missing value" in text or "instantiated" in text or "argument count" in text:
        return f"--{option.name} takes {_COUNTED.get(count, str(count))}: {_said(option)}"
    return text[:1].lower() + text[1:]


def _meant(word: str, known: Sequence[Option]) -> str:
    """The question whether an option was meant whose name is like a word's, or has it as a part."""
    name = word.strip("-")
    parts = (o.name for o in known if name in o.name.split("-") and not o.is_positional)
    near = did_you_mean(name, [o.name for o in known if not o.is_positional])
    if not near and (part := next(parts, "")):
        near = f"; did you mean '{part}'?"
    return near.replace("mean '", "mean '--")


_COUNTED = {1: "a value", 2: "two values"}
_KINDS = {
    **{"N": "a whole number", "X": "a number", "X X": "numbers", "PATH": "a path"},
    **{"MIN MAX": "the least and the most", "COLUMN ROW": "whole numbers", "NAME": "a name"},
}


def _said(option: Option) -> str:
    if "|" in option.values:
        return " or ".join(option.values.strip("[]").split("|"))
    return _KINDS.get(option.values, option.values)


def _row(option: Option, width: int) -> list[str]:
    default = f" [{option.default}]" if option.default else ""
    meaning = option.meaning.rstrip(".")
    if meaning[1:2].islower():  # a sentence's first letter, and not a name's
        meaning = meaning[0].lower() + meaning[1:]
    text = textwrap.wrap(meaning + default, width - _NAMES - 4)
    head = f"  {option.written}"
    if len(text) == 1 and len(head) + 2 + len(text[0]) <= width:
        return [f"{head:<{_NAMES + 2}}  {text[0]}"]
    if len(head) > _NAMES + 2:
        return [head, *(" " * (_NAMES + 4) + line for line in text)]
    rows = [*text] or [""]
    return [f"{head:<{_NAMES + 4}}{rows[0]}", *(" " * (_NAMES + 4) + line for line in rows[1:])]


def _options(name: str, hint: Any, default: Any, meaning: str, group: str = "") -> Iterator[Option]:
    plain, marks = (
        (hint.__origin__, hint.__metadata__) if get_origin(hint) is Annotated else (hint, ())
    )
    shown = next((mark for mark in marks if isinstance(mark, Shown)), None)
    if shown is not None:
        plain, default = shown.kind, shown.kind()
    if is_dataclass(plain):
        assert isinstance(plain, type)
        hints, meanings = get_type_hints(plain, include_extras=True), field_meanings(plain)
        title = " ".join((inspect.getdoc(plain) or "").partition("\n\n")[0].split()).rstrip(".")
        for each in fields(plain):
            yield from _options(
                each.name,
                hints[each.name],
                getattr(default, each.name),
                meanings.get(each.name, ""),
                title,
            )
        return
    written = next((m.name for m in marks if getattr(m, "name", None)), name).replace("_", "-")
    values = next((m.metavar for m in marks if getattr(m, "metavar", None)), None)
    is_positional = any("Positional" in repr(mark) for mark in marks)
    kind = _without_none(plain)
    if values is None:
        values = _values(kind)
    if is_positional:
        values = _positional(written.upper(), default, kind)
    yield Option(
        name=written,
        values=values,
        meaning=meaning,
        default=_default(default),
        is_switch=kind is bool,
        is_positional=is_positional,
        group=group,
    )


def _positional(name: str, default: Any, kind: Any) -> str:
    several = " ..." if get_origin(kind) is tuple else ""
    shown = _values(kind) if get_origin(kind) is Literal else name + several
    return shown if default is inspect.Parameter.empty else f"[{shown}]"


def _without_none(hint: Any) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        (hint,) = (arg for arg in get_args(hint) if arg is not type(None))
    return _without_none(hint.__origin__) if get_origin(hint) is Annotated else hint


def _values(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return "|".join(str(v) for v in get_args(kind))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return "|".join(str(member.value) for member in kind)
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        one = _WORDS.get(parts[0], "NAME")
        return f"{one} ..." if parts[-1] is Ellipsis else " ".join([one] * len(parts))
    return _WORDS.get(kind, "")


def _default(value: Any) -> str:
    if value is None or value is inspect.Parameter.empty or value == ():
        return ""
    if isinstance(value, bool):
        return "on" if value else ""
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _summary(command: Callable[..., Any]) -> str:
    text = (inspect.getdoc(command) or "").partition("\nArgs:")[0]
    return " ".join(text.split())


def _arguments(doc: str) -> dict[str, str]:
    """The meanings in a docstring's section of arguments, by name."""
    section = doc.partition("\nArgs:\n")[2].partition("\n\n")[0]
    found = re.findall(r"^    (\w+): (.*(?:\n {8,}.*)*)", section, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


@cache
def field_meanings(kind: type) -> dict[str, str]:
    """The docstrings that stand below a dataclass's fields, by name."""
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(definition, ast.ClassDef)
    found = {}
    for one, after in zip(definition.body, definition.body[1:], strict=False):
        match one, after:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                value=ast.Constant(value=str(text))
            ):
                found[name] = " ".join(text.split())
    return found
