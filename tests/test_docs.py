"""What the documents say works: links, commands, code."""

import ast
import functools
import importlib
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tyro

from pliant.cli import main
from pliant.conditions import condition
from pliant.experiment import plan
from pliant.experiment.one import Spec, perform
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

ROOT = Path(__file__).parent.parent
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
RUN = [ROOT / "docs" / "loop.md", *sorted((ROOT / "docs" / "how-to").glob("*.md"))]

_FENCE = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\((?![a-z]+:)([^)#\s]*)(?:#([^)\s]+))?\)")


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def fences(path: Path, language: str) -> list[str]:
    """Code of a language that is not a file to be saved."""
    return [
        code
        for info, code in _FENCE.findall(path.read_text(encoding="utf-8"))
        if info.strip() == language
    ]


def files_to_save(path: Path) -> dict[str, str]:
    """Code under a title, by its file's name."""
    titled = re.compile(r'title="([^"]+)"')
    found = (
        (titled.search(info), code)
        for info, code in _FENCE.findall(path.read_text(encoding="utf-8"))
    )
    return {title[1]: code for title, code in found if title is not None}


def anchors(path: Path) -> set[str]:
    """A document's headings as a code host writes them into addresses."""
    text = _FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=name)
def test_every_link_leads_to_a_file_and_a_heading_of_it(path: Path) -> None:
    for link, anchor in _LINK.findall(_FENCE.sub("", path.read_text(encoding="utf-8"))):
        target = (path.parent / link).resolve() if link else path
        assert target.exists(), f"{link} leads nowhere"
        assert target.is_relative_to(ROOT)
        if anchor:
            assert anchor in anchors(target), f"{link}#{anchor} is no heading"


# --- commands ----------------------------------------------------------------------------------


def commands() -> list[Any]:
    """Every line of a command, in fences and indented."""
    lines = [
        (path, line.strip())
        for path in DOCUMENTS
        for line in path.read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
        if re.match("(    )?pliant [a-z-]+", line)
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
    for code in [*fences(path, "python"), *files_to_save(path).values()]:
        if "import" not in code:
            continue
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pliant"):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    if not hasattr(module, alias.name):
                        importlib.import_module(f"{node.module}.{alias.name}")


@pytest.mark.parametrize("path", [p for p in RUN if fences(p, "python")], ids=name)
def test_the_code_of_the_how_tos_runs(path: Path, tmp_path: Path) -> None:
    for code in fences(path, "python"):
        (tmp_path / "snippet.py").write_text(code, encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "snippet.py"],
            cwd=tmp_path,
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip()


@pytest.mark.parametrize(
    ("page", "file", "reasoner"),
    [("start.md", "seen_hole.py", "SeenHole"), ("how-to/reasoner.md", "mine.py", "Mine")],
)
def test_a_documents_own_reasoner_recovers_and_inserts(
    page: str, file: str, reasoner: str, tmp_path: Path
) -> None:
    code = files_to_save(ROOT / "docs" / page)[file]
    assert len(code.splitlines()) <= 45
    (tmp_path / file).write_text(code, encoding="utf-8")
    spec = Spec(
        task=load_task("circle"),
        condition=condition("all"),
        seed=1,
        reasoner=f"{tmp_path / file}:{reasoner}",
    )
    trial = perform(spec, SimCell(), shipped())
    assert any(e.recovery is not None for e in trial.executions)
    assert trial.inserted


def test_the_files_of_the_how_tos_can_be_used(tmp_path: Path) -> None:
    how_to = ROOT / "docs" / "how-to"
    for page, file in (("peg.md", "my_peg.yaml"), ("experiments.md", "mine.yaml")):
        (tmp_path / file).write_text(files_to_save(how_to / page)[file], encoding="utf-8")
    assert load_task(str(tmp_path / "my_peg.yaml")).peg.name == "my_peg"
    assert len(plan.load(tmp_path / "mine.yaml")) == 110
