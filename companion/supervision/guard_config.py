"""The guard's bounds and thresholds, each with its reason."""

from __future__ import annotations

import itertools
from typing import Self

from pydantic import Field, model_validator

from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.settings import Contradiction, StrictModel

# s that shifted plans and braking may last before the watchdog takes the companion for dead
FALLBACK_MAX = 2.5


class GuardConfig(StrictModel):
    """Bounds and thresholds."""

    omega_max: float = Field(3.0, ge=0.5, description="Highest body rate [rad/s], each axis.")
    c_min: float = Field(2.0, ge=0, lt=GRAVITY, description="Least collective acceleration [m/s²].")
    c_max: float = Field(20.0, gt=GRAVITY, description="Most collective acceleration [m/s²].")
    shifted_max: int = Field(
        2, ge=0, description="Ticks that a shifted plan may fly: the third bad solve brakes."
    )
    bad_land: float = Field(
        2.0,
        gt=0,
        lt=FALLBACK_MAX,
        description="Time [s] without a usable plan after which LAND is requested: a solver that "
        "has failed for so long does not recover.",
    )
    stale_predict: float = Field(
        0.15,
        gt=0,
        description="Age [s] of telemetry from which the model predicts the state. At 50 Hz: 7 "
        "samples lost.",
    )
    stale_stop: float = Field(
        0.3,
        gt=0,
        description="Age [s] of telemetry from which there is no state: stop turning, request "
        "HOLD. The drone flies 0.5 m meanwhile.",
    )
    stale_land: float = Field(
        1.0, gt=0, description="Age [s] of telemetry from which LAND is requested."
    )
    stale_silent: float = Field(
        2.0,
        gt=0,
        description="Age [s] of telemetry from which no setpoint is sent: the autopilot's own "
        "failsafe lands the drone.",
    )
    fence_land: float = Field(
        1.0,
        ge=0,
        description="Distance [m] outside the fence beyond which LAND is requested; the drone "
        "stops within 1 m more.",
    )
    fence_drift: float = Field(
        0.2,
        ge=0,
        description="Outward speed [m/s] outside the fence up to which the plan flies: it leads "
        "back.",
    )
    blind_speed: float = Field(
        0.4, gt=0, description="Highest speed [m/s] while the camera has a fault."
    )
    blind_hover: float = Field(
        1.4, gt=0, description="Time [s] of a camera fault after which the drone brakes and hovers."
    )
    blind_hold: float = Field(
        5.0,
        gt=0,
        description="Time [s] of a camera fault after which HOLD is requested: the guard's braking "
        "drifts, the autopilot's hold does not.",
    )
    hold_doubt: float = Field(
        0.4,
        gt=0,
        description="1 σ [m] of the autopilot's position from which LAND is requested instead of "
        "HOLD: a drone that is held by such a position drifts into what it kept clear of.",
    )
    late: float = Field(
        0.15,
        gt=0,
        description="Time [s] for which a command may be in force. Twice in a row longer is late: "
        "body rates meant for 0.1 s turn the drone too far in 0.2 s.",
    )
    lossy: float = Field(
        0.05,
        gt=0,
        le=1,
        description="Share of telemetry lost in a second above which each setpoint and request is "
        "sent three times. Where half of all packets are lost, a setpoint is then held for 0.5 s "
        "every 7 minutes, not every 2 s.",
    )
    lost: float = Field(
        0.4,
        gt=0,
        le=1,
        description="Share of telemetry lost in a second above which HOLD is requested after "
        "`lost_hold`; below half of it that is over.",
    )
    lost_hold: float = Field(
        1.0, gt=0, description="Time [s] of such a loss after which HOLD is requested."
    )
    brake_gain: float = Field(4.5, gt=0, description="Deceleration per speed [1/s].")
    brake_max: float = Field(6.0, gt=0, description="Most horizontal deceleration [m/s²]: 31°.")
    attitude_gain: float = Field(
        6.0,
        gt=0,
        description="Body rate per attitude error [1/s]: most of it is gone when the next command "
        "acts, and a delay that is known wrongly by 60 ms makes no swing.",
    )

    @model_validator(mode="after")
    def _check_ages(self) -> Self:
        """Refuse ages of which a stronger reaction comes before a milder one."""
        names = ("stale_predict", "stale_stop", "stale_land", "stale_silent")
        for mild, strong in itertools.pairwise(names):
            before, after = getattr(self, mild), getattr(self, strong)
            if not before < after:
                text = f"{strong}, {after:g}, must be above {mild}, {before:g}"
                raise Contradiction((strong, mild), text)
        return self
