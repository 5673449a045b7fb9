"""What mkdocs.yml needs beside plugins: files of the checkout as pages, and fields' comments.

A document may link to a file or a folder outside `docs/`, as a code host shows it. On the site the
link leads to a page with that file's text, so that everything is there without a network.
"""

import ast
import json
import posixpath
import re
from pathlib import Path
from typing import Any

from griffe import Attribute, Docstring, Extension
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
ALWAYS = ("examples", "CONTRIBUTING.md", "CHANGELOG.md")  # in the site's navigation
NOTEBOOK = ".ipynb"
LANGUAGES = {".py": "python", ".sh": "bash", ".yaml": "yaml", ".md": "markdown"}

_LINK = re.compile(r"(?<=\]\()(?![a-z]+:)[^)#\s]+(?=[)#])")  # of a relative link, its path
_origin: dict[str, Path] = {}  # of the pages made here: the file that each shows


class FieldComments(Extension):
    """The comment behind a field, which holds its shape and unit, documents the field."""

    def on_attribute(self, *, attr: Attribute, **_: object) -> None:
        if attr.docstring is None and attr.lineno is not None and isinstance(attr.filepath, Path):
            line = attr.lines_collection[attr.filepath][attr.lineno - 1]
            comment = line.partition("  # ")[2].partition("  # ")[0].strip()
            if comment and not comment.startswith(("noqa", "type:")):
                attr.docstring = Docstring(comment, parent=attr)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every file and folder outside docs/ that a document links to."""
    wanted = [ROOT / name for name in ALWAYS]
    for file in files.documentation_pages():
        page = DOCS / file.src_uri
        wanted += [
            t
            for t in _links(page, page.read_text(encoding="utf-8")).values()
            if not _is_document(t)
        ]
    for path in wanted:
        for shown in [path, *(_shown(path) if path.is_dir() else [])]:
            if _uri(shown) not in _origin:
                _origin[_uri(shown)] = shown
                files.append(File.generated(config, _uri(shown), content=_text(shown)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links that leave docs/ to the pages made of what they mean."""
    here = page.file.src_uri
    source = _origin.get(here, DOCS / here)
    targets = {link: _uri(path) for link, path in _links(source, markdown).items()}
    folder = posixpath.dirname(here)
    return _LINK.sub(
        lambda m: posixpath.relpath(targets[m[0]], folder) if m[0] in targets else m[0], markdown
    )


def _links(source: Path, markdown: str) -> dict[str, Path]:
    """Relative links of a file that lead to something in the checkout. Others stay as they are, and
    mkdocs refuses them."""
    found = {link: (source.parent / link).resolve() for link in _LINK.findall(markdown)}
    return {k: v for k, v in found.items() if v.exists() and v.is_relative_to(ROOT)}


def _is_document(path: Path) -> bool:
    return path.is_relative_to(DOCS)


def _uri(path: Path) -> str:
    """Where the site has a file or folder, as a source path of mkdocs."""
    if _is_document(path):
        return path.relative_to(DOCS).as_posix()
    name = f"source/{path.relative_to(ROOT).as_posix()}"
    return name if path.parent == ROOT and path.suffix == ".md" else f"{name}.md"


def _shown(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix in (*LANGUAGES, NOTEBOOK))


def _text(path: Path) -> str:
    if path.is_dir():
        rows = [f"- [{p.name}]({path.name}/{p.name}): {_summary(p)}" for p in _shown(path)]
        return f"# {path.name.capitalize()}\n\n" + "\n".join(rows) + "\n"
    text = path.read_text(encoding="utf-8")
    if path.parent == ROOT and path.suffix == ".md":
        return text
    if path.suffix == NOTEBOOK:
        return "\n\n".join(_cell(cell) for cell in json.loads(text)["cells"])
    name = path.relative_to(ROOT).as_posix()
    return f"# {path.name}\n\n`{name}`\n\n````{LANGUAGES.get(path.suffix, 'text')}\n{text}````\n"


def _cell(cell: dict[str, Any]) -> str:
    """A notebook's cell as Markdown, with what it shows."""
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return source
    parts = [f"```python\n{source}\n```"]
    for output in cell["outputs"]:
        data = output.get("data", {})
        plain = "".join(output.get("text") or data.get("text/plain", ""))
        parts.append("".join(data.get("text/html", "")) or f"```text\n{plain}\n```")
    return "\n\n".join(parts)


def _summary(path: Path) -> str:
    """The first line of a file's text, without its marks."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == NOTEBOOK:
        return "".join(json.loads(text)["cells"][0]["source"]).splitlines()[0].strip("# ")
    if path.suffix == ".py":
        text = ast.get_docstring(ast.parse(text)) or path.stem
    return text.splitlines()[0].strip("# ") or path.stem
