"""The inverse distance of fixed points, corrected look by look while the drone moves.

Civera et al., "Inverse depth parametrization for monocular SLAM", 2008.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector, lengths

NEAREST, FARTHEST = 0.3, 200.0  # m
_GATE = 4.0  # standard deviations beyond which a point is not the one that was followed


def refined(
    moved: Vector, first: Vector, now: Vector, inverse: Vector, variance: Vector, sigma: float
) -> tuple[Vector, Vector, NDArray[np.bool_]]:
    """Return inverse distances (n,) [1/m] and variances (n,) after one more look, and which fit.

    moved (n,3): m, from here back to the place of the first look. first, now (n,3): unit rays of
    the first look and of this one. inverse (n,), variance (n,): before it. sigma: rad, of a ray.
    """
    sight = first + inverse[:, None] * moved
    length = lengths(sight)[:, None]
    sight = sight / length
    slope = (moved - np.vecdot(moved, sight)[:, None] * sight) / length
    steep = lengths(slope)
    line = slope / np.maximum(steep, 1e-9)[:, None]
    error = now - sight
    along = np.vecdot(error, line)
    rest = error - along[:, None] * line
    across = lengths(rest - np.vecdot(rest, sight)[:, None] * sight)
    spread = variance * steep**2 + sigma**2
    fits = (across < _GATE * sigma) & (np.abs(along) < _GATE * np.sqrt(spread))
    gain = variance * steep / spread
    low, high = 1.0 / FARTHEST, 1.0 / NEAREST
    return (
        np.minimum(np.maximum(inverse + gain * along, low), high),
        np.maximum((1.0 - gain * steep) * variance, 1e-8),
        fits,
    )
