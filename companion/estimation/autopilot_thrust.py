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

# MAV_LANDED_STATE; "taking off" is told while the motors spin up on the ground, too
_ON_GROUND, _IN_AIR = 1, 2
_CLIMBS = (0.3, 0.3)  # m above the ground, m/s: together they mean that the feet carry nothing


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
        self._climbed = False  # since it was last on the ground

    def reset(self) -> None:
        """Forget the place of the ground: the vehicle has started anew."""
        self._landed_state, self._ground, self._climbed = 0, None, False

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
        height, climb = float(own.p[2]), float(own.v[2])
        if not heartbeat.armed:
            self._ground = height
        if not heartbeat.armed or self._landed_state == _ON_GROUND:
            self._climbed = False
            return False
        if self._ground is not None:
            self._climbed |= height > self._ground + _CLIMBS[0] and climb > _CLIMBS[1]
        return self._climbed or self._landed_state == _IN_AIR
