"""Links in the documents lead somewhere, their code names what exists; `test_shown.py` runs it."""

import ast
import contextlib
import importlib
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from documents import DOCUMENTS, FENCE, ROOT, blocks, name

from pliant.cli import parsed
from pliant.errors import InputError

_LINK = re.compile(r"\]\((?![a-z]+:)([^)#\s]*)(?:#([^)\s]+))?\)")


def anchors(path: Path) -> set[str]:
    """A document's headings as a code host writes them into addresses."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=name)
def test_every_link_leads_to_a_file_and_a_heading_of_it(path: Path) -> None:
    for link, anchor in _LINK.findall(FENCE.sub("", path.read_text(encoding="utf-8"))):
        target = (path.parent / link).resolve() if link else path
        assert target.exists(), f"{link} leads nowhere"
        assert target.is_relative_to(ROOT)
        if anchor:
            assert anchor in anchors(target), f"{link}#{anchor} is no heading"


def test_checking_a_number_leaves_the_published_results_as_they_are() -> None:
    scripts = sorted((ROOT / "reproduce").glob("*.sh"))
    assert len(scripts) > 10
    for script in scripts:
        lines = script.read_text(encoding="utf-8").splitlines()
        done = [line for line in lines if not line.startswith("#")]
        assert not any("reproduce/results" in line for line in done), script


# --- commands ----------------------------------------------------------------------------------


_COMMAND = re.compile(r"^(    )?pliant [a-z-]+|\| `(pliant [^`]+)` \|")


def commands() -> list[Any]:
    """Every line of a command, in fences, indented, and in a table's cell."""
    lines = [
        (path, (inline or line).strip())
        for path in DOCUMENTS
        for line in path.read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
        for _, inline in re.findall(_COMMAND, line)
    ]
    return [pytest.param(line, id=f"{name(path)}: {line}") for path, line in lines]


def parse(line: str) -> None:
    """Take a command line as pliant does, and do nothing."""
    words = shlex.split(line, comments=True)[1:]
    if words != ["--version"]:
        with contextlib.suppress(SystemExit):  # a page of help
            parsed(words)


WRONG = "pliant run --peg sqare", "pliant run --vidoe"  # shown for what is answered


@pytest.mark.parametrize("line", commands())
def test_every_command_in_a_document_is_one_that_pliant_takes(line: str) -> None:
    if not line.startswith(WRONG):
        parse(line)


def test_a_command_that_pliant_does_not_take_would_be_noticed() -> None:
    with pytest.raises(InputError):
        parse("pliant run --colour red")


# --- code --------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", DOCUMENTS, ids=name)
def test_everything_that_code_in_a_document_imports_from_pliant_exists(path: Path) -> None:
    for code in (b.code for b in blocks(path) if b.language == "python"):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pliant"):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    if not hasattr(module, alias.name):
                        importlib.import_module(f"{node.module}.{alias.name}")
