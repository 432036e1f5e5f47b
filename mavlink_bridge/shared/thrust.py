"""Conversion of collective acceleration c [m/s²] and normalised thrust 0…1.

Autopilots normalise thrust so that force is about proportional to it (as PX4's MPC_THR_HOVER).
The hover thrust depends on the airframe and the battery, so it is estimated in flight.
"""

from __future__ import annotations

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


@dataclass(frozen=True)
class HoverThrustEstimator:
    """Scalar Kalman filter for hover_thrust from commanded thrust and measured acceleration.

    variance: of the estimate. process: variance growth per second (battery sag, payload).
    noise: variance of one measurement of c/g.
    """

    map: ThrustMap
    variance: float = 4e-3
    process: float = 2e-6
    noise: float = 0.05
    bounds: tuple[float, float] = (HOVER_MIN, HOVER_MAX)

    def update(self, thrust: float, c_measured: float, dt: float) -> HoverThrustEstimator:
        """Return the estimate after `dt` [s] of `thrust` with c_measured [m/s²] along +z_B."""
        h = self.map.hover_thrust
        variance = self.variance + self.process * dt
        if thrust < 0.05 or c_measured < 0.2 * GRAVITY:
            return HoverThrustEstimator(self.map, variance, self.process, self.noise, self.bounds)
        # measured c/g = (thrust/h)^e, linearised around the last h
        predicted = (thrust / h) ** self.map.exponent
        slope = -self.map.exponent * predicted / h
        gain = variance * slope / (slope * slope * variance + self.noise)
        h_new = min(
            max(h + gain * (c_measured / GRAVITY - predicted), self.bounds[0]), self.bounds[1]
        )
        return HoverThrustEstimator(
            ThrustMap(h_new, self.map.exponent),
            (1.0 - gain * slope) * variance,
            self.process,
            self.noise,
            self.bounds,
        )
