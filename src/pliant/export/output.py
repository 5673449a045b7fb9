"""The output of an export: a new folder, whole or not at all, with a card that says what it is."""

import json
import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

from pliant.errors import InputError
from pliant.export.source import HELD_OUT, Source
from pliant.text import code, markdown

CARD = "README.md"
LICENCE = "apache-2.0"


@contextmanager
def filling(path: Path) -> Iterator[Path]:
    """A folder to fill with an export. It becomes `path` when the block ends well, and goes when it
    does not.

    Raises:
        InputError: `path` holds something already, or cannot be written.
    """
    check_new(path)
    partial = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.mkdir()  # new: nobody knew its name
        try:
            yield partial
            if path.exists():
                path.rmdir()
            partial.rename(path)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be written: {error.strerror or error}; choose another folder"
        ) from error


def check_new(path: Path) -> None:
    """Refuse to write over anything but an empty folder.

    Raises:
        InputError: there is something.
    """
    try:
        taken = path.exists() and not (path.is_dir() and not any(path.iterdir()))
    except OSError as error:
        raise InputError(f"'{path}' cannot be used: {error.strerror}; choose another") from error
    if taken:
        raise InputError(f"'{path}' exists already: nothing is overwritten, choose a new name")


def origin(source: Source) -> list[str]:
    """The data's origin, as lines of Markdown."""
    run, configuration = source.run, source.run.get("configuration", {})
    commit = run.get("commit") or "not recorded (an installed pliant)"
    changed = ", with changes that were not committed" if run.get("dirty") else ""
    versions = ", ".join(f"{name} {v}" for name, v in run.get("versions", {}).items())
    return [
        f"- Run: {code(source.folder.resolve().name)}, begun {markdown(str(run.get('started')))},"
        f" fingerprint {code(str(configuration.get('fingerprint', 'none')))}",
        f"- Commit of pliant: {code(str(commit))}{changed}",
        f"- Versions: {markdown(versions)}",
        f"- Reasoners: {markdown(str(run.get('reasoner')))}",
        "- Licence: Apache-2.0, for the data as for the code",
        "- Everything is simulated (MuJoCo); the arm's and the gripper's meshes come from MuJoCo"
        " Menagerie.",
    ]


class LinesBySplit:
    """A file of JSON lines for each split, made when its first line comes."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self._files: dict[str, IO[str]] = {}

    def add(self, split: str, line: Mapping[str, Any]) -> None:
        if split not in self._files:
            path = self._folder / f"{split}.jsonl"
            self._files[split] = self._stack.enter_context(path.open("w", encoding="utf-8"))
        self._files[split].write(json.dumps(line, ensure_ascii=False) + "\n")


def front_matter(category: str, splits: Sequence[str]) -> list[str]:
    """The head of a card of JSON lines, as hubs of data sets read it."""
    return [
        "---",
        f"license: {LICENCE}",
        "task_categories:",
        f"- {category}",
        "tags:",
        "- robotics",
        "- peg-in-hole",
        "- failure-recovery",
        "configs:",
        "- config_name: default",
        "  data_files:",
        *[f"  - {{split: {split}, path: {split}.jsonl}}" for split in splits],
        "---",
        "",
    ]


def split_rule() -> str:
    return (
        f"A trial is in `test` if its seed can be divided by {HELD_OUT}, else in `train`: pegs,"
        " conditions and reasoners share their seeds, so no drawn setup is in both. Where a"
        " condition draws nothing, every seed gives the same trial; these go together, with the"
        " lowest of their seeds."
    )


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """A Markdown table, as lines."""
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(str(cell) for cell in line) + " |" for line in lines]
