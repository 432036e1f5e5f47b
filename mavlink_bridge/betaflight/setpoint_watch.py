"""Setpoints of the companion, and how long they have been missing."""

from __future__ import annotations

import math
from enum import Enum

from mavlink_bridge.wire.messages import RateSetpoint


class Silence(Enum):
    """How long no setpoint has come, and what the bridge does about it."""

    NONE = "fly it"
    SHORT = "level, until the next one comes"
    LONG = "the companion is gone"


class SetpointWatch:
    """The newest setpoint; short, long: silences [s] after which the sticks go level, and for good.

    A companion that is held up for a moment flies on, as with PX4 (COM_OF_LOSS_T) and ArduCopter
    (GUID_TIMEOUT); its last rates are not kept up that long.
    """

    def __init__(self, short: float, long: float) -> None:
        self._short, self._long = short, long
        self.newest: RateSetpoint | None = None
        self.at = -math.inf

    def take(self, time: float, setpoint: RateSetpoint) -> None:
        """Take a setpoint that came at `time` [s]."""
        self.newest, self.at = setpoint, time

    def silence(self, time: float) -> Silence:
        """Return how long none has come."""
        since = time - self.at
        if since <= self._short:
            return Silence.NONE
        return Silence.SHORT if since <= self._long else Silence.LONG
