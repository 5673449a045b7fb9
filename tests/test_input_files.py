"""Every file that a person writes, with everything that can be wrong in one: the answer is one line
with the file, the line, the text as it is written and what to do."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pliant import teaching
from pliant.emulator import faults
from pliant.errors import InputError
from pliant.experiment import plan
from pliant.task import load_task
from pliant.ur5e import configuration

_PACKAGE = Path(str(files("pliant")))


@dataclass(frozen=True)
class Kind:
    """A kind of file: one that is valid, how it is read, and a field of it with a number."""

    text: str
    read: Callable[[Path], Any]
    field: str
    place: str

    @property
    def line(self) -> int:
        return self.text[: self.text.index(f"{self.field}: ")].count("\n") + 1

    def with_value(self, value: str) -> str:
        """The file with another value in that field."""
        lines = self.text.splitlines(keepends=True)
        start, name, _ = lines[self.line - 1].partition(f"{self.field}: ")
        lines[self.line - 1] = f"{start}{name}{value}\n"
        return "".join(lines)


KINDS = {
    "peg": Kind(
        "# größe\nshape: polygon\ncorners_mm: [[-10, -12], [15, 0], [-10, 12]]\nlength_mm: 80\n",
        lambda path: load_task(str(path)),
        "length_mm",
        "length_mm",
    ),
    "cell": Kind(
        (_PACKAGE / "ur5e" / "example.yaml").read_text(encoding="utf-8"),
        configuration.load,
        "focal_px",
        "camera.focal_px",
    ),
    "goal": Kind(
        (_PACKAGE / "goals" / "goals.yaml").read_text(encoding="utf-8"),
        teaching.load,
        "focal_px",
        "camera.focal_px",
    ),
    "experiment": Kind(
        "pegs: [circle, square]\nconditions:\n- all\n- {name: windy, hole_y_mm: [-10, 10]}\n"
        "reasoners: [rules, {name: blind, picture: false}]\nvlm:\n  model: test:m\n  history: 2\n"
        "trials: 3\n",
        partial(plan.load, agree=lambda named: None),
        "trials",
        "trials",
    ),
    "fault": Kind(
        "- at_s: 2.5\n  kind: stall\n  seconds: 1.0\n- {at_s: 4, kind: protective_stop}\n",
        faults.load,
        "seconds",
        "(item 1).seconds",
    ),
}
every_kind = pytest.mark.parametrize("name", KINDS)


def written(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / "written.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refused(folder: Path, name: str, content: str | bytes) -> str:
    """What is said of a file, after its name."""
    path = written(folder, name, content)
    with pytest.raises(InputError) as caught:
        KINDS[name].read(path)
    message = str(caught.value)
    start = f"{name} file '{path}'"
    assert message.startswith(start)
    assert "\n" not in message
    assert len(message) < 700
    return message.removeprefix(start).removeprefix(", ")


@every_kind
def test_the_files_to_be_broken_are_valid(name: str, tmp_path: Path) -> None:
    if name != "goal":  # its pictures lie beside it
        KINDS[name].read(written(tmp_path, name, KINDS[name].text))


@every_kind
@pytest.mark.parametrize(
    ("value", "remedy"),
    [
        ("010", 'write 10 for a number, or quote it, "010"'),
        ("1:30", 'write 90 for a number, or quote it, "1:30"'),
        ("0x10", "write 16 for a number"),
        ("0o20", "write 16 for a number"),
        ("1_0", "write 10 for a number"),
        ("1,5", "write 1.5 for a number"),
        ("on", "or write a number"),
        ("yes", "or write a number"),
        (".inf", "a number must be finite"),
        (".nan", "a number must be finite"),
        ("1e400", "this number is too large"),
        ("2025-31-12", 'quote it, "2025-31-12"'),
        ("2025-01-12", 'quote it, "2025-01-12"'),
        ("7" * 5000, "if it is a name, quote it"),
        ("&a 10", "write the value out"),
        ("*a", "write the value out"),
        ("!!int 10", "write the value without"),
        ("", "is empty: write null, or remove it"),
        ('"10"', "number"),
        ("true", "number"),
        ("null", "number"),
        ("ten", "number"),
        ("[10]", "number"),
        ("{a: 10}", "number"),
        ("-1e6", ""),
    ],
)
def test_a_value_that_is_no_number_is_said_with_its_line(
    name: str, value: str, remedy: str, tmp_path: Path
) -> None:
    kind = KINDS[name]
    message = refused(tmp_path, name, kind.with_value(value))
    assert message.startswith(f"line {kind.line}: ")
    assert remedy in message
    assert (value.split()[0] if value.startswith(("&", "*", "!")) else kind.field) in message


@every_kind
def test_a_field_that_stands_twice_is_said_with_both_lines(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    lines = kind.text.splitlines(keepends=True)
    lines.insert(kind.line, lines[kind.line - 1])
    message = refused(tmp_path, name, "".join(lines))
    assert message.startswith(f"line {kind.line + 1}: '{kind.place}' stands on line {kind.line} al")


@every_kind
def test_a_misspelt_field_is_said_with_what_was_meant(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    wrong = kind.field[:-1]
    text = kind.text.replace(f"{kind.field}: ", f"{wrong}: ", 1)
    message = refused(tmp_path, name, text)
    assert wrong in message
    assert message.startswith(f"line {kind.line}: ")
    assert f"did you mean '{kind.field}'?" in message


@every_kind
@pytest.mark.parametrize(
    ("added", "reason"),
    [
        (b"\tmore: 1\n", "a tab: put spaces in its place"),
        (b"more: \xff\n", "byte 0xff is not UTF-8: save the file as UTF-8"),
        (b"more: \0\n", "U+0000 is not text: remove it"),
        (b"more: a: b\n", "is not YAML"),
        (b"---\nmore: 1\n", "a second document begins"),
        (b"more: " + b"[" * 99 + b"]" * 99 + b"\n", "more than 50 lists"),
    ],
)
def test_what_is_no_yaml_of_ours_is_said_with_its_line(
    name: str, added: bytes, reason: str, tmp_path: Path
) -> None:
    text = KINDS[name].text
    if text.startswith("- "):
        added = added.replace(b"more: ", b"- more: ", 1)
    message = refused(tmp_path, name, text.encode() + added)
    assert message.startswith(f"line {text.count(chr(10)) + 1}: ")
    assert reason in message


@every_kind
@pytest.mark.parametrize("content", ["", "# nothing\n", "---\n", "just text\n", "[]\n", "{}\n"])
def test_a_file_of_nothing_is_said(name: str, content: str, tmp_path: Path) -> None:
    if name == "fault" and content == "[]\n":
        return
    assert "must be a list" in (said := refused(tmp_path, name, content)) or "no fields" in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pegs: [circle, sqare]\n", "line 1: unknown peg 'sqare'"),
        ("conditions:\n- all\n- win\n", "line 3: unknown condition 'win'"),
        ("conditions: {name: w, hole_y: [1, 2]}\n", "line 1: unknown quantity 'hole_y'"),
        ("conditions:\n  name: w\n  hole_y_mm: [1]\n", "line 3: condition 'w': hole_y_mm is [1]"),
        ("reasoners:\n- none\n- {name: b, pictur: 1}\n", "line 3: unknown field of the VLM 'pict"),
        ("reasoners: vlm\nvlm:\n  model: m\n  history: -1\n", "line 4: history is -1"),
        ("reasoners: vlm\nvlm:\n  model: m\n  history: true\n", "line 4: VLM: history is True"),
        ("reasoners: vlm\nvlm: 5\n", "line 2: vlm is 5"),
        ("goals: 5\n", "line 1: goals is 5"),
        ("method: 5\n", "line 1: method is 5"),
        ("level: L99\n", "line 1: unknown level 'L99'"),
        ("cells: 5\n", "line 1: cells must be a list"),
        ("cells:\n- {peg: circle}\n", "line 2: a cell lacks its condition"),
        ("cells:\n- peg: circle\n  pegs: square\n", "line 3: unknown field of a cell 'pegs'"),
        ("cells:\n- {peg: circle, condition: all,\n   reasoner: me}\n", "line 3: unknown reasoner"),
    ],
)
def test_an_experiments_names_are_refused_with_their_line(
    text: str, said: str, tmp_path: Path
) -> None:
    for field in ("pegs: circle\n", "conditions: all\n", "reasoners: rules\n"):
        if field.partition(":")[0] not in text and "cells" not in text:
            text += field
    assert refused(tmp_path, "experiment", text).startswith(said)


def test_what_the_command_line_replaces_is_not_said_with_a_line_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "experiment", KINDS["experiment"].text)
    with pytest.raises(InputError, match=r"\.yaml': unknown peg 'star'"):
        plan.load(path, {"pegs": ["star"]})


def test_a_serial_number_without_quotes_is_asked_for_in_quotes(tmp_path: Path) -> None:
    text = KINDS["cell"].text
    line = text[: text.index('where: ""')].count("\n") + 1
    for number in ("012345670123", "912345670123", "0"):
        message = refused(tmp_path, "cell", text.replace('where: ""', f"where: {number}"))
        assert message.startswith(f"line {line}: camera.where is {number}: ")
        assert f'quote it, "{number}"' in message


@pytest.mark.parametrize(("goals", "said"), [('""', "a file's path"), ("", "is empty")])
def test_goals_that_name_no_file_are_refused(goals: str, said: str, tmp_path: Path) -> None:
    text = KINDS["cell"].text.replace("goals: null", f"goals: {goals}")
    assert said in refused(tmp_path, "cell", text)


# --- anything at all ----------------------------------------------------------------------------

_PIECES = st.sampled_from(
    [
        *"\t\n\r\0:#-?&*![]{},|>'\"%@`~ ",
        "- ",
        ": ",
        "\n\n",
        "---",
        "<<: ",
        "010",
        "1:30",
        "yes",
        "''",
    ]
    + ["\N{NO-BREAK SPACE}", "\N{BOM}", "\u2028", "ü", "1e999", "-", "null", "[[", "\\", "99999999"]
)


@st.composite
def broken(draw: st.DrawFn, text: str) -> bytes:
    """A valid file with a few pieces put in, taken out, doubled or moved; or any bytes."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 12)))
        piece = draw(_PIECES | st.just(text[start:end] * 2) | st.text(max_size=4))
        text = text[:start] + piece + text[end:]
    return text.encode("utf-8", "surrogatepass")


@every_kind
@given(data=st.data())
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_file_is_read_or_refused_in_one_line_at_once(
    name: str, data: st.DataObject, tmp_path: Path
) -> None:
    path = written(tmp_path, name, data.draw(broken(KINDS[name].text)))
    began, said = time.process_time(), ""
    try:
        KINDS[name].read(path)
    except InputError as error:
        said = str(error)
    assert "\n" not in said
    assert time.process_time() - began < 1.0
