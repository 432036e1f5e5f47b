"""Why a vehicle does not arm: the checks that fail, and how each autopilot tells them.

PX4 tells a ground station one sentence for all of them, and gives the reasons as EVENTs whenever
they change. ArduCopter says the reason. Event numbers: `mavlink_bridge.autopilots.px4_events`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from mavlink_bridge.autopilots.px4_events import event_number
from mavlink_bridge.wire.messages import Event
from sitl_sim.vehicles.firmware.flavour import Mode

ALL_MODES = 0xFFFFFFFF
# PX4's navigation states by our modes: bits of the mask in an arming check's EVENT.
STATES = {
    Mode.STABILIZED: 15,
    Mode.ALTITUDE: 1,
    Mode.POSITION: 2,
    Mode.MISSION: 3,
    Mode.HOLD: 4,
    Mode.RETURN: 5,
    Mode.OFFBOARD: 14,
    Mode.TAKEOFF: 17,
    Mode.LAND: 18,
}
NOT_FOR_ARMING = 0x3C3020  # return, land and their like
SUMMARY = "commander_arming_check_summary"
ERROR, INFORMATION, PROTOCOL = 3, 6, 8  # severities
_SENSORS = {
    "gyro": "check_gyro_missing",
    "accelerometer": "check_accel_missing",
    "magnetometer": "check_mag_missing",
    "gps": "check_modes_global_pos",
}


@dataclass(frozen=True)
class Failure:
    """One failed check: in plain words, PX4's name of it, its severity, and the modes it bars."""

    words: str
    name: str
    severity: int = ERROR
    modes: int = ALL_MODES

    def bars(self, mode: Mode) -> bool:
        """Return whether the vehicle may not arm in this mode."""
        return bool(self.modes >> STATES[mode] & 1)


_WRONG_MODE = Failure(
    "mode can not be armed", "check_modes_cannot_takeoff", INFORMATION, NOT_FOR_ARMING
)


def failures(
    failed: set[str], battery_empty: bool, stream_ok: bool, mission: bool
) -> list[Failure]:
    """Return the checks that fail now; each bars some modes or all.

    failed: sensors that do not work. stream_ok: setpoints come. mission: one is stored.
    """
    found = [Failure(f"{name} failure", _SENSORS[name]) for name in sorted(failed)]
    if battery_empty:
        found.append(Failure("battery too low", "check_battery_critical"))
    if not mission:
        bit = 1 << STATES[Mode.MISSION]
        found.append(Failure("Mode requires mission", "check_modes_mission", INFORMATION, bit))
    if not stream_ok:
        bit = 1 << STATES[Mode.OFFBOARD]
        found.append(Failure("no offboard signal", "check_modes_offboard_signal", ERROR, bit))
    return found


class Reporter:
    """Makes the EVENTs of one PX4, with their sequence numbers."""

    def __init__(self) -> None:
        self._sequence = 0
        self._told: tuple[Failure, ...] | None = ()

    def event(self, time: float, name: str, severity: int, arguments: bytes = b"") -> Event:
        """Return the event of this name at `time` [s] since boot."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        number = event_number(name)
        return Event(time, number, self._sequence, severity, arguments.ljust(40, b"\0"))

    def forget(self) -> None:
        """Report the checks once more, changed or not."""
        self._told = None

    def checks(self, time: float, found: list[Failure], barred: bool) -> list[Event]:
        """Return a summary and all failed checks where they changed; barred: no mode to arm in."""
        told = (*found, *([_WRONG_MODE] if barred else []))
        if told == self._told:
            return []
        self._told = told
        reports = [self.event(time, SUMMARY, PROTOCOL)]
        for f in told:
            arguments = struct.pack("<IB", f.modes, 0)
            reports.append(self.event(time, f.name, f.severity, arguments))
        return reports
