"""Delays after which the bridge acts by itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BridgeTimes:
    """Delays of the bridge [s].

    setpoint: silence after which the sticks go level. lost: silence that ends offboard; a companion
    that is back sooner flies on. release: from the last setpoint to the last RC frame where
    a pilot has a receiver; Betaflight holds that frame for 0.3 s more. land: from the last setpoint
    to landing where there is no pilot. arm: wait for the controller to arm. settle: no take-off so
    soon after arming, when Betaflight zeroes its height. silent: without answers the controller
    counts as lost. fix: validity of a position after its fix. heartbeat, target: intervals
    of HEARTBEAT and ATTITUDE_TARGET.
    """

    setpoint: float = 0.2
    lost: float = 1.0
    release: float = 0.3
    land: float = 5.0
    arm: float = 1.5
    settle: float = 1.0
    silent: float = 0.5
    fix: float = 1.0
    heartbeat: float = 0.5
    target: float = 0.05
