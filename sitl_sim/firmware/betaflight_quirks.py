"""Betaflight's telemetry as it really is: coarse attitude, no body rates, a clock in µs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.messages import EulerAttitude, GlobalPosition, Message
from sitl_sim.firmware.streams import attitude, global_position

if TYPE_CHECKING:
    from sitl_sim.firmware.unit import Unit

STEP = math.radians(0.1)


def coarse_attitude(u: Unit) -> Message:
    """Roll, pitch and yaw in steps of 0.1°; body rates zero."""
    exact = attitude(u)
    w, x, y, z = (float(k) for k in exact.q_wb)
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    q = _quaternion(*(_step(a) for a in (roll, pitch, yaw)))
    return EulerAttitude(exact.time, q, np.zeros(3))


def _step(angle: float) -> float:
    return round(angle / STEP) * STEP


def _quaternion(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    (a, b, c), (d, e, f) = ([g(k / 2) for k in (roll, pitch, yaw)] for g in (math.cos, math.sin))
    return np.array(
        [
            a * b * c + d * e * f,
            d * b * c - a * e * f,
            a * e * c + d * b * f,
            a * b * f - d * e * c,
        ]
    )


def odd_global_position(u: Unit) -> Message | None:
    """Time in µs in a field of ms, heading in whole degrees, height not zeroed before arming."""
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
    30: coarse_attitude,
    33: odd_global_position,
}
