"""How much higher or lower than the drone its neighbours fly: what that says of a find.

Drones of one mission mostly fly at about one height; dark spots on bark, leaves and ground are at
any. So a find at the own height is likelier a neighbour, one far above or below likelier not: by
Bayes' rule, with the probability that the network gives. How far apart their heights are is
learnt in flight, from the neighbours that are known.
"""

from __future__ import annotations

import math

import numpy as np

from mavlink_bridge.shared.arrays import Vector

# m of height over which finds that are no neighbours are spread: on recorded flights, nine of ten
# are within 2.2 m of the own.
_SPREAD = 4.0
_ANYWHERE = 0.05  # share of the neighbours that fly at any height: one seen clearly counts anywhere
_LEARNT = 0.02  # weight of a neighbour seen in one picture: five seconds of one of them


class Levels:
    """The heights of neighbours over the own.

    sigma: m, their std as it is known by now.
    """

    def __init__(self, sigma: float) -> None:
        """sigma: m, until they are seen to fly otherwise, and at least; 0: they say nothing."""
        self._least = self.sigma = sigma

    def follow(self, heights: Vector) -> None:
        """Learn from the heights (n,) m over the own of neighbours that are known and seen."""
        variance = self.sigma**2
        for height in heights.tolist():
            variance += _LEARNT * (height * height - variance)
        self.sigma = max(math.sqrt(variance), self._least)

    def evidence(self, heights: Vector, sigmas: Vector) -> Vector:
        """Return the log odds (n,) that finds gain by their heights (n,) m over the own.

        sigmas: (n,) m, of the heights.
        """
        if not self._least:
            return np.zeros(len(heights))
        variance = self.sigma**2 + sigmas**2
        density = np.exp(-0.5 * heights**2 / variance) / np.sqrt(2.0 * np.pi * variance)
        return np.asarray(np.log((1.0 - _ANYWHERE) * _SPREAD * density + _ANYWHERE))
