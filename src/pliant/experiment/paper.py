"""The paper's own figures (paper.json), to stand beside ours. Its reasoner is GPT-4o."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

REASONER = "GPT-4o"
BASELINE = "none"
"""The reasoner that is the paper's baseline without recovery; all others stand beside GPT-4o."""


@dataclass(frozen=True, kw_only=True)
class PaperCell:
    """A row of Table II or IV: success [%] judged (F) and inserted (G), mean extra executions."""

    trials: int
    judged_percent: float
    inserted_percent: float
    extra: Mapping[str, float]  # by formation; empty for the baseline


def source() -> str:
    return str(_document()["source"])


def table2(peg: str, condition: str, reasoner: str) -> PaperCell | None:
    """The paper's row for a cell: the baseline's for `none`, else the one with recovery."""
    for row in _document()["table2_simulation"]:
        if (row["peg"], row["condition"], row["recovery"]) == (
            peg,
            condition,
            reasoner != BASELINE,
        ):
            return _cell(row)
    return None


def table4(hole_mm: float, angle_deg: float) -> PaperCell | None:
    """The paper's row of its real robot for a hole's offset and a grasp angle, whose directions it
    does not give."""
    for row in _document()["table4_real_robot"]:
        if (row["hole_mm"], row["angle_deg"]) == (abs(hole_mm), abs(angle_deg)):
            return _cell(row)
    return None


def table3(peg: str) -> Mapping[str, Mapping[str, float]] | None:
    """The paper's Table III for a peg: percent from a failed formation to the first of its plan;
    the paper gives the circle's."""
    return _document()["table3_transitions_circle_percent"] if peg == "circle" else None


def _cell(row: Mapping[str, Any]) -> PaperCell:
    return PaperCell(
        trials=row["trials"],
        judged_percent=row["judged_percent"],
        inserted_percent=row["inserted_percent"],
        extra={k.removeprefix("extra_"): row[k] for k in row if k.startswith("extra_")},
    )


@lru_cache(maxsize=1)
def _document() -> dict[str, Any]:
    return json.loads((files("pliant") / "experiment" / "paper.json").read_text(encoding="utf-8"))
