"""The emulated Betaflight: MAVLink telemetry with its quirks, and RC channels to fly it.

As in 2025.12: no LOCAL_POSITION_NED, no parameters, no commands, no setpoints. The errors of its
messages are in `betaflight_quirks.py`, its RC channels in `sticks.py`.
"""

from __future__ import annotations

from collections.abc import Mapping

from mavlink_bridge.wire.ids import AutopilotId, MessageId, ParameterType
from sitl_sim.vehicles.firmware.flavour import FailsafeAction, Flavour, Mode, Settings

REAL32 = ParameterType.REAL32
_ACRO = 1  # the custom_mode that it sends in every mode


def _settings(p: Mapping[str, float]) -> Settings:
    return Settings(
        hover=p["hover"],
        thrust_curve=p["thrust_linear"],
        takeoff_altitude=2.5,
        takeoff_speed=1.5,
        land_speed=0.7,
        crawl_speed=0.3,
        cruise_speed=5.0,
        up_speed=3.0,
        down_speed=1.5,
        return_altitude=10.0,
        acceptance_radius=2.0,
        loss_time=p["failsafe_delay"],
        loss_action=FailsafeAction.HOLD,
        disarm_landed=0.0,
        disarm_preflight=0.0,
        battery_low=0.15,
        battery_critical=0.0,
        battery_action=FailsafeAction.HOLD,
        battery_compensated=False,
    )


BETAFLIGHT = Flavour(
    name="betaflight",
    autopilot=AutopilotId.GENERIC,
    sw_version=0,
    modes=dict.fromkeys(Mode, _ACRO),
    parameters={  # never on the wire: for scenarios alone
        "failsafe_delay": (REAL32, 1.5),  # s
        "hover": (REAL32, 0.33),
        "rate_max": (REAL32, 400.0),  # °/s at full stick, linear (ACTUAL rates, expo 0)
        "thrust_linear": (REAL32, 0.0),
    },
    settings=_settings,
    armable=frozenset({Mode.OFFBOARD}),
    stream_first=False,
    takeoff_mode=False,
    sticks=True,
    initial=Mode.OFFBOARD,
    hover_name="hover",
    system_name="",
    streams={
        "companion": {
            MessageId.HEARTBEAT: 10,
            MessageId.SYS_STATUS: 2,
            MessageId.GPS_RAW_INT: 10,
            MessageId.ATTITUDE: 50,
            MessageId.GLOBAL_POSITION_INT: 10,
        },
        "gcs": {
            MessageId.HEARTBEAT: 10,
            MessageId.SYS_STATUS: 2,
            MessageId.GPS_RAW_INT: 2,
            MessageId.ATTITUDE: 10,
            MessageId.GLOBAL_POSITION_INT: 2,
        },
    },
)
