"""The documents' blocks of code: commands, snippets, files, and what is shown as printed."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])

FENCE = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"(?:(?<=\n\n)|\A)(?:(?: {4}.*)?\n)*? {4}\S.*\n(?:(?: {4}.*)?\n)*")
_TITLE = re.compile(r'title="([^"]+)"')
_COMMENT = re.compile(r"\s+# .*$")


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@dataclass(frozen=True, kw_only=True)
class Block:
    """A command, or a whole snippet, by the name under which its outcome stands in `shown.py`: the
    command itself, a file's title, or a snippet's language and its number on the page."""

    name: str
    language: str  # "": a command
    code: str
    is_file: bool = False


def blocks(path: Path) -> Iterator[Block]:
    """All of a document's, in order. A block without a language, fenced or indented, is commands:
    one a line, without its comment."""
    text = path.read_text(encoding="utf-8")
    found = [(m.start(), m[1], m[2]) for m in FENCE.finditer(text)]
    hidden = FENCE.sub(lambda m: re.sub(r"[^\n]", "-", m[0]), text)
    found += [(m.start(), "", m[0]) for m in _INDENTED.finditer(hidden)]
    seen: Counter[str] = Counter()
    for _, info, code in sorted(found):
        language, title = info.split(" ")[0], _TITLE.search(info)
        if title is not None:
            yield Block(name=title[1], language=language, code=code, is_file=True)
        elif language:
            seen[language] += 1
            yield Block(name=f"{language} {seen[language]}", language=language, code=code)
        else:
            for line in code.replace("\\\n", " ").splitlines():
                command = _COMMENT.sub("", line).strip()
                if command:
                    yield Block(name=command, language="", code=command)
