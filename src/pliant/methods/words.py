"""A method's words for a model, as files."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files


@cache
def words_of(package: str) -> Mapping[str, str]:
    """The prompts in a package's folder `prompts`, by their names."""
    folder = files(package) / "prompts"
    return {
        file.name.removesuffix(".md"): file.read_text(encoding="utf-8")
        for file in folder.iterdir()
        if file.name.endswith(".md")
    }
