"""Scores of a reasoner from its marks, with intervals."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pliant.experiment.bench.marks import Mark, Plan
from pliant.experiment.measures import rate
from pliant.experiment.statistics import CONFIDENCE, wilson
from pliant.records import Exchange
from pliant.text import rounded

Scores = dict[str, Any]
GROUPS: dict[str, Callable[[Mark], str]] = {
    "kind": lambda mark: str(mark.kind),
    "formation": lambda mark: str(mark.formation),
    "peg": lambda mark: mark.peg,
}
_RESAMPLES, _SEED = 2000, 1


def scores(marks: Sequence[Mark]) -> Scores:
    """The scores of all cases and of each group, with the names of the cases that were answered
    wrongly."""
    return {
        "all": group(marks),
        **{f"by_{name}": _grouped(marks, of) for name, of in GROUPS.items()},
        "falsely_accepted": [m.name for m in marks if m.judged and not m.success],
        "falsely_rejected": [m.name for m in marks if m.success and not m.judged],
        "refused": {m.name: m.plan.refusal for m in marks if m.plan and m.plan.refusal},
    }


def group(marks: Sequence[Mark]) -> Scores:
    """The scores of a group of cases. Percentages are of those asked, each with its count and 95 %
    Wilson interval; a score that no case of the group allows is None, or has n 0."""
    plans = [m.plan for m in marks if m.plan is not None]
    return {
        "n": len(marks),
        "balanced_accuracy": _balanced_accuracy(marks),
        "false_accepts": rate(m.judged for m in marks if not m.success),
        "false_rejects": rate(not m.judged for m in marks if m.success),
        "plan_valid": rate(not p.refusal for p in plans),
        "start_right": rate(p.start for p in plans),
        "retreat_right": rate(p.retreat for p in plans),
        "direction_right": rate(p.direction for p in plans),
        "reaches": rate(p.reaches for p in plans),
        "toward_mm": _toward(plans),
        "stops": rate(m.stopped for m in marks if m.stop),
        "stops_needlessly": rate(m.stopped for m in marks if m.stopped is not None and not m.stop),
        "own": rate(own for m in marks for own in m.own),
        "clamped": sum(m.clamped for m in marks),
        "fallbacks": sum(m.fallbacks for m in marks),
        **_spent([exchanges for m in marks for exchanges in m.decisions]),
    }


def _grouped(marks: Sequence[Mark], of: Callable[[Mark], str]) -> dict[str, Scores]:
    return {
        name: group([m for m in marks if of(m) == name]) for name in dict.fromkeys(map(of, marks))
    }


def _balanced_accuracy(marks: Sequence[Mark]) -> Scores | None:
    """Balanced accuracy: the mean of the shares of failures and of successes that were judged so;
    its interval squares and adds those of both (Newcombe 1998). None where all cases are of one
    sort."""
    sorts = [[m.judged == m.success for m in marks if m.success is s] for s in (True, False)]
    if not all(sorts):
        return None
    shares = [sum(right) / len(right) for right in sorts]
    intervals = [wilson(sum(right), len(right)) for right in sorts]
    middle = sum(shares) / 2
    below = math.hypot(*(p - i.low for p, i in zip(shares, intervals, strict=True))) / 2
    above = math.hypot(*(i.high - p for p, i in zip(shares, intervals, strict=True))) / 2
    return {
        "percent": 100 * middle,
        "low": 100 * max(0.0, middle - below),
        "high": 100 * min(1.0, middle + above),
    }


def _toward(plans: Sequence[Plan]) -> Scores | None:
    """Median and mean [mm] of how much nearer plans bring the goal to one that reaches, each with
    its bootstrap interval."""
    if not plans:
        return None
    values = 1e3 * np.array([p.toward_m for p in plans])
    picks = np.random.default_rng(_SEED).integers(len(values), size=(_RESAMPLES, len(values)))
    return {
        "median": _with_interval(np.median(values), np.median(values[picks], axis=1)),
        "mean": _with_interval(np.mean(values), np.mean(values[picks], axis=1)),
    }


def _with_interval(value: np.floating[Any], resampled: NDArray[np.float64]) -> Scores:
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    shown = {"value": value, "low": low, "high": high}
    return {name: rounded(float(v), 3) for name, v in shown.items()}


def _spent(decisions: Sequence[Sequence[Exchange]]) -> Scores:
    """The cost of the model's decisions. Latency is of a decision, with all its requests; the cost
    in USD is None where nobody knows the price of one."""
    exchanges = [e for decision in decisions for e in decision]
    waits = [sum(e.latency_s for e in decision) for decision in decisions]
    half, most = np.quantile(waits, [0.5, 0.95]).tolist() if waits else (None, None)
    prices = [e.cost_usd for e in exchanges]
    known = [price for price in prices if price is not None]
    return {
        "requests": len(exchanges),
        "input_tokens": sum(e.input_tokens for e in exchanges),
        "cached_tokens": sum(e.cached_tokens for e in exchanges),
        "output_tokens": sum(e.output_tokens for e in exchanges),
        "cost_usd": sum(known) if known and len(known) == len(prices) else None,
        "latency_s": {"p50": half, "p95": most} if waits else None,
    }
