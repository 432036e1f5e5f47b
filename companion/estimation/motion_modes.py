"""Two modes in which a neighbour moves: it keeps on, or it manoeuvres (IMM).

Of a neighbour that kept its velocity while it was seen it is likely that it still does when it is
not; of one that swerved and braked it is not. So each track has two filters, one of each mode, and
the probability of each. At every step the modes pass over into each other at a rate, and what is
seen, or is not there, tells which one it is. Seen from outside, a track is the mixture of both:
where they lead apart, its covariance is as wide as they are apart.

Source: Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian
switching coefficients", IEEE Transactions on Automatic Control 33(8), 1988.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector

MANOEUVRES = 1  # index of this mode; 0: keeps on
_OTHER = np.array([[1.0], [-1.0]])  # towards the other mode, from each
_LEAST = 1e-3  # of a mode's probability: what is all but sure can still turn out wrong


@dataclass
class Modes:
    """n tracks in both modes; rows: first all that keep on, then the same ones that manoeuvre.

    weight: (2,n) probability. mean: (2n,k). covariance: (2n,k,k).
    """

    weight: Vector
    mean: Vector
    covariance: Vector

    @classmethod
    def none(cls, states: int) -> Modes:
        """Return no tracks, of so many states."""
        return cls(np.zeros((2, 0)), np.zeros((0, states)), np.zeros((0, states, states)))

    def copy(self) -> Modes:
        """Return a copy that shares nothing."""
        return Modes(self.weight.copy(), self.mean.copy(), self.covariance.copy())

    def kept(self, keep: NDArray[np.bool_]) -> Modes:
        """Return the tracks (n,) to keep."""
        rows = np.tile(keep, 2)
        return Modes(self.weight[:, keep], self.mean[rows], self.covariance[rows])

    def add(self, mean: Vector, covariance: Vector) -> None:
        """Add a track (k,), (k,k) of which nothing is known of how it moves."""
        n = self.weight.shape[1]
        self.weight = np.append(self.weight, [[0.5], [0.5]], axis=1)
        self.mean = np.insert(self.mean, [n, 2 * n], mean, axis=0)
        self.covariance = np.insert(self.covariance, [n, 2 * n], covariance, axis=0)

    def mix(self, change: Vector) -> None:
        """Pass over from mode to mode; change: (2,) probability that each mode is left."""
        leave = change[:, None] * self.weight
        weight = self.weight - leave + leave[::-1]
        share = leave[::-1] / weight  # of each mode, what comes from the other one
        n, k = weight.shape[1], self.mean.shape[1]
        mean, c = self.mean.reshape(2, n, k), self.covariance.reshape(2, n, k, k)
        apart, wider = mean[1] - mean[0], c[1] - c[0]
        spread = apart[:, :, None] * apart[:, None, :]
        towards, doubt = (_OTHER * share)[..., None], (share * (1.0 - share))[..., None, None]
        self.mean = (mean + towards * apart).reshape(2 * n, k)
        self.covariance = (c + (towards[..., None] * wider + doubt * spread)).reshape(2 * n, k, k)
        self.weight = weight

    def means(self) -> Vector:
        """Return the mean (n,k) of the mixture of both modes, as `mixture` does."""
        n = self.weight.shape[1]
        a, b = self.weight[..., None]
        mean: Vector = a * self.mean[:n] + b * self.mean[n:]
        return mean

    def mixture(self) -> tuple[Vector, Vector]:
        """Return mean (n,k) and covariance (n,k,k) of the mixture of both modes."""
        n = self.weight.shape[1]
        a, b = self.weight[..., None]
        on, other = self.mean[:n], self.mean[n:]
        apart = on - other
        spread = (a * b)[..., None] * apart[:, :, None] * apart[:, None, :]
        a3, b3, c = a[..., None], b[..., None], self.covariance
        return a * on + b * other, a3 * c[:n] + b3 * c[n:] + spread

    def weigh(self, n: NDArray[np.int_], log_likelihood: Vector) -> None:
        """Weigh the modes of tracks n (m,) by what was seen; log_likelihood: (2,m)."""
        likelihood = np.exp(log_likelihood - log_likelihood.max(axis=0))
        weight = np.maximum(self.weight[:, n] * likelihood, 1e-300)
        weight = np.maximum(weight / weight.sum(axis=0), _LEAST)
        self.weight[:, n] = weight / weight.sum(axis=0)
