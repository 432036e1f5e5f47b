"""Dryden turbulence at low altitude: MIL-F-8785C, 3.7.3.4 (heights of 10 to 1000 ft).

The intensity of the vertical gusts is a tenth of the wind speed at 20 ft: 15, 30 or 45 knots for
light, moderate and severe. Near the ground the horizontal gusts are stronger and the scales
shorter. Every drone has filters of its own: drones metres apart feel different gusts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Strength = Literal["none", "light", "moderate", "severe"]

FOOT, KNOT = 0.3048, 1852.0 / 3600.0  # m, m/s
WIND_AT_20_FT = {"light": 15.0 * KNOT, "moderate": 30.0 * KNOT, "severe": 45.0 * KNOT}
HEIGHTS = (10.0 * FOOT, 1000.0 * FOOT)  # m, for which the model holds; others are taken as these
BLOCK = 100  # steps whose noise is drawn at once


def intensities(strength: Strength, height: Floats) -> tuple[Floats, Floats]:
    """Return the standard deviations [m/s] of horizontal and vertical gusts at heights [m]."""
    h = np.clip(height, *HEIGHTS) / FOOT
    vertical = np.full_like(h, 0.1 * WIND_AT_20_FT[strength])
    return vertical / (0.177 + 0.000823 * h) ** 0.4, vertical


def scales(height: Floats) -> tuple[Floats, Floats]:
    """Return the length scales [m] of horizontal and vertical gusts at heights [m]."""
    h = np.clip(height, *HEIGHTS) / FOOT
    return h / (0.177 + 0.000823 * h) ** 1.2 * FOOT, h * FOOT


class Turbulence:
    """The gusts at n drones; system_ids and seed decide on all of them."""

    def __init__(self, strength: Strength, system_ids: Sequence[int], seed: int) -> None:
        self._strength = strength
        n = len(system_ids)
        self._rngs = [np.random.default_rng([seed, 0xD47DE, s]) for s in system_ids]
        self._noise = np.zeros((n, BLOCK, 3))
        self._at = BLOCK
        first = np.array([r.standard_normal(5) for r in self._rngs])
        # States of unit variance: along the wind one, across it and vertical two each, of which
        # `_y` is the slow one and `_rate` its change times the time constant.
        self._along = first[:, 0]
        self._y, self._rate = 0.5 * first[:, 1:3], 0.5 * first[:, 3:5]

    def step(self, dt: float, height: Floats, wind: Floats, v: Floats) -> Floats:
        """Step by dt [s]; return the gusts (n,3) m/s, world.

        height: (n,) m over the ground. wind: (n,3) m/s, its mean. v: (n,3) m/s, of the drones.
        """
        sigma, sigma_up = intensities(self._strength, height)
        scale, scale_up = scales(height)
        # The gusts pass by at the speed of the air; in still air they carry each other along.
        passing = np.sqrt(((v - wind) ** 2).sum(axis=1) + sigma**2)
        noise = self._next_noise()
        keep = np.exp(-dt * passing / scale)
        self._along = keep * self._along + np.sqrt(1.0 - keep**2) * noise[:, 0]
        share = dt * passing[:, None] / np.stack([scale, scale_up], axis=1)  # of a time constant
        self._rate += -share * (2.0 * self._rate + self._y) + np.sqrt(share) * noise[:, 1:]
        self._y += share * self._rate
        across = self._y + math.sqrt(3.0) * self._rate  # 1 + √3 τ s over (1 + τ s)²
        return self._in_world(sigma * self._along, sigma * across[:, 0], wind) + (
            np.outer(sigma_up * across[:, 1], [0.0, 0.0, 1.0])
        )

    def _next_noise(self) -> Floats:
        if self._at == BLOCK:
            self._noise[:] = [r.standard_normal((BLOCK, 3)) for r in self._rngs]
            self._at = 0
        self._at += 1
        noise: Floats = self._noise[:, self._at - 1]
        return noise

    @staticmethod
    def _in_world(along: Floats, across: Floats, wind: Floats) -> Floats:
        """Return gusts along and across the horizontal mean wind (east where there is none)."""
        speed = np.hypot(wind[:, 0], wind[:, 1])
        still = speed < 1e-6
        safe = np.where(still, 1.0, speed)
        c, s = np.where(still, 1.0, wind[:, 0] / safe), np.where(still, 0.0, wind[:, 1] / safe)
        return np.stack([c * along - s * across, s * along + c * across, np.zeros_like(c)], axis=1)
