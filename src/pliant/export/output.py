"""The output of an export: a new folder, whole or not at all, with a card that says what it is."""

import json
import secrets
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

from pliant.console import Told
from pliant.errors import InputError
from pliant.export.source import HELD_OUT, SPLITS, Saved, Source
from pliant.store import PICTURES
from pliant.table import Table
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


class Lines:
    """Writer of a folder of JSON lines and pictures: a file for each split, made when its first
    line comes."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self.pictures = folder / PICTURES
        self.pictures.mkdir()
        self._files: dict[str, IO[str]] = {}
        self.tally: Counter[tuple[str, ...]] = Counter()  # split, and what a line is counted as

    def add(self, line: Mapping[str, Any], split: str, *counted: str) -> None:
        if split not in self._files:
            path = self._folder / f"{split}.jsonl"
            self._files[split] = self._stack.enter_context(path.open("w", encoding="utf-8"))
        self._files[split].write(json.dumps(line, ensure_ascii=False) + "\n")
        self.tally[split, *counted] += 1

    def totals(self) -> dict[str, int]:
        """The number of lines in each split."""
        counted = {
            split: [n for key, n in self.tally.items() if key[0] == split] for split in SPLITS
        }
        return {split: sum(found) for split, found in counted.items()}

    def present(self) -> list[str]:
        """The splits that have lines."""
        return [split for split, n in self.totals().items() if n]

    def kinds(self, head: Sequence[str], order: Callable[[tuple[str, ...]], Any]) -> str:
        """A table of how many lines of each kind every split has."""
        present = self.present()
        kinds = sorted({key[1:] for key in self.tally}, key=order)
        rows = [[*kind, *(self.tally[split, *kind] for split in present)] for kind in kinds]
        return Table([*head, *present], rows).markdown()


def write_lines(
    source: Source,
    out: Path,
    add: Callable[[Lines, Saved], None],
    card: Callable[[Lines], str],
    *,
    made: str,
    progress: Told,
) -> dict[str, int]:
    """Write train.jsonl, test.jsonl, their pictures and a card; return how many lines each has.
    `add` writes a trial's, which are `made` from its truth; `progress` is told how many of how many
    trials are done.

    Raises:
        InputError: `out` holds something, a trial's record is broken, or no truth is known.
    """
    with filling(out) as folder:
        with ExitStack() as stack:
            lines = Lines(folder, stack)
            for n, saved in enumerate(source.saved, start=1):
                add(lines, saved)
                progress(n, len(source.saved))
        if not lines.tally:
            raise InputError(
                f"'{source.folder}' has no trial with a known truth, from which {made} are made"
            )
        (folder / CARD).write_text(card(lines), encoding="utf-8")
    return lines.totals()


# --- the card ------------------------------------------------------------------------------------


def in_paragraphs(*parts: str) -> str:
    """The text of a card from its paragraphs, headings and tables."""
    return "\n\n".join(parts) + "\n"


def origin(source: Source) -> str:
    """The data's origin, as a list in Markdown."""
    run, configuration = source.run, source.run.get("configuration", {})
    commit = run.get("commit") or "not recorded (an installed pliant)"
    changed = ", with changes that were not committed" if run.get("dirty") else ""
    versions = ", ".join(f"{name} {v}" for name, v in run.get("versions", {}).items())
    return "\n".join(
        [
            f"- Run: {code(source.folder.resolve().name)}, begun"
            f" {markdown(str(run.get('started')))},"
            f" fingerprint {code(str(configuration.get('fingerprint', 'none')))}",
            f"- Commit of pliant: {code(str(commit))}{changed}",
            f"- Versions: {markdown(versions)}",
            f"- Reasoners: {markdown(str(run.get('reasoner')))}",
            "- Licence: Apache-2.0, for the data as for the code",
            "- Everything is simulated (MuJoCo); the arm's and the gripper's meshes come from"
            " MuJoCo Menagerie.",
        ]
    )


def front_matter(category: str, tags: Sequence[str], data_files: str) -> str:
    """The head of a card, as hubs of data sets read it."""
    return "\n".join(
        [
            "---",
            f"license: {LICENCE}",
            "task_categories:",
            f"- {category}",
            "tags:",
            *(f"- {tag}" for tag in tags),
            "- peg-in-hole",
            "- failure-recovery",
            "configs:",
            "- config_name: default",
            f"  data_files:{data_files}",
            "---",
        ]
    )


def lines_matter(category: str, lines: Lines) -> str:
    """The head of a card of JSON lines."""
    files = "".join(f"\n  - {{split: {split}, path: {split}.jsonl}}" for split in lines.present())
    return front_matter(category, ["robotics"], files)


SPLIT_RULE = (
    f"A trial is in `test` if its seed can be divided by {HELD_OUT}, else in `train`: pegs,"
    " conditions and reasoners share their seeds, so no drawn setup is in both. Where a"
    " condition draws nothing, every seed gives the same trial; these go together, with the"
    " lowest of their seeds."
)
