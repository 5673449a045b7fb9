"""Every command, file and snippet in the documents does what it is shown for.

What must come of each stands in `shown.py`, page by page; a new block needs a line there.
"""

import itertools
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from documents import DOCUMENTS, ROOT, Block, blocks, name
from shown import PAGES, Comes, Elsewhere, Ran

from pliant.cli import main

BY_NAME = {name(path): path for path in DOCUMENTS}


def pages_with(*, slow: bool) -> list[str]:
    found = []
    for page, said in PAGES.items():
        if any(isinstance(b, Comes) and b.slow is slow for b in said.blocks.values()):
            found.append(page)
    return found


@pytest.mark.parametrize("page", [p for p in BY_NAME if [*blocks(BY_NAME[p])]])
def test_what_comes_of_each_block_is_said(page: str) -> None:
    shown = {block.name for block in blocks(BY_NAME[page])}
    said = set(PAGES[page].blocks) if page in PAGES else set()
    assert shown - said == set(), f"say in tests/shown.py under {page!r} what must come of these"
    assert said - shown == set(), f"{page} no longer shows these: take them out of tests/shown.py"


def test_a_block_that_is_run_by_another_test_is_there() -> None:
    for page in PAGES.values():
        for block in page.blocks.values():
            if isinstance(block, Elsewhere):
                text = (ROOT / "tests" / block.test).read_text(encoding="utf-8")
                assert block.word in text, block


@pytest.mark.parametrize("page", pages_with(slow=False))
def test_what_a_page_shows_comes_true(page: str, on: "Shell") -> None:
    on.run(page, slow=False)


@pytest.mark.system
@pytest.mark.parametrize("page", pages_with(slow=True))
def test_what_a_page_shows_comes_true_where_it_takes_long(page: str, on: "Shell") -> None:
    on.run(page, slow=True)


def test_a_block_that_does_not_do_what_it_is_shown_for_is_noticed(on: "Shell") -> None:
    code = 'print("not inserted")'
    with pytest.raises(AssertionError, match="does not say"):
        on.comes(Block(name="python 1", language="python", code=code), Comes(says=("^inserted",)))
    with pytest.raises(AssertionError, match="does not make"):
        on.comes(Block(name="python 1", language="python", code=code), Comes(makes=("no.file",)))
    with pytest.raises(AssertionError, match="exit status 2"):
        on.comes(
            Block(name="pliant run --peg star", language="", code="pliant run --peg star"), Comes()
        )


def lessened(code: str, less: str) -> str:
    """A command with other options, each in the place of the one that it has already."""
    words, added = shlex.split(code), shlex.split(less)
    if words[0] != "pliant":
        return f"{code} {less}"
    for option in (word for word in added if word.startswith("--")):
        if option in words:
            start = words.index(option)
            values = itertools.takewhile(lambda w: not w.startswith("--"), words[start + 1 :])
            del words[start : start + 1 + len([*values])]
    return shlex.join([*words, *added])


class Shell:
    """A reader at an empty folder, who copies what a page shows."""

    def __init__(
        self, folder: Path, patch: pytest.MonkeyPatch, capture: pytest.CaptureFixture[str]
    ) -> None:
        self.folder, self._patch, self._capture = folder, patch, capture
        self._printed: dict[str, str] = {}
        patch.chdir(folder)
        (folder / "reproduce").symlink_to(ROOT / "reproduce")

    def run(self, page: str, *, slow: bool) -> None:
        """All of a page in its order: what is slow needs the rest, and is left out without it."""
        shown, said = [*blocks(BY_NAME[page])], PAGES[page]
        for file, (source, title) in said.takes.items():
            (code,) = (b.code for b in blocks(BY_NAME[source]) if b.name == title)
            (self.folder / file).write_text(code, encoding="utf-8")
        for block in shown:
            if block.is_file:
                (self.folder / block.name).write_text(block.code, encoding="utf-8")
        if said.prepared is not None:
            said.prepared(self.folder)
        for block in shown:
            outcome = said.blocks[block.name]
            if isinstance(outcome, Comes) and (slow or not outcome.slow):
                self.comes(block, outcome)

    def comes(self, block: Block, outcome: Comes) -> None:
        names: dict[str, object] = {}
        file = self.folder / (block.name if block.is_file else f"shown.{block.language}")
        if not block.language:
            status = self._command(lessened(block.code, outcome.less))
        else:
            if not block.is_file:
                file.write_text(block.code, encoding="utf-8")
            status = 0
            if block.language == "python" and not block.is_file:
                names = runpy.run_path(str(file), run_name="__main__")
            elif block.language == "sql":
                duckdb = pytest.importorskip("duckdb")
                print(duckdb.sql(block.code))
        printed = "".join(self._capture.readouterr())
        self._printed[block.name] = printed
        told = f"{block.code}\n{printed}"
        assert status == outcome.status, f"exit status {status}: {told}"
        for pattern in outcome.says:
            found = re.search(pattern, printed, re.MULTILINE)
            assert found, f"does not say {pattern}: {told}"
        for path in outcome.makes:
            assert [*self.folder.glob(path)], f"does not make {path}: {told}"
        if outcome.then is not None:
            ran = Ran(
                folder=self.folder,
                printed=printed,
                before=self._printed,
                names=names,
                code=block.code,
                file=file,
            )
            outcome.then(ran)

    def _command(self, line: str) -> int:
        words = shlex.split(line)
        if words[0] == "pliant":
            self._patch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as ended:
                main()
            return int(ended.value.code or 0)
        at_home = words[0] in ("make", "pytest")
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=ROOT if at_home else self.folder,
            env={**os.environ, "PATH": path},
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        sys.stdout.write(done.stdout)
        sys.stderr.write(done.stderr)
        return done.returncode


@pytest.fixture
def on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    return Shell(tmp_path, monkeypatch, capsys)
