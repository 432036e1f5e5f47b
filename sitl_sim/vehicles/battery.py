"""Batteries that discharge and sag: reported by the autopilots, felt by the motors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles

Floats = NDArray[np.float64]

CELLS = 4
CELL_FULL, CELL_EMPTY = 4.2, 3.5  # V, at rest
CURRENT_ELECTRONICS = 0.6  # A
FILTER = 0.2  # share of the newest value in the reported voltage and current


class Batteries:
    """One battery per vehicle; arrays (n,): voltage [V], current [A], remaining 0…1."""

    def __init__(self, airframes: Sequence[Airframe]) -> None:
        n = len(airframes)
        self.capacity = np.array([a.battery_ah * 3600.0 for a in airframes])  # A s
        self._resistance = np.array([a.battery_resistance for a in airframes])
        self._current_full = np.array([a.current_full for a in airframes])
        self.remaining = np.ones(n)
        self.current = np.full(n, CURRENT_ELECTRONICS)
        self.voltage = np.full(n, CELLS * CELL_FULL)

    def drain(self, vehicles: Vehicles, dt: float) -> None:
        """Discharge for dt [s] by the motors' present current; set the vehicles' motor_gain."""
        motors: Floats = (vehicles.motor**3).sum(axis=1)  # current goes with the cube of speed
        current = CURRENT_ELECTRONICS + self._current_full * motors
        self.remaining = np.maximum(self.remaining - current * dt / self.capacity, 0.0)
        rest = CELLS * (CELL_EMPTY + (CELL_FULL - CELL_EMPTY) * self.remaining)
        voltage = rest - self._resistance * current
        self.current += FILTER * (current - self.current)
        self.voltage += FILTER * (voltage - self.voltage)
        vehicles.body.motor_gain[:] = voltage / (CELLS * CELL_FULL)
