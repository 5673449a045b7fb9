"""A table of what is shown: the names of its columns, and its rows; as Markdown here, as HTML in
`pliant.html`."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Table:
    """A table: a name for each column, and rows of as many cells. A cell is text or markup as its
    renderer takes it; anything else is shown as text."""

    head: Sequence[str]
    rows: Sequence[Sequence[object]]

    @classmethod
    def of(cls, shown: Iterable[T], columns: Mapping[str, Callable[[T], object]]) -> Self:
        """A row for each of what is shown: its cells by the names of their columns."""
        return cls([*columns], [[cell(row) for cell in columns.values()] for row in shown])

    def markdown(self) -> str:
        """The table as Markdown. Its texts are taken as Markdown (`pliant.text.markdown`)."""
        lines = [self.head, ["---"] * len(self.head), *self.rows]
        return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
