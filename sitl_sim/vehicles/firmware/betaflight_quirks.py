"""Errors of Betaflight's telemetry: coarse attitude, no body rates, a clock in µs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mavlink_bridge.shared.frames import euler_from_quaternion, quaternion_from_euler
from mavlink_bridge.wire.ids import MessageId
from mavlink_bridge.wire.messages import EulerAttitude, GlobalPosition, Message
from sitl_sim.vehicles.firmware.streams import attitude, global_position
from sitl_sim.vehicles.firmware.unit import Unit

STEP = math.radians(0.1)


def coarse_attitude(u: Unit) -> Message:
    """Make ATTITUDE with angles in steps of 0.1° and body rates of zero."""
    exact = attitude(u)
    q = quaternion_from_euler(*(_step(a) for a in euler_from_quaternion(exact.q_wb)))
    return EulerAttitude(exact.time, q, np.zeros(3))


def _step(angle: float) -> float:
    return round(angle / STEP) * STEP


def odd_global_position(u: Unit) -> Message | None:
    """Make GLOBAL_POSITION_INT as Betaflight does; none without a position.

    Its time is in µs in a field of ms, its heading in whole degrees, and its height above home is
    the height above the sea until the vehicle is armed first.
    """
    exact = global_position(u)
    if not isinstance(exact, GlobalPosition) or exact.heading is None:
        return exact
    height = exact.relative_altitude if u.commander.was_armed else exact.altitude
    return replace(
        exact,
        time=exact.time * 1e3,
        heading=math.radians(round(math.degrees(exact.heading)) % 360),
        relative_altitude=height,
    )


QUIRKS: dict[int, Callable[[Unit], Message | None]] = {
    MessageId.ATTITUDE: coarse_attitude,
    MessageId.GLOBAL_POSITION_INT: odd_global_position,
}
