"""Robust nonlinear least squares after Levenberg and Marquardt, for a dozen unknowns.

OpenCV keeps its own solver to itself (its Python interface lacks `LMSolver`), and its calibration
functions know pictures of points only, not outlines.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Residuals = Callable[[Vector], Vector]

_STEPS = 60
_ENOUGH = 1e-5  # relative improvement that is none
_MOST_DAMPED = 1e9


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """An unknown: where it starts, what is believed beforehand, the step to derive with."""

    start: float
    prior: float | None = None
    prior_sd: float = 1.0
    step: float = 1e-6


def minimise(
    residuals: Residuals,
    unknowns: list[Unknown],
    *,
    sds: Vector,
    robust: tuple[float, ...],
) -> Vector:
    """The unknowns (n,) that make `residuals` (m,), of standard deviations `sds` (m,), small.

    `robust` are scales, in the residuals' own unit, beyond which a residual counts for little
    (Geman-McClure); they are gone through in order, so that a far start does not lock good points
    out. Priors count as measurements.
    """
    at = np.array([u.start for u in unknowns])
    for scale in robust:
        at = _levenberg_marquardt(residuals, at, unknowns, sds, scale)
    return at


def _levenberg_marquardt(
    residuals: Residuals, at: Vector, unknowns: list[Unknown], sds: Vector, scale: float
) -> Vector:
    known = [i for i, u in enumerate(unknowns) if u.prior is not None]
    priors = np.array([unknowns[i].prior for i in known], dtype=float)
    prior_sds = np.array([unknowns[i].prior_sd for i in known])
    steps = np.array([u.step for u in unknowns])

    def whole(x: Vector, weights: Vector) -> Vector:
        return np.concatenate(
            [np.sqrt(weights) * residuals(x) / sds, (x[known] - priors) / prior_sds]
        )

    damping = 1e-3
    for _ in range(_STEPS):
        weights = _weights(residuals(at), scale)
        here = whole(at, weights)
        jacobian = np.empty((len(here), len(at)))
        for i, step in enumerate(steps):
            moved = at.copy()
            moved[i] += step
            jacobian[:, i] = (whole(moved, weights) - here) / step
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ here
        cost = float(here @ here)
        while damping < _MOST_DAMPED:
            change = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -gradient)
            after = whole(at + change, weights)
            better = cost - float(after @ after)
            if better > 0:
                break
            damping *= 10
        else:
            return at
        at = at + change
        damping = max(damping / 10, 1e-9)
        if better < _ENOUGH * cost:
            return at
    return at


def _weights(values: Vector, scale: float) -> Vector:
    """The weight with which each residual counts, 0 to 1."""
    return 1.0 / (1.0 + (values / scale) ** 2) ** 2
