"""The wake below a drone and the cushion above the ground.

Downwash: the wakes of the four rotors merge into one round turbulent jet (Bauersfeld et al.,
"Robotics meets fluid dynamics", arXiv 2403.13321). Its decay and spread are those of Pope,
"Turbulent Flows", 5.1: the speed on the axis is 6.0 times the exit speed times the nozzle's
diameter over the distance, the half width is 0.094 of the distance, the profile is Gaussian. The
momentum of the jet is the thrust of the drone above. A drone in the jet feels it as wind, by its
own drag, as a loss of thrust, and as torque where its rotors are in different air.

The loss of thrust is such that a drone two widths below its like is pushed down as Crazyflies are:
0.3 m apart, the lower one of 34 g loses 9 g (Shi et al., "Neural-Swarm", ICRA 2020).

Ground effect: Cheeseman and Bennett, "The effect of the ground on a helicopter rotor in forward
flight", ARC R&M 3021, 1955.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

AIR_DENSITY = 1.225  # kg/m³
DECAY = 6.0 * math.sqrt(4.0 / math.pi)  # speed on the axis · distance / √(thrust / density)
SPREAD = 0.094 / math.sqrt(2.0 * math.log(2.0))  # standard deviation across · 1 / distance
ORIGIN = 3.5  # widths of the drone that the jet's virtual origin lies above the drone
THRUST_LOSS = 0.016  # share of thrust for each m/s of air from above
LEGS = 0.05  # m, from the feet to the rotors
LARGEST_GAIN = 1.5  # of thrust: the formula ends where a rotor touches the ground


def jet(below: Floats, aside: Floats, thrust: Floats, width: Floats) -> Floats:
    """Return the speed [m/s] of the jet, away from the drone that makes it.

    below: m along the jet. aside: m across it. thrust: N. width: m, tip to tip. All broadcast.
    """
    distance = np.maximum(below, 0.0) + ORIGIN * width
    axis = DECAY * np.sqrt(np.maximum(thrust, 0.0) / AIR_DENSITY) / distance
    speed: Floats = axis * np.exp(-0.5 * (aside / (SPREAD * distance)) ** 2)
    return np.where(below > 0.0, speed, 0.0)


def downwash(p: Floats, up: Floats, thrust: Floats, width: Floats, places: Floats) -> Floats:
    """Return the air (n,k,3) m/s, world, that other drones drive to k places of each drone.

    p (n,3) m; up (n,3), the thrust's direction; thrust (n,) N; width (n,) m; places (n,k,3) m.
    """
    offset = places[:, :, None] - p  # (n, k, maker, 3)
    below = -(offset * up).sum(axis=-1)
    aside = np.linalg.norm(offset + below[..., None] * up, axis=-1)
    speed = jet(below, aside, thrust, width)
    speed[np.arange(len(p)), :, np.arange(len(p))] = 0.0
    air: Floats = -(speed[..., None] * up).sum(axis=2)
    return air


def ground_gain(height: Floats, rotor_radius: Floats) -> Floats:
    """Return thrust near the ground over thrust away from it, for feet `height` (n,) m above it."""
    ratio = rotor_radius / (4.0 * (np.maximum(height, 0.0) + LEGS))
    gain: Floats = np.minimum(1.0 / (1.0 - np.minimum(ratio, 0.99) ** 2), LARGEST_GAIN)
    return gain
