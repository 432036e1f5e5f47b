"""How long a tick of each companion takes to reach the vehicle."""

from __future__ import annotations

import numpy as np

from sitl_sim.scenarios.conditions import drawn
from sitl_sim.scenarios.scenario import QUANTUM_MS, Scenario

_DRAW = 5  # of `conditions.drawn`
_LONGEST_TICK = 80  # ms that a companion computes; a longer delay is the way to the vehicle


class Delays:
    """Each companion's mean delay, and its jitter from tick to tick, drawn by the seed."""

    def __init__(self, scenario: Scenario) -> None:
        timing, count = scenario.timing, scenario.drones.count
        self.means = drawn(timing.compute_delay, count, scenario.seed, _DRAW)  # s
        self._jitter = timing.compute_jitter
        self._generators = [np.random.default_rng([scenario.seed, 7, i]) for i in range(count)]

    def draw(self, i: int) -> tuple[int, int]:
        """Return how long the next tick of drone i computes, then is on its way [ms]."""
        delay = float(self.means[i])
        if self._jitter:
            jitter = self._generators[i].uniform(-self._jitter, self._jitter)
            delay = max(delay + jitter, 0.002)
        whole = max(round(delay * 1e3 / QUANTUM_MS) * QUANTUM_MS, QUANTUM_MS)
        computing = min(whole, _LONGEST_TICK)
        return computing, whole - computing
