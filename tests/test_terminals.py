"""Names in any language, on terminals and in locales that know only some of them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_tables import made

from pliant import store
from pliant.errors import InputError
from pliant.experiment import holdings, results
from pliant.experiment.plan import from_fields
from pliant.task import load_task

_COMMANDS = """
import sys
from pliant.cli import main
for words in " ".join(sys.argv[1:]).split(" -- "):
    sys.argv = ["pliant", *words.split()]
    try:
        main()
    except SystemExit as ended:
        print("ended", ended.code, flush=True)
"""
_UTF8, _LATIN = "größe≠.yaml".encode(), b"gr\xf6\xdfe.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished experiment, and peg files that cannot be used, under names in any encoding."""
    folder = tmp_path_factory.mktemp("größe")
    fields = {"pegs": "circle", "conditions": "all", "reasoners": "none", "trials": 1}
    holdings.prepare(from_fields(fields), folder / "run")
    results.write_rows(folder / "run", [made(1, inserted=True, reasoner="größe≠")])
    for name in (_UTF8, _LATIN):
        (folder / os.fsdecode(name)).write_text("shape: größe≠\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    "settings",
    [
        {"PYTHONIOENCODING": "cp1252"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ],
    ids=["cp1252", "ascii"],
)
def test_what_a_terminal_cannot_show_is_replaced(folder: Path, settings: dict[str, str]) -> None:
    words: list[bytes] = [b"tables", b"run", b"--"]
    words += [b"run", b"--peg", _UTF8, b"--", b"run", b"--peg", _LATIN, b"--", b"run", b"--help"]
    kept = {k: v for k, v in os.environ.items() if k not in ("LANG", "LC_ALL", "PYTHONUTF8")}
    done = subprocess.run(
        [sys.executable, "-c", _COMMANDS, *words],
        cwd=folder,
        env={**kept, **settings},
        capture_output=True,
        check=False,
    )
    said, complained = done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")
    assert "Traceback" not in complained
    assert [line for line in said.splitlines() if line.startswith("ended")] == [
        "ended 0",
        "ended 2",
        "ended 2",
        "ended 0",
    ]
    assert "Judged " in said
    assert complained.count("peg file '") == 2
    assert complained.count("line 1: shape is gr") == 2


def test_a_pegs_name_is_text_whatever_its_files_name_is(tmp_path: Path) -> None:
    for name, shown in ((_UTF8, "größe≠"), (_LATIN, "gr\N{REPLACEMENT CHARACTER}" * 2 + "e")):
        path = tmp_path / os.fsdecode(name)
        path.write_text("shape: circle\ndiameter_mm: 40\n", encoding="utf-8")
        found = load_task(str(path)).peg.name
        assert found.encode().decode() == found
        assert found in (shown, "gr\N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER}e")


def test_an_output_folder_that_libraries_cannot_name_is_refused_at_once(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"gr\xf6\xdfe") / "run"
    with pytest.raises(InputError, match="its name is not UTF-8"):
        store.prepare_folder(folder)
    assert list(tmp_path.iterdir()) == []
