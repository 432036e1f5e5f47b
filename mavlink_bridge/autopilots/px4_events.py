"""What a PX4 tells by EVENT: the numbers of the reports that explain a refusal, in our words.

PX4 numbers an event by a hash of its name (FNV-1a, 24 bits, under its component's number), so
names suffice. Source: PX4's events.h and its health and arming checks. An event that is not
listed here is shown by its number.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from mavlink_bridge.wire.messages import Event

_AUTOPILOT = 1 << 24
_PRIME, _START = 16777619, 2166136261
WARNING = 4  # severity up to which an event says that something is wrong


def event_number(name: str) -> int:
    """Return the number under which PX4's autopilot sends the event of this name."""
    number = _START
    for byte in name.encode():
        number = (number ^ byte) * _PRIME & 0xFFFFFFFF
    return number & 0xFFFFFF | _AUTOPILOT


_SUMMARY = event_number("commander_arming_check_summary")
_HEALTH_SUMMARY = event_number("commander_health_summary")
# Reports of single incidents.
_INCIDENTS = {
    "commander_arm_denied_calibrating": "arming denied: calibrating",
    "commander_arm_denied_throttle_center": "arming denied: throttle above centre",
    "commander_arm_denied_throttle_high": "arming denied: throttle too high",
    "commander_arm_denied_not_manual": "arming denied: not in a manual mode",
    "commander_arm_denied_resolve_failures": "arming denied: a check fails",
    "commander_disarm_denied_not_landed": "disarming denied: not landed",
    "commander_unsupported_main_mode": "mode refused: no such main mode",
    "commander_unsupported_auto_mode": "mode refused: no such automatic mode",
    "commander_unsupported_base_mode": "mode refused: no such base mode",
    "commander_modeswitch_not_avail": "mode refused: not possible now",
    "commander_mission_start_denied_no_mission": "mission refused: none is stored",
    "commander_kill_sw_engaged": "kill switch on",
    "commander_gcs_lost": "ground station lost",
    "commander_rc_lost": "manual control lost",
    "commander_failsafe_enter": "failsafe",
    "commander_failsafe_enter_hold": "failsafe: it holds first",
    "commander_failsafe_enter_generic": "failsafe: it changes its mode",
    "commander_failsafe_enter_generic_hold": "failsafe: it holds first",
    "commander_failsafe_enter_crit_bat_warn": "battery critical",
    "commander_failsafe_enter_low_bat": "battery low",
}
# Checks that fail: their first argument is a mask of the modes that they bar.
_CHECKS = {
    "check_modes_cannot_takeoff": "no take-off from this mode",
    "check_modes_offboard_signal": "no setpoints for offboard",
    "check_modes_mission": "no mission",
    "check_modes_manual_control": "no manual control",
    "check_modes_angular_velocity": "no body rates",
    "check_modes_attitude": "no attitude",
    "check_modes_local_pos": "no local position",
    "check_modes_global_pos": "no global position",
    "check_modes_local_alt": "no altitude",
    "check_modes_home_position": "no home position",
    "check_system_no_global_pos": "no global position",
    "check_system_no_home_pos": "no home position",
    "check_system_safety_button": "safety button not pressed",
    "check_system_usb_connected": "USB is connected",
    "check_system_flight_term_active": "flight is terminated",
    "check_system_arm_auth_failed": "no authorisation",
    "check_armable_configuration": "set up not to arm",
    "check_man_control_kill_engaged": "kill switch is on",
    "check_man_control_rtl_engaged": "return switch is on",
    "check_rc_dl_no_dllink": "no ground station",
    "check_missing_fmu_sdcard": "no SD card",
    "check_battery_low": "battery low",
    "check_battery_critical": "battery critical",
    "check_battery_emergency": "battery empty",
    "check_battery_missing": "no battery",
    "check_battery_unhealthy": "battery unhealthy",
    "check_gyro_missing": "no gyro",
    "check_gyro_no_data": "gyro gives no data",
    "check_gyro_not_calibrated": "gyro not calibrated",
    "check_accel_missing": "no accelerometer",
    "check_accel_no_data": "accelerometer gives no data",
    "check_accel_not_calibrated": "accelerometer not calibrated",
    "check_mag_missing": "no compass",
    "check_mag_no_data": "compass gives no data",
    "check_mag_not_calibrated": "compass not calibrated",
    "check_mag_fault": "compass faulty",
    "check_mag_consistency": "compasses differ",
    "check_baro_missing": "no barometer",
    "check_baro_no_data": "barometer gives no data",
    "check_imu_accel_inconsistent": "accelerometers differ",
    "check_imu_gyro_inconsistent": "gyros differ",
    "check_estimator_missing_data": "estimator starts",
    "check_estimator_heading_not_stable": "heading not stable",
    "check_estimator_hor_vel_not_stable": "horizontal velocity not stable",
    "check_estimator_vert_vel_not_stable": "vertical velocity not stable",
    "check_estimator_hor_pos_not_stable": "horizontal position not stable",
    "check_estimator_hgt_not_stable": "height not stable",
    "check_estimator_mag_interference": "magnetic interference",
    "check_estimator_gps_fix_too_low": "GPS fix too poor",
    "check_estimator_gps_num_sats_too_low": "too few GPS satellites",
    "check_estimator_gps_hor_pos_err_too_high": "GPS position too uncertain",
    "check_estimator_gps_generic": "GPS too poor",
    "check_estimator_gps_not_fusing": "estimator does not use GPS",
    "check_estimator_high_accel_bias": "accelerometer bias too high",
    "check_estimator_high_gyro_bias": "gyro bias too high",
    "check_failure_detector_motor": "motor failure",
    "check_failure_detector_arm_esc": "ESC failure",
    "check_escs_offline": "ESC offline",
    "check_cpuload_too_high": "processor overloaded",
    "check_gf_no_home": "geofence without home",
}
_INCIDENT_WORDS = {event_number(name): words for name, words in _INCIDENTS.items()}
_CHECK_WORDS = {event_number(name): words for name, words in _CHECKS.items()}
_STATES = {"hold": 4, "rtl": 5, "offboard": 14, "takeoff": 17, "land": 18}


@dataclass(frozen=True)
class _Check:
    words: str
    modes: int


class Px4Events:
    """Follows the EVENTs of one PX4, and puts a refusal into words."""

    def __init__(self) -> None:
        self._checks: list[_Check] = []

    def hear(self, event: Event, mode: str) -> str:
        """Return what an event says is wrong, in words; empty where nothing is.

        mode: the vehicle's, as the adapter names it. A refusal to arm names the checks that fail in
        this mode: PX4 reports them only when they change, before it refuses.
        """
        number = event.event_id
        if number == _SUMMARY:
            self._checks = []
            return ""
        if number in _CHECK_WORDS:
            modes = struct.unpack_from("<I", event.arguments)[0]
            self._checks.append(_Check(_CHECK_WORDS[number], modes))
            return ""
        if number in _INCIDENT_WORDS:
            words = _INCIDENT_WORDS[number]
            why = self.failing(mode) if words.startswith("arming denied: a check") else ""
            return f"arming denied: {why}" if why else words
        if event.severity > WARNING:
            return ""
        return f"event {number:#x}, severity {event.severity}"

    def failing(self, mode: str) -> str:
        """Return the checks that keep the vehicle from arming in this mode; empty: none known."""
        bit = 1 << _STATES[mode] if mode in _STATES else 0
        return ", ".join(dict.fromkeys(c.words for c in self._checks if c.modes & bit))
