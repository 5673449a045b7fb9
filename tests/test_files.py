"""What a person writes is read strictly, each refusal with its line; a file is written whole."""

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant import files
from pliant.errors import InputError
from pliant.files import parse_yaml, read_yaml, yaml_text


def refused(text: str | bytes) -> str:
    content = text if isinstance(text, bytes) else text.encode()
    with pytest.raises(InputError) as caught:
        parse_yaml(content, "file 'a.yaml'")
    message = str(caught.value)
    assert message.startswith("file 'a.yaml'")
    assert "\n" not in message
    assert len(message) < 300
    return message.removeprefix("file 'a.yaml'").removeprefix(", ")


@pytest.mark.parametrize(
    ("written", "advice"),
    [
        ("010", "write 10 for"),
        ("-010", "write -10 for"),
        ("+010.50", "write 10.50 for"),
        ("00", "write 0 for"),
        ("08", "write 8 for"),
        ("012345670123", 'quote it, "012345670123"'),
        ("1:30", "write 90 for"),
        ("-1:30:30.5", "write -5430.5 for"),
        ("8:20", 'quote it, "8:20"'),
        ("1_000", "write 1000 for"),
        ("1_000.5", "write 1000.5 for"),
        ("0.000_1", "write 0.0001 for"),
        ("0x1F", "write 31 for"),
        ("-0x1f", "write -31 for"),
        ("0o17", "write 15 for"),
        ("0b101", "write 5 for"),
        ("0,5", "write 0.5 for"),
        ("\N{MINUS SIGN}10", "write -10 for"),
        ("on", "true or false"),
        ("Yes", 'quote it, "Yes"'),
        ("OFF", "write a number"),
        ("no", "true or false"),
        (".inf", "must be finite"),
        ("-.Inf", "must be finite"),
        (".NaN", "must be finite"),
        ("1e999", "too large"),
        ("4" * 5000, "quote it"),
        ("0" * 5000, "quote it"),
        ("1_" * 5000, "quote it"),
        ("2025-31-12", 'quote it, "2025-31-12"'),
        ("2025-12-31", "a date is text"),
        ("2001-12-14t21:59:43.10-05:00", "a date is text"),
        ("4\N{NO-BREAK SPACE}0", "U+00A0"),
        ("&a 1", "write the value out"),
        ("*a", "write the value out"),
        ("!!python/object/apply:os.system [ls]", "write the value without"),
        ("!!int 3", "write the value without"),
    ],
)
def test_a_value_that_readers_take_differently_is_refused_with_what_to_write(
    written: str, advice: str
) -> None:
    message = refused(f"a:\n- 1\nb:\n  value: {written}\n")
    assert message.startswith("line 4: ")
    assert written[:20].split()[0] in message
    assert advice in message


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0),
        ("-0", 0),
        ("+7", 7),
        ("1.50", 1.5),
        (".5", 0.5),
        ("5.", 5.0),
        ("1e3", 1000.0),
        ("-1.5E-3", -0.0015),
        ("true", True),
        ("False", False),
        ("~", None),
        ("null", None),
        ('"010"', "010"),
        ("'on'", "on"),
        ("192.168.1.10", "192.168.1.10"),
        ("http://127.0.0.5:30101/side.png", "http://127.0.0.5:30101/side.png"),
        ("y", "y"),
        ("none", "none"),
        ("L6+", "L6+"),
        ("größe µ", "größe µ"),
        ("40mm", "40mm"),
        ("[1, [a, {b: 2}]]", [1, ["a", {"b": 2}]]),
    ],
)
def test_any_other_value_means_what_it_looks_like(text: str, value: object) -> None:
    found = parse_yaml(f"a: {text}".encode(), "file").value["a"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("a: 1\nb: 2\n# c\na: 3\n", 4, "'a' stands on line 1 already"),
        ("a:\n  b: 1\n  c: {d: 1, d: 2}\n", 3, "'a.c.d' stands on line 3 already"),
        ("w: {x: 1}\nv: 1\n\nw:\n  x: 2\n", 4, "'w' stands on line 1 already"),
        ("a: 1\n<<: {b: 2}\n", 2, "'<<'"),
        ("a: 1\n? [b]\n: 2\n", 2, "a field's name must be text"),
        ("a: {b c\n d\n\n e: }\n", 4, "empty: write null"),
        ("a: 1\n3: 2\n", 2, "'3' as a field's name must be text: quote it"),
        ("a: 1\non: 2\n", 2, "true or false"),
        ("a: 1\nb:\nc: 2\n", 2, "b is empty: write null, or remove it"),
        ("a: 1\nb: [1, c: ]\n", 2, "b (item 2).c is empty"),
        ("a: 1\n---\nb: 1\n", 2, "a second document begins"),
        ("a: 1\n\tb: 2\n", 2, "a tab: put spaces in its place"),
        ("a:\tb\n", 1, "a tab: put spaces in its place"),
        ("a: 1\nb: [1\n", 3, "not YAML"),
        ("a: 1\nb:\N{NO-BREAK SPACE}2\n", 3, "not YAML"),
        ("a: 1\nb: c: d\n", 2, "mapping values are not allowed here: 'b: c: d'"),
        ('a: 1\nb: "\\q"\n', 2, "unknown escape"),
        ("a: 1\nb: \0\n", 2, "U+0000"),
        ('a: 1\nb: "\\0"\n', 2, "U+0000"),
        ('a: 1\nb: "\\ud800"\n', 2, "U+D800"),
        (b"a: 1\nb: gr\xf6\xdfe\n", 2, "byte 0xf6 is not UTF-8: save the file as UTF-8"),
        ("a: 1\n".encode("utf-16"), 1, "not UTF-8"),
        ("x:\n" + "".join(" " * i + "a:\n" for i in range(1, 99)), 51, "more than 50"),
        ("a: 1\nb: " + "[" * 10_000, 2, "more than 50"),
        ("a: 1\n" + "- " * 10_000, 2, "not YAML"),
        ("a:\n" + "- 1\n" * 6_000, 5001, "more than 5000 values"),
    ],
)
def test_a_malformed_file_is_refused_with_its_line(
    text: str | bytes, line: int, reason: str
) -> None:
    message = refused(text)
    assert message.startswith(f"line {line}: ")
    assert reason in message


def test_aliases_that_multiply_are_refused_at_the_first() -> None:
    bomb = "a: &a [x, x]\n" + "".join(
        f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abc", "bcd", strict=True)
    )
    assert "line 1: '&a" in refused(bomb)


def test_a_number_out_of_range_of_characters_is_one_line() -> None:
    assert "is not YAML" in refused('a: "\\UFFFFFFFF"')
    assert "is not YAML" in refused("%YAML " + "1" * 5000 + ".1\n---\na: 1\n")


@pytest.mark.parametrize("text", ["\N{BOM}a: 1\n", "a: 1\r\n", "a: 1\r\n# c\r\n", "---\na: 1\n..."])
def test_a_byte_order_mark_and_windows_line_ends_are_taken(text: str) -> None:
    assert parse_yaml(text.encode(), "file").value == {"a": 1}


def test_what_is_no_file_is_refused_without_being_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path, tmp_path / "fifo", Path("/dev/zero"), tmp_path / "none.yaml"):
        with pytest.raises(InputError, match=f"^peg file '{path}' cannot be read: .*; do this$"):
            read_yaml(path, "peg file", "do this")
    with pytest.raises(InputError, match="null"):
        read_yaml(Path("a\0b"), "peg file")


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes(b"#" * 200_000)
    with pytest.raises(InputError, match="larger than 100 kB"):
        read_yaml(tmp_path / "a.yaml", "peg file")


def test_a_value_is_said_with_its_line_and_as_it_is_written() -> None:
    document = parse_yaml(b"a: 1\nb:\n\n  c: [1, 2.50]\n  d: 'x'\n", "file")
    assert str(document.error(("b", "c", 1), "no")) == "file, line 4: no"
    assert str(document.error(("b",), "no")) == "file, line 2: no"
    assert str(document.error(("b", "none", "c"), "no")) == "file, line 2: no"
    assert str(document.error(("none",), "no")) == "file: no"
    assert document.written(("b", "c", 1)) == "2.50"
    assert document.written(("b", "d")) == '"x"'
    assert document.written(("b", "c")) == "[1, 2.5]"


_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs", "Cc", "Cn", "Co"]))
    | st.sampled_from(["010", "1e3", "1:30", "on", "0o17", "2025-01-01", "~", "- a", "a: b", "#"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("ab-1"), inner, max_size=4),
    max_leaves=12,
)


@given(_values)
def test_what_is_written_is_read_back_the_same(value: Any) -> None:
    assert parse_yaml(yaml_text({"a": value}).encode(), "file").value == {"a": value}
    line = files.yaml_value(value)
    assert "\n" not in line
    assert parse_yaml(f"a: {line}".encode(), "file").value == {"a": value}


# --- out -----------------------------------------------------------------------------------------


def test_a_file_is_replaced_whole_and_keeps_its_mode_and_the_link_to_it(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "folder" / "link"
    target.write_bytes(b"old")
    target.chmod(0o640)
    link.parent.mkdir()
    link.symlink_to("../target")
    files.write_text(link, "new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert target.stat().st_mode & 0o777 == 0o640
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["folder", "link", "target"]


def test_a_file_that_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        files.write_bytes(tmp_path / "a", b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
