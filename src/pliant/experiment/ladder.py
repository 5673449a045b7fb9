"""The ladder's table: a row per level, skill set and reasoner, over all pegs and conditions."""

from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

from pliant.experiment import measures
from pliant.experiment.measures import Row
from pliant.levels import shipped_levels

PAPERS_LEVEL, PAPERS_SKILLS = "L0", "planar"


def rows(trials: Iterable[Row]) -> list[dict[str, Any]]:
    """Success, wrong verdicts, motions and simulated time of each level; empty for the paper's
    grid with the paper's skills, which Table II shows."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for trial in trials:
        key = (trial["level"], trial.get("skills") or PAPERS_SKILLS, trial["reasoner"])
        groups.setdefault(key, []).append(trial)
    if all(key[:2] == (PAPERS_LEVEL, PAPERS_SKILLS) for key in groups):
        return []
    order = list(shipped_levels())
    ranked = sorted(groups, key=lambda key: order.index(key[0]) if key[0] in order else len(order))
    return [_row(key, groups[key]) for key in ranked]


def _row(key: tuple[str, str, str], trials: Sequence[Row]) -> dict[str, Any]:
    level, skills, reasoner = key
    pegs = list(dict.fromkeys(t["peg"] for t in trials))
    return {
        "level": level,
        "skills": skills,
        "reasoner": reasoner,
        "n": len(trials),
        "inserted": measures.rate(measures.inserted(t) for t in trials),
        "wrong": measures.rate(measures.inserted(t) != t["judged"] for t in trials),
        "false_accepts": measures.rate(t["judged"] and not measures.inserted(t) for t in trials),
        "moves": median(t["moves"] for t in trials),
        "executions": sum(t["executions"] for t in trials) / len(trials),
        "simulated_s": median(t["simulated_s"] for t in trials),
        "pegs": {
            peg: measures.rate(measures.inserted(t) for t in trials if t["peg"] == peg)
            for peg in pegs
        },
        "failure_kinds": measures.kinds(trials),
    }
