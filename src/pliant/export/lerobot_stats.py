"""Statistics as LeRobot keeps them: per feature and episode, and merged over the data set."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Stats = dict[str, NDArray[np.float64]]
"""Statistics of a feature: min, max, mean, std, q01 … q99, each of the feature's shape, and count
(1,)."""

_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def of_values(values: NDArray[np.generic]) -> Stats:
    """Statistics of one feature along an episode: (n,) or (n, k)."""
    table = np.asarray(values, np.float64).reshape(len(values), -1)
    found = {
        "min": table.min(axis=0),
        "max": table.max(axis=0),
        "mean": table.mean(axis=0),
        "std": table.std(axis=0),
        "count": np.array([len(table)]),
    }
    return found | {name: np.quantile(table, q, axis=0) for name, q in _QUANTILES.items()}


def of_pictures(pictures: Sequence[NDArray[np.uint8]]) -> Stats:
    """Statistics of a camera's pictures, per channel: (3, 1, 1), from 0 to 1. `count` counts
    pictures."""
    found = of_values(np.concatenate([p.reshape(-1, 3) for p in pictures]) / 255.0)
    shaped = {name: value.reshape(3, 1, 1) for name, value in found.items() if name != "count"}
    return shaped | {"count": np.array([len(pictures)])}


def merged(parts: Sequence[Stats]) -> Stats:
    """Statistics of several episodes together. Quantiles are averaged with the counts as weights,
    as LeRobot does: they are not exactly the whole's."""
    counts = np.array([part["count"][0] for part in parts], np.float64)
    stacked = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    weights = (counts / counts.sum()).reshape(-1, *[1] * (stacked["mean"].ndim - 1))
    mean = (stacked["mean"] * weights).sum(axis=0)
    spread = stacked["std"] ** 2 + (stacked["mean"] - mean) ** 2
    whole = {
        "min": stacked["min"].min(axis=0),
        "max": stacked["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt((spread * weights).sum(axis=0)),
        "count": np.array([int(counts.sum())]),
    }
    return whole | {name: (stacked[name] * weights).sum(axis=0) for name in _QUANTILES}
