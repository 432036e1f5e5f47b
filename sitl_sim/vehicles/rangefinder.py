"""A laser rangefinder that looks down along the body's z axis at the true ground.

Figures: Benewake TFmini-S data sheet (SJ-PM-TFmini-S): 0.1 to 12 m, ±6 cm up to 6 m and ±1 %
beyond, here as two standard deviations; 1 cm steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sitl_sim.worlds.ground import Ground

Floats = NDArray[np.float64]

RANGE_MIN, RANGE_MAX = 0.1, 12.0  # m
STEP = 0.01  # m


class Rangefinder:
    """The rangefinders of n vehicles; fitted: whether each has one."""

    def __init__(
        self, system_ids: Sequence[int], fitted: Sequence[bool], ground: Ground, seed: int
    ) -> None:
        self.fitted = list(fitted)
        self._ground = ground
        self._rngs = [np.random.default_rng([seed, 0x1A5E, s]) for s in system_ids]

    def measure(self, i: int, p: Floats, q: Floats) -> float:
        """Return what vehicle i measures at p (3,) m with attitude q (4,) [m]; inf: no echo."""
        w, x, y, z = (float(k) for k in q)
        down = -np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        true = float(self._ground.ranges(p[None], down[None])[0])
        noise = float(self._rngs[i].standard_normal())  # always drawn: one sequence for one seed
        if not 0.0 <= true <= RANGE_MAX:
            return math.inf
        return round((true + range_sigma(true) * noise) / STEP) * STEP


def range_sigma(distance: float) -> float:
    """Return the standard deviation [m] of a measured distance [m]."""
    return 0.03 if distance < 6.0 else 0.005 * distance
