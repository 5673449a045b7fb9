"""Links in the documents lead somewhere, their code names what exists; `test_shown.py` runs it."""

import ast
import functools
import importlib
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tyro
from documents import DOCUMENTS, FENCE, ROOT, blocks, name

from pliant.cli import main

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


@pytest.fixture
def parse(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Parses a command line as pliant does, and does nothing else."""
    take = tyro.extras.subcommand_cli_from_dict
    known: dict[str, Callable[..., Any]] = {}
    monkeypatch.setattr(
        tyro.extras, "subcommand_cli_from_dict", lambda given, **_: known.update(given)
    )
    with pytest.raises(SystemExit):
        main()

    def idle(command: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(command)
        def nothing(*_: object, **__: object) -> None: ...

        return nothing

    idled = {key: idle(command) for key, command in known.items()}
    return lambda line: take(idled, prog="pliant", args=shlex.split(line, comments=True)[1:])


@pytest.mark.parametrize("line", commands())
def test_every_command_in_a_document_is_one_that_pliant_takes(
    line: str, parse: Callable[[str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        parse(line)
    except SystemExit:
        pytest.fail(capsys.readouterr().err)


def test_a_command_that_pliant_does_not_take_would_be_noticed(
    parse: Callable[[str], None],
) -> None:
    with pytest.raises(SystemExit):
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
