"""What a quadrotor is: its body, and the gains of its rate loops. Data alone, no kernels."""

from __future__ import annotations

from dataclasses import dataclass

from mavlink_bridge.shared.constants import GRAVITY


@dataclass(frozen=True)
class Airframe:
    """A quadrotor in X shape; the default is a 5-inch one with a thrust-to-weight ratio of 3.

    mass: kg. inertia: (3,) kg m², principal. arm: m, centre to motor. thrust_max: N per motor
    at full speed. motor_time: s. torque_coefficient: N m of reaction per N of thrust.
    rotor_torque: N m per 1/s of change of normalised motor speed (rotor inertia times full
    speed). drag_linear: (3,) N/(m/s), body axes. drag_quadratic: N/(m/s)². idle: normalised
    motor command while armed. radius: m. rotor_radius: m, of one propeller.
    battery_ah: A h. battery_resistance: ohm. current_full: A per motor at full speed.
    """

    mass: float = 0.7
    inertia: tuple[float, float, float] = (0.0025, 0.0027, 0.0045)
    arm: float = 0.11
    thrust_max: float = 5.15
    motor_time: float = 0.03
    torque_coefficient: float = 0.016
    rotor_torque: float = 0.008
    drag_linear: tuple[float, float, float] = (0.14, 0.14, 0.07)
    drag_quadratic: float = 0.015
    idle: float = 0.055
    radius: float = 0.2
    rotor_radius: float = 0.0635
    battery_ah: float = 1.5
    battery_resistance: float = 0.02
    current_full: float = 22.0

    @property
    def c_max(self) -> float:
        """Collective acceleration at full throttle [m/s²]."""
        return 4.0 * self.thrust_max / self.mass

    @property
    def hover_thrust(self) -> float:
        """Share of the full collective thrust that carries the weight."""
        return GRAVITY / self.c_max


@dataclass(frozen=True)
class RateGains:
    """Gains of roll, pitch, yaw: P [1/s], I [1/s²], D [-], feed-forward [-]; cutoffs in Hz.

    With the defaults a step of roll or pitch rises to 90 % within 50 ms and overshoots by 2 %; yaw
    has less authority and takes 60 ms.
    """

    p: tuple[float, float, float] = (100.0, 100.0, 40.0)
    i: tuple[float, float, float] = (120.0, 120.0, 200.0)
    d: tuple[float, float, float] = (1.8, 1.8, 0.0)
    feed_forward: tuple[float, float, float] = (0.4, 0.4, 0.0)
    setpoint_hz: float = 30.0
    gyro_hz: float = 150.0
    d_hz: float = 100.0
    relax_hz: float = 3.0
