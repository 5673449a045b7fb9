"""Text from outside is shown as text: by a terminal, and in Markdown."""

import ast
import io
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table
from rich.text import Text
from view_folders import HOSTILE

import pliant
from pliant.cli import main
from pliant.console import Console, complain, say
from pliant.experiment import results, tables
from pliant.experiment.bench import table as bench
from pliant.experiment.tables_text import markdown as tables_as_text
from pliant.text import code, in_a_line, markdown, visible

OBEYED = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""What a terminal would obey: all controls but tab and the line's end."""
TITLE = "\x1b]0;owned\x07\x9b2J\r"


@given(st.text(st.characters(exclude_categories=[])))
def test_what_a_terminal_obeys_is_shown(text: str) -> None:
    assert OBEYED.search(visible(text)) is None
    visible(text).encode()
    assert "\n" not in in_a_line(text)


def test_controls_are_shown_by_their_signs() -> None:
    assert visible("a\x1b[2J\x07\tb\n") == "a␛[2J␇\tb\n"
    assert in_a_line("a\r\nb\rc\td") == "a␊b␍c d"


@pytest.mark.parametrize("text", [HOSTILE, TITLE, "[link=file:///etc]here[/link]"])
def test_the_console_sends_no_text_as_a_command(text: str) -> None:
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=300, highlight=False)
    table = Table()
    table.add_column(text)
    table.add_row(text, Text(text, style="bold"))
    for shown in (text, Text(text), table):
        console.print(shown)
    with console.status(Text(text)):
        pass
    own = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")  # colours and the cursor: Rich's
    sent = file.getvalue()
    assert OBEYED.search(own.sub("", sent).replace("\r", "")) is None
    assert "\x1b]" not in sent
    assert "\x1b[2J" not in sent


def test_plain_lines_are_sent_so_too(capsys: pytest.CaptureFixture[str]) -> None:
    say(f"a{TITLE}\nb")
    complain(f"a{TITLE}\nb")
    out, err = capsys.readouterr()
    assert (
        out == "a␛]0;owned␇\N{REPLACEMENT CHARACTER}2J\nb\n"
    )  # the end of a line as Windows writes it
    assert OBEYED.search(out + err) is None
    assert err.count("\n") == 1


def test_an_error_is_one_line_whatever_it_names(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["pliant", "tables", f"no{TITLE}\npliant: all is well"])
    with pytest.raises(SystemExit):
        main()
    err = capsys.readouterr().err
    assert OBEYED.search(err) is None
    assert err.count("\n") == 1


def test_there_is_one_way_to_the_terminal() -> None:
    root = Path(pliant.__file__).parent
    for path in root.rglob("*.py"):
        if path == root / "console.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "rich.console":
                assert "Console" not in [name.name for name in node.names], path
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id != "print", f"{path}:{node.lineno}"


# --- Markdown ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "rules",
        "L6+",
        "tests/voices.py:SpeaksForRules (scripted)",
        "missed_edge",
        "openai:gpt-4o",
        "−1.2",
        "0–1.25",
    ],
)
def test_an_ordinary_name_stays_as_it_is(name: str) -> None:
    assert markdown(name) == name


@given(st.text())
def test_markup_is_escaped_and_a_line_stays_one(text: str) -> None:
    escaped = markdown(text)
    assert "\n" not in escaped
    assert re.search(r"(?<!\\)(\\\\)*[|`<*\[\]&]", escaped) is None
    assert "`" not in code(text)[1:-1]


def test_tables_show_hostile_names_as_text(tmp_path: Path) -> None:
    from view_folders import experiment

    folder = experiment(tmp_path)
    rows = results.read_trials(folder).to_pylist()
    name = f"a | b\n## c <img src=x> [d](javascript:e) {TITLE}"
    assert rows
    document = tables.build(folder)
    plain = tables_as_text(document)
    for cell in document["cells"]:
        cell["reasoner"] = name
    text = tables_as_text(document)
    assert text.count("\n") == plain.count("\n")
    assert "<img" not in text.replace("\\<img", "")
    assert "[d](" not in text
    assert OBEYED.search(text) is None
    widths = {line.replace("\\|", "").count("|") for line in text.splitlines() if "a \\| b" in line}
    assert widths <= {line.count("|") for line in plain.splitlines()}


def test_a_benchmarks_tables_show_hostile_names_as_text() -> None:
    score = {"percent": 1.0, "low": 0.0, "high": 2.0, "n": 1, "successes": 1}
    group: dict[str, Any] = dict.fromkeys(
        ["balanced_accuracy", "false_accepts", "false_rejects", "stops", "stops_needlessly", "own"]
        + ["plan_valid", "start_right", "retreat_right", "direction_right", "reaches"],
        score,
    )
    group |= {"n": 1, "toward_mm": None, "input_tokens": 0, "output_tokens": 0, "requests": 0}
    group |= {"cost_usd": None, "latency_s": None}
    all_groups = {"all": group, "by_kind": {"|": group}, "by_formation": {"\n": group}}
    text = bench.markdown(
        {"cases": {"n": 1, "of": 1, "hash": "|"}, "reasoners": {"a|b\n<img>": all_groups}}
    )
    assert "a\\|b␊\\<img\\>" in text
