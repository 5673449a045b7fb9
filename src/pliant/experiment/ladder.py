"""The ladder's tables: a row per level or scenario, skill set and reasoner, over all pegs and
conditions."""

from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

from pliant.experiment import measures
from pliant.experiment.measures import Row
from pliant.levels import INSERT, STOP, Level, shipped_levels
from pliant.records import End

STOPPED_BY = ("fault:no_touch", "fault:sensor", "fault:loaded", "fault:held")
VARIES = "varies"
"""What is right on a level that has scenarios: it depends on the trial."""
PAPERS_LEVEL = "L0"
_Key = tuple[str, str, str]  # level, method, reasoner


def rows(trials: Iterable[Row]) -> list[dict[str, Any]]:
    """A row per level, skill set and reasoner: success, wrong verdicts, motions and simulated time;
    empty for the paper's grid with the paper's method, which Table II shows."""
    groups = [(k, g) for k, g in _groups(trials) if not _is_scenario(k[0])]
    papers = (PAPERS_LEVEL, shipped_levels()[PAPERS_LEVEL].method)
    if all(key[:2] == papers for key, _ in groups):
        return []
    return [_row(key, group) for key, group in groups]


def scenarios(trials: Iterable[Row]) -> list[dict[str, Any]]:
    """A row per scenario, or level that has some, skill set and reasoner: how the trials ended, and
    how many of them as is right there."""
    return [_scenario(key, group) for key, group in _groups(trials) if _is_scenario(key[0])]


def _groups(trials: Iterable[Row]) -> list[tuple[_Key, list[Row]]]:
    groups: dict[_Key, list[Row]] = {}
    for trial in trials:
        key = (trial["level"], trial["method"], trial["reasoner"])
        groups.setdefault(key, []).append(trial)
    order = list(shipped_levels())
    ranked = sorted(groups, key=lambda key: order.index(key[0]) if key[0] in order else len(order))
    return [(key, groups[key]) for key in ranked]


def _is_scenario(level: str) -> bool:
    known = shipped_levels().get(level)
    return known is not None and known.may_be_wrong


def _row(key: _Key, every: Sequence[Row]) -> dict[str, Any]:
    pegs = list(dict.fromkeys(t["peg"] for t in every))
    trials = measures.measured(every)
    return {
        "level": key[0],
        **_by(key, every, trials),
        "inserted": measures.rate(measures.inserted(t) for t in trials),
        "wrong": measures.rate(measures.inserted(t) != t["judged"] for t in trials),
        "false_accepts": measures.rate(t["judged"] and not measures.inserted(t) for t in trials),
        **_effort(trials),
        "pegs": {
            peg: measures.rate(measures.inserted(t) for t in trials if t["peg"] == peg)
            for peg in pegs
        },
        "failure_kinds": measures.kinds(every),
    }


def _by(key: _Key, every: Sequence[Row], trials: Sequence[Row]) -> dict[str, Any]:
    """By whom the trials of a row were done, and how many of all were measured."""
    return {
        "method": key[1],
        "reasoner": key[2],
        "n": len(trials),
        "faults": len(every) - len(trials),
        "own": measures.model_share(trials),
    }


def _effort(trials: Sequence[Row]) -> dict[str, float | None]:
    """Median motions and simulated time [s], mean executions; None where there is no trial."""
    if not trials:
        return {"moves": None, "executions": None, "simulated_s": None}
    return {
        "moves": median(t["moves"] for t in trials),
        "executions": sum(t["executions"] for t in trials) / len(trials),
        "simulated_s": median(t["simulated_s"] for t in trials),
    }


def _scenario(key: _Key, every: Sequence[Row]) -> dict[str, Any]:
    trials = measures.measured(every)
    level = shipped_levels()[key[0]]
    ends = [str(t["end_reason"]) for t in trials]
    return {
        "scenario": key[0],
        **_by(key, every, trials),
        "right": level.right if level.is_scenario else VARIES,
        "rightly": measures.rate(_is_right(t, _of_trial(t, level)) for t in trials),
        "diagnosed": measures.rate(t.get("diagnosis") in _of_trial(t, level).truly for t in trials),
        "inserted": measures.rate(measures.inserted(t) for t in trials),
        "stopped": measures.rate(_has_stopped(end) for end in ends),
        "exhausted": measures.rate(end in (End.EXHAUSTED, End.REFUSED) for end in ends),
        "cap": measures.rate(end == End.CAP for end in ends),
        "false_accepts": measures.rate(t["judged"] and not measures.inserted(t) for t in trials),
        **{k: v for k, v in _effort(trials).items() if k != "moves"},
    }


def _of_trial(trial: Row, level: Level) -> Level:
    """The level, or the scenario in that trial of it, that says what is right."""
    return level.in_trial(trial["seed"]) if level.scenarios else level


def _has_stopped(end_reason: str) -> bool:
    """Whether a trial was stopped by the reasoner, or by what watches the wrist: each says what is
    wrong."""
    return end_reason == End.STOPPED or end_reason in STOPPED_BY


def _is_right(trial: Row, level: Level) -> bool:
    stopped = _has_stopped(str(trial["end_reason"]))
    inserted = bool(measures.inserted(trial)) and bool(trial["judged"])
    return (stopped and level.right != INSERT) or (inserted and level.right != STOP)
