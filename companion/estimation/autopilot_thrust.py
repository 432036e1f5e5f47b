"""The autopilot's thrust while it flies by itself, as its messages tell."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from mavlink_bridge.autopilots.registry import Identity
from mavlink_bridge.wire.messages import (
    AttitudeTarget,
    ExtendedSystemState,
    Message,
    VehicleState,
)

_IN_THE_AIR = (2, 3, 4)  # MAV_LANDED_STATE: in air, taking off, landing
_LIFTED = 0.3  # m above the ground, from which on the feet carry nothing


@dataclass(frozen=True)
class AutopilotThrust:
    """What the vehicle tells of its thrust at one tick.

    targets: (time [s], normalised thrust) of each ATTITUDE_TARGET since the tick before. hover,
    curve: the autopilot's own parameters, None where it has not told them. airborne: whether the
    motors carry the vehicle.
    """

    targets: tuple[tuple[float, float], ...] = ()
    hover: float | None = None
    curve: float | None = None
    airborne: bool = False


class AutopilotThrustReader:
    """Reads what one vehicle tells of its thrust."""

    def __init__(self, identity: Identity) -> None:
        """identity: knows heartbeat and parameters."""
        self._identity = identity
        self._landed_state = 0  # not told
        self._ground: float | None = None

    def reset(self) -> None:
        """Forget the place of the ground: the vehicle has started anew."""
        self._landed_state, self._ground = 0, None

    def read(self, messages: Iterable[Message], own: VehicleState | None) -> AutopilotThrust:
        """Return what the messages of one tick tell; own: the state now."""
        targets = []
        for m in messages:
            if isinstance(m, AttitudeTarget) and math.isfinite(m.thrust):
                targets.append((m.time, m.thrust))
            elif isinstance(m, ExtendedSystemState):
                self._landed_state = m.landed_state
        return AutopilotThrust(
            tuple(targets),
            self._identity.hover_thrust,
            self._identity.thrust_curve,
            self._airborne(own),
        )

    def _airborne(self, own: VehicleState | None) -> bool:
        """Return whether the vehicle flies: off the ground, as far as either tells."""
        heartbeat = self._identity.heartbeat
        if own is None or heartbeat is None:
            return False
        if not heartbeat.armed:
            self._ground = float(own.p[2])
            return False
        told = self._landed_state in _IN_THE_AIR
        if self._ground is None:
            return told
        lifted = float(own.p[2]) > self._ground + _LIFTED
        return lifted and (told or not self._landed_state)
