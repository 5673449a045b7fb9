"""Measures that the tables are made of: counts over the rows of trials.parquet and
executions.parquet.

Every function is pure and takes rows as dicts, so that a table is a function of the stored records
alone. A trial in which nothing was measured (`faults` says which) is left out of everything but the
count of faults; one that the cell ended counts as not inserted; one whose truth nobody has labelled
is left out where the truth is needed.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from pliant.cell import Stop
from pliant.checks import TILT_TOLERANCE_DEG
from pliant.conditions import NOMINAL
from pliant.experiment import faults
from pliant.experiment.statistics import Pairs, mcnemar, paired_difference, wilson
from pliant.formations import RECOVERABLE, Formation

Row = Mapping[str, Any]
DEPTHS_M = (0.010, 0.020, 0.024)
ANGLE_EDGES_DEG = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 90.0)
_NO_CORRECTION_M = 0.0001  # goals of Align closer than this are the same goal


def names(trial: Row) -> tuple[str, str, str, str]:
    """The names of the cell of a table that a trial is of."""
    return trial["level"], trial["peg"], trial["condition"], trial["reasoner"]


def inserted(trial: Row) -> bool | None:
    """The paper's G, whether the peg is inserted; None where it is not known, or nothing was
    measured."""
    if faults.is_fault(trial):
        return None
    if trial["inserted"] is None and str(trial["end_reason"]).startswith(faults.PREFIX):
        return False
    return trial["inserted"]


def measured(trials: Iterable[Row]) -> list[Row]:
    """The trials in which the method was measured: those that n counts."""
    return [t for t in trials if not faults.is_fault(t)]


def rate(outcomes: Iterable[bool | None]) -> dict[str, Any]:
    """Successes, n, percent, and the 95 % Wilson interval [%], of those that are known."""
    known = [o for o in outcomes if o is not None]
    if not known:
        return {"successes": 0, "n": 0, "percent": None, "low": None, "high": None}
    interval = wilson(sum(known), len(known))
    return {
        "successes": sum(known),
        "n": len(known),
        "percent": 100 * sum(known) / len(known),
        "low": 100 * interval.low,
        "high": 100 * interval.high,
    }


def extra_executions(trials: Sequence[Row]) -> dict[str, float | None]:
    """Average executions beyond the first, per formation; None where there is no trial."""
    if not trials:
        return {str(f): None for f in RECOVERABLE}
    return {str(f): sum(t[f"extra_{f}"] for t in trials) / len(trials) for f in RECOVERABLE}


def transitions(executions: Iterable[Row]) -> dict[str, dict[str, int]]:
    """Counts of the formations with which plans began, by the failed formation after which they
    were made."""
    counts: dict[str, Counter[str]] = {}
    for e in executions:
        if not e["verdict"] and e["proposed"]:
            counts.setdefault(e["formation"], Counter())[e["proposed"][0]["formation"]] += 1
    return {str(f): {str(t): counts[f][t] for t in RECOVERABLE} for f in Formation if f in counts}


def compare(first: Mapping[Any, bool], second: Mapping[Any, bool]) -> dict[str, Any] | None:
    """Compare two methods on the trials that both have: keys say which trial, values whether
    inserted."""
    keys = first.keys() & second.keys()
    if not keys:
        return None
    counts = Counter((first[k], second[k]) for k in keys)
    pairs = Pairs(
        both=counts[True, True],
        only_first=counts[True, False],
        only_second=counts[False, True],
        neither=counts[False, False],
    )
    interval = paired_difference(pairs)
    return {
        "n": pairs.n,
        "only_first": pairs.only_first,
        "only_second": pairs.only_second,
        "difference": 100 * pairs.difference,
        "low": 100 * interval.low,
        "high": 100 * interval.high,
        "p": mcnemar(pairs),
    }


def depths(trials: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Rates of the trials that ended at least so deep, whatever else; the depth in millimetres as
    key."""
    known = [t["depth_m"] for t in trials if t["depth_m"] is not None]
    return {f"{1e3 * d:g}": rate(depth >= d for depth in known) for d in DEPTHS_M}


def by_grasp_angle(trials: Sequence[Row]) -> dict[str, dict[str, Any]]:
    """Success in bins of the grasp angle's size [deg], where it was drawn; lower edge included."""
    if not any(t["drawn_grasp_roll"] for t in trials):
        return {}
    bins = {}
    for low, high in pairwise(ANGLE_EDGES_DEG):
        held = [t for t in trials if low <= math.degrees(abs(t["drawn_grasp_roll"])) < high]
        if held:
            bins[f"{low:g}–{high:g}"] = rate(inserted(t) for t in held)
    return bins


def overshoot_cycles(executions: Sequence[Row]) -> int:
    """Count how often, in one trial, one correction of Align's goal undid the direction of the
    last."""
    goals = [e["goal_y_m"] for e in executions if e["formation"] == Formation.ALIGN]
    moved = [b - a for a, b in pairwise(goals) if abs(b - a) > _NO_CORRECTION_M]
    return sum(a * b < 0 for a, b in pairwise(moved))


def false_alignments(executions: Sequence[Row]) -> dict[str, int]:
    """Counts in one trial: Align accepted; of these, false by the truth (the peg leans more than
    Table I allows, or is not in the hole); of these, the next Insertion ended by the compression
    limit."""
    accepted = false = stopped = 0
    for this, following in pairwise([*executions, None]):
        if this is None or this["formation"] != Formation.ALIGN or not this["verdict"]:
            continue
        accepted += 1
        if this["truth_tilt_rad"] is None:
            continue
        leans = abs(math.degrees(this["truth_tilt_rad"])) > TILT_TOLERANCE_DEG
        if leans or this["truth_fit"] is False:
            false += 1
            stopped += (
                following is not None
                and following["formation"] == Formation.INSERTION
                and following["stop"] == Stop.COMPRESSION
            )
    return {"accepted": accepted, "false": false, "stopped": stopped}


def placed(trials: Sequence[Row]) -> tuple[float, float] | None:
    """The hole's place [mm] and the peg's angle in the grasp [deg], if they were the same in all
    trials and the friction was nobody's to change; None: something was drawn."""
    (friction, y, roll), *others = {
        (t["drawn_friction"], t["drawn_hole_y"], t["drawn_grasp_roll"]) for t in trials
    }
    if others or friction != NOMINAL["friction"]:
        return None
    return round(y * 1e3, 3), round(math.degrees(roll), 3)


def model_share(trials: Sequence[Row]) -> dict[str, Any] | None:
    """A model's own part in trials: its share of the decisions [%], and the success of the model
    alone, which stops where the rules would step in. None: no model was asked."""
    decisions, made = (sum(t[name] for t in trials) for name in ("decisions", "own"))
    if not decisions:
        return None
    others = {name: sum(t[name] for t in trials) for name in ("clamped", "fallbacks")}
    costs = [t["cost_usd"] for t in trials if t["cost_usd"] is not None]
    alone = (False if t["clamped"] or t["fallbacks"] else inserted(t) for t in trials)
    return {
        "decisions": decisions,
        "own_percent": 100 * made / decisions,
        **others,
        "alone": rate(alone),
        "tokens": sum(t["tokens"] for t in trials) / len(trials),
        "cost_usd": sum(costs) / len(trials) if costs else None,
    }


def is_undecided(share: Mapping[str, Any] | None) -> bool:
    """Whether a model that was asked decided nothing: none of its answers was used, not even cut
    down. The trials are then not its own."""
    return share is not None and not share["own_percent"] and not share["clamped"]


def is_partly(share: Mapping[str, Any] | None) -> bool:
    """Whether a model decided some of what it was asked, but not all."""
    return share is not None and share["own_percent"] < 100 and not is_undecided(share)


def name(reasoner: str, share: Mapping[str, Any] | None) -> str:
    """A name for a reasoner's trials, by its share of the decisions: where its model decided
    nothing, by who did."""
    if share is None or not is_undecided(share):
        return reasoner
    return f"{'rules' if share['fallbacks'] else 'nobody'} (for {reasoner})"


def kinds(trials: Iterable[Row]) -> dict[str, int]:
    """Counts of each kind of failure."""
    return dict(Counter(t["failure_kind"] for t in trials if t["failure_kind"] is not None))
