"""The request that the bridge repeats to a Betaflight, and its answer."""

from __future__ import annotations

from dataclasses import dataclass

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.msp import Msp, MspError, Reply

POLLED = [Msp.ATTITUDE, Msp.RAW_IMU, Msp.ALTITUDE, Msp.RAW_GPS, Msp.STATUS_EX, Msp.RC, Msp.ANALOG]


@dataclass(frozen=True)
class Answer:
    """One answer: angles [rad] of `msp.attitude`, height [m], throttle [µs], battery [V], [A]."""

    status: msp.Status
    imu: msp.RawImu
    attitude: tuple[float, float, float]
    height: float
    gps: msp.RawGps | None
    throttle: float
    battery: tuple[float, float]


def read_answer(reply: Reply) -> Answer | None:
    """Return the answer to POLLED; None for another reply or an unreadable one."""
    if reply.command != Msp.MULTIPLE_MSP or reply.refused:
        return None
    parts = msp.split(POLLED, reply.payload)
    if len(parts) < len(POLLED):
        return None
    try:
        return Answer(
            msp.status(parts[Msp.STATUS_EX]),
            msp.raw_imu(parts[Msp.RAW_IMU]),
            msp.attitude(parts[Msp.ATTITUDE]),
            msp.altitude(parts[Msp.ALTITUDE])[0],  # its climb rate lags by 0.3 s
            # Firmware built without GPS leaves it empty; GPS_INPUT then replaces it.
            msp.raw_gps(parts[Msp.RAW_GPS]) if parts[Msp.RAW_GPS] else None,
            msp.throttle(parts[Msp.RC]),
            msp.battery(parts[Msp.ANALOG]),
        )
    except MspError:
        return None
