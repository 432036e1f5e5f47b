"""Airframes by name, and a vehicle that differs from what it is taken for.

Masses and thrusts are those of common builds: 3-inch (0.3 kg, 1404 motors, 4S 850 mAh), 5-inch
(0.7 kg, 2207 motors, 4S 1500 mAh) and 7-inch (1.4 kg, 2806 motors, 4S 3000 mAh), each with three
times its weight in thrust. Drag and inertia scale with size and mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sitl_sim.vehicles.airframe import Airframe, RateGains

AIRFRAMES: dict[str, Airframe] = {
    "quad3": Airframe(
        mass=0.3,
        inertia=(0.0005, 0.00055, 0.0009),
        arm=0.07,
        thrust_max=2.2,
        motor_time=0.025,
        torque_coefficient=0.011,
        rotor_torque=0.0016,
        drag_linear=(0.07, 0.07, 0.035),
        drag_quadratic=0.007,
        radius=0.13,
        rotor_radius=0.038,
        battery_ah=0.85,
        battery_resistance=0.03,
        current_full=11.0,
    ),
    "quad5": Airframe(),
    "quad7": Airframe(
        mass=1.4,
        inertia=(0.011, 0.012, 0.02),
        arm=0.16,
        thrust_max=10.3,
        motor_time=0.045,
        torque_coefficient=0.022,
        rotor_torque=0.03,
        drag_linear=(0.24, 0.24, 0.12),
        drag_quadratic=0.028,
        radius=0.28,
        rotor_radius=0.089,
        battery_ah=3.0,
        battery_resistance=0.012,
        current_full=36.0,
    ),
}


@dataclass(frozen=True)
class Deviation:
    """Factors by which a vehicle differs from its airframe; neither autopilot nor companion knows.

    rate_gains: of P, I and D of its rate loops. battery: of its internal resistance.
    """

    mass: float = 1.0
    inertia: float = 1.0
    thrust: float = 1.0
    drag: float = 1.0
    motor_time: float = 1.0
    rate_gains: float = 1.0
    battery: float = 1.0

    def airframe(self, known: Airframe) -> Airframe:
        """Return the true airframe of a vehicle that is taken for `known`."""
        jx, jy, jz = (j * self.inertia for j in known.inertia)
        dx, dy, dz = (d * self.drag for d in known.drag_linear)
        return replace(
            known,
            mass=known.mass * self.mass,
            inertia=(jx, jy, jz),
            thrust_max=known.thrust_max * self.thrust,
            drag_linear=(dx, dy, dz),
            drag_quadratic=known.drag_quadratic * self.drag,
            motor_time=known.motor_time * self.motor_time,
            battery_resistance=known.battery_resistance * self.battery,
        )

    def gains(self, known: RateGains) -> RateGains:
        """Return the true gains of rate loops that are taken for `known`."""
        p, i, d = ([k * self.rate_gains for k in gain] for gain in (known.p, known.i, known.d))
        return replace(known, p=(p[0], p[1], p[2]), i=(i[0], i[1], i[2]), d=(d[0], d[1], d[2]))
