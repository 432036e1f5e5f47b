"""The emulated autopilots by name."""

from __future__ import annotations

from sitl_sim.vehicles.firmware.ardupilot import ARDUPILOT
from sitl_sim.vehicles.firmware.betaflight import BETAFLIGHT
from sitl_sim.vehicles.firmware.flavour import Flavour
from sitl_sim.vehicles.firmware.px4 import PX4

FLAVOURS: dict[str, Flavour] = {f.name: f for f in (PX4, ARDUPILOT, BETAFLIGHT)}


def flavour_of(name: str) -> Flavour:
    """Return the flavour of this name.

    Raises:
        ValueError: there is none; the message lists the choices.
    """
    if name not in FLAVOURS:
        raise ValueError(f"unknown autopilot {name!r}: choose one of {', '.join(FLAVOURS)}")
    return FLAVOURS[name]
