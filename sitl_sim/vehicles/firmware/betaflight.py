"""The emulated Betaflight: MAVLink telemetry with its quirks, and RC channels to fly it.

As 2025.12 sends it: no LOCAL_POSITION_NED, no parameters, no commands, no setpoints. What its
messages do wrong is in `betaflight_quirks.py`, its sticks in `sticks.py`.
"""

from __future__ import annotations

from collections.abc import Mapping

from sitl_sim.vehicles.firmware.flavour import REAL32, Flavour, Loss, Mode, Settings


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
        loss_action=Loss.HOLD,
        loss_action_time=0.0,
        disarm_landed=0.0,
        disarm_preflight=0.0,
        battery_low=0.15,
        battery_critical=0.0,
        battery_action=Loss.HOLD,
        battery_compensated=False,
    )


BETAFLIGHT = Flavour(
    name="betaflight",
    autopilot=0,  # GENERIC
    sw_version=0,
    modes=dict.fromkeys(Mode, 1),  # acro, whatever it does
    parameters={  # not on the wire: for the scenario
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
        "companion": {0: 10, 1: 2, 24: 10, 30: 50, 33: 10},
        "gcs": {0: 10, 1: 2, 24: 2, 30: 10, 33: 2},
    },
)
