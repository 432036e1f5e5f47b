"""Conversion of collective acceleration c [m/s²] and normalised thrust 0…1.

Autopilots normalise thrust so that force is about proportional to it (as PX4's MPC_THR_HOVER).
The hover thrust depends on the airframe and the battery, so it is estimated in flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mavlink_bridge.shared.constants import GRAVITY

HOVER_MIN, HOVER_MAX = 0.05, 0.8  # normalised thrust of any drone that can fly


@dataclass(frozen=True)
class ThrustMap:
    """thrust = hover_thrust · (c/g)^(1/exponent): exponent 1 where force ∝ thrust.

    hover_thrust: normalised thrust that holds the vehicle, in (0, 1).
    exponent: force ∝ thrust^exponent; 1 for linearised autopilots, up to 2 for raw throttle.
    """

    hover_thrust: float = 0.5
    exponent: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.hover_thrust < 1.0:
            raise ValueError(f"hover_thrust must lie in (0, 1), got {self.hover_thrust}")
        if not 0.5 <= self.exponent <= 3.0:
            raise ValueError(f"exponent must lie in [0.5, 3], got {self.exponent}")

    def to_thrust(self, c: float) -> float:
        """Return the normalised thrust in [0, 1] for a collective acceleration c [m/s²]."""
        relative = max(c, 0.0) / GRAVITY
        return float(min(self.hover_thrust * relative ** (1.0 / self.exponent), 1.0))


def exponent_of_curve(curve: float, hover_thrust: float) -> float:
    """Return the exponent of force ∝ thrust^exponent near hover, for motors of force ∝ speed².

    curve: the autopilot's THR_MDL_FAC or MOT_THST_EXPO, 0…1: it takes thrust for
    curve · speed² + (1 - curve) · speed. So the exponent is 1 at curve 1, and 2 at curve 0.
    """
    linear = 1.0 - curve
    root = math.sqrt(linear * linear + 4.0 * curve * hover_thrust)
    speed = (root - linear) / (2.0 * curve) if curve > 1e-6 else hover_thrust
    return 2.0 * hover_thrust / (speed * root)
