"""What stands in the cells of several tables: who decided, rates with their intervals, and the
paper's own figures."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

from pliant.experiment.measures import is_partly, is_undecided, name
from pliant.table import Table

Document = Mapping[str, Any]
Columns = dict[str, Callable[[Document], object]]
"""The columns of a table by their names: what each shows of a row."""
NONE = "–"
PARTLY = "†"


def marked(table: Table, rows: Iterable[Document], *told: str) -> str:
    """A table, what is told of it, and what the marks of its names mean."""
    return "\n\n".join([table.markdown(), *told, *marks(row.get("own") for row in rows)])


def marks(shares: Iterable[Document | None]) -> list[str]:
    """Explanations of the names of `shown_name`, a line each, where they are not the plain ones."""
    shares = list(shares)
    lines = []
    if any(map(is_partly, shares)):
        lines.append(
            f"{PARTLY} Not every decision was the model's own: own says how many [%], and G"
            " alone is its success where a trial with the rules' help counts as failed."
        )
    if any(map(is_undecided, shares)):
        lines.append(
            "rules (for …): the model that was asked decided nothing, so the row is the rules';"
            " nobody (for …): nor could they. It says nothing of the model."
        )
    return lines


def shown_name(row: Document) -> str:
    """The name of a row's reasoner: marked where only some of the decisions were the model's."""
    model = f" ({row['model']})" if row.get("model") else ""
    return marked_name(row["reasoner"] + model, row.get("own"))


def marked_name(reasoner: str, share: Document | None) -> str:
    """The name of a reasoner by its model's share of the decisions."""
    return name(reasoner, share) + (f" {PARTLY}" if is_partly(share) else "")


def peg(row: Document) -> str:
    """A row's peg, with its level where that is not the paper's."""
    return str(row["peg"] if row["level"] == "L0" else f"{row['peg']} {row['level']}")


WHO: Columns = {"peg": peg, "condition": itemgetter("condition"), "reasoner": shown_name}
"""The columns that say which cell a row is of."""


def who(row: Document) -> list[object]:
    """A row's cells under `WHO`."""
    return [of(row) for of in WHO.values()]


def own_percent(share: Document | None) -> str:
    """A model's own share of the decisions."""
    return NONE if share is None else f"{share['own_percent']:.1f}"


def own_columns(rows: Sequence[Document]) -> Columns:
    """Columns of a model's own share and of its success alone, where any row is a model's."""
    if not any(row.get("own") for row in rows):
        return {}
    return {
        "own [%]": lambda row: own_percent(row.get("own")),
        "G alone [%]": lambda row: rate((row.get("own") or {}).get("alone")),
    }


def fault_columns(rows: Sequence[Document]) -> Columns:
    """A column of faults, where any row has one."""
    has_any = any(row.get("faults") for row in rows)
    return {"faults": lambda row: row.get("faults", 0)} if has_any else {}


def outcome(row: Document, name: str) -> str:
    """A row's rate, unless nothing but faults came of it."""
    return "faults" if row.get("faults") and not row["n"] else rate(row[name])


def rate(found: Document | None) -> str:
    """A rate in percent with its interval and n."""
    return f"{interval(found)} of {found['n']}" if found and found["n"] else NONE


def interval(found: Document) -> str:
    """A share in percent with its interval: "45.0 [40.2, 49.9]"."""
    return f"{found['percent']:.1f} [{found['low']:.1f}, {found['high']:.1f}]"


def number(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def their_success(paper: Document | None, *, with_n: bool = False) -> str:
    """The paper's F and G, where it gives them."""
    if paper is None:
        return NONE
    n = f" (n {paper['n']})" if with_n else ""
    return f"{paper['judged']:g}, {paper['inserted']:g}{n}"


def their_extra(paper: Document | None) -> str:
    """The paper's mean extra executions, where it gives them."""
    return ", ".join(f"{v:.1f}" for v in paper["extra"].values()) or NONE if paper else NONE
