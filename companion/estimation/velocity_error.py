"""Errors of the reported velocity, as the reported positions show them.

An estimator whose accelerometer is worse than it assumes is sure of a velocity that is wrong by
half a metre a second, for seconds, while GPS keeps its position right. Positions that slide for
another reason (a signal that takes another path, an RTK solution that floats) do so now and then,
by little. So the velocity is corrected only where its disagreement with the positions goes on for
long and is larger than its own doubt: the share by which it is corrected is that of a Wiener
filter, wrong velocity against sliding position. Where the ground in the pictures shows the velocity
it cannot be more wrong than that leaves open, and the rest of the disagreement is slides.
"""

from __future__ import annotations

import math

import numpy as np

from mavlink_bridge.shared.arrays import Vector

_AVERAGED = 0.4  # s over which positions are differentiated: errors last for seconds
_REMEMBERED = 10.0  # s over which disagreement is gathered
_SLIDES = 0.1  # m/s, 1 σ of what positions slide by themselves
_HARMLESS = 0.15  # m/s that fly well
_SURE = 1.5  # times its reported 1 σ, from which the velocity counts as wrong


class VelocityError:
    """Follows one vehicle; error: (3,) m/s, to be added to its reported velocity."""

    def __init__(self) -> None:
        self.error: Vector = np.zeros(3)
        self._rate: Vector = np.zeros(3)  # m/s, of the positions less the velocity
        self._power = 0.0  # mean square of the horizontal rate

    def update(
        self, unexplained: Vector, dt: float, sigma: float, by_sight: float = math.inf
    ) -> None:
        """Take in a motion (3,) m within dt [s] that the reported velocity does not explain.

        sigma: m/s, 1 σ of the velocity as the estimator reports it. by_sight: m/s, 1 σ to which the
        ground in the pictures shows it; infinite where none does.
        """
        share = 1.0 - math.exp(-dt / _AVERAGED)
        self._rate = self._rate + share * (unexplained / dt - self._rate)
        square = float(self._rate[0] ** 2 + self._rate[1] ** 2)
        self._power += (1.0 - math.exp(-dt / _REMEMBERED)) * (square - self._power)
        wrong = self._power > max(_SURE * sigma, _HARMLESS) ** 2
        velocity = min(self._power, by_sight**2)
        slides = max(self._power - velocity, _SLIDES**2)
        self.error = (velocity / (velocity + slides) if wrong else 0.0) * self._rate
