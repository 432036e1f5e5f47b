"""Robust nonlinear least squares with a covariance that correlated errors do not fool.

Gauss-Newton with numerical derivatives and reweighting after Geman and McClure. The covariance is
the sandwich of White, over blocks of time: errors within a block may be alike (HAC; Newey and West,
1987, in its plainest form).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector

_MOST = 12  # steps
_SETTLED = 0.02  # of the prior's step sizes, below which nothing changes any more


class Problem(Protocol):
    """What can be solved: n things, each missed in k ways, and the block of time of each."""

    @property
    def blocks(self) -> NDArray[np.int64]:
        """(n,) number of each thing's block."""

    def residuals(self, values: Vector) -> tuple[Vector, Vector]:
        """Return the misses (k,n) and their variances (k,n)."""


@dataclass(frozen=True)
class Fit:
    """Parameters (p,) and their covariance (p,p)."""

    values: Vector
    covariance: Vector


def solve(
    problem: Problem,
    values: Vector,
    prior: Vector,
    prior_sigma: Vector,
    steps: Vector,
    most: int = _MOST,
) -> Fit:
    """Return the parameters of least misses, from `values` (p,) on.

    prior: (p,) with 1 σ `prior_sigma`. steps: (p,) of the derivatives.
    """
    known = np.diag(prior_sigma**-2.0)
    for _ in range(most):
        gradient, information, _ = _normal(problem, values, steps)
        gradient = gradient + known @ (prior - values)
        change = np.linalg.solve(information + known, gradient)
        values = values + np.clip(change, -prior_sigma / 2.0, prior_sigma / 2.0)
        if (np.abs(change) < _SETTLED * steps).all():
            break
    _, information, scores = _normal(problem, values, steps)
    inverse = np.linalg.inv(information + known)
    blocks = len(scores)
    meat = scores.T @ scores * (blocks / max(blocks - len(values), 1)) + known
    return Fit(values, inverse @ meat @ inverse)


def _normal(problem: Problem, values: Vector, steps: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the gradient (p,), the information (p,p), and each block's gradient (m,p)."""
    misses, variance = problem.residuals(values)
    misfit = (misses**2 / variance).mean(axis=0)
    spread = max(float(np.median(misfit)) / np.log(2.0), 1e-9)
    # Variances are assumed; what is missed tells by what factor they are wrong.
    trust = (1.0 + misfit / (4.0 * spread)) ** -2 / spread
    rows, weights = misses.ravel(), (trust / variance).ravel()
    slopes = np.empty((len(rows), len(values)))
    for k, step in enumerate(steps):
        there = values.copy()
        there[k] += step
        slopes[:, k] = (problem.residuals(there)[0].ravel() - rows) / step
    scores = -slopes * (weights * rows)[:, None]
    _, block = np.unique(np.tile(problem.blocks, len(misses)), return_inverse=True)
    summed = np.zeros((int(block.max()) + 1, len(values)))
    np.add.at(summed, block, scores)
    return summed.sum(axis=0), (slopes * weights[:, None]).T @ slopes, summed
