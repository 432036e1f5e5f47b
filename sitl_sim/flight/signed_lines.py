"""MAVLink 2 signing of the emulated autopilots, as PX4 and ArduPilot do it with a key.

Every frame is signed on every link, and one that is unsigned, signed with another key or not new is
refused. Sources: https://docs.px4.io/main/en/mavlink/message_signing,
https://mavlink.io/en/guide/message_signing.html. What both autopilots accept unsigned (status of
radios, other aircraft) is nothing that commands a vehicle, and is refused here, too.
"""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime

from mavlink_bridge.wire.signing import Signing, Stream, timestamp_at


def key_of(seed: int) -> bytes:
    """Return the 32 bytes of a simulated flight's key: whoever knows the seed knows the key."""
    return hashlib.sha256(f"swarm-companion, simulated, seed {seed}".encode()).digest()


class VehicleSigning:
    """Key and timestamps of one autopilot, on its two links.

    Both links share the newest timestamp of each stream, as in ArduPilot: what was recorded on one
    cannot be played on the other.
    """

    def __init__(self, key: bytes) -> None:
        """Start from the present."""
        streams: dict[Stream, int] = {}
        now = timestamp_at(_now())
        self.companion = Signing(key, now, link_id=0, streams=streams)
        self.ground = Signing(key, now, link_id=1, streams=streams)

    def advance(self) -> None:
        """Set the time to the present: companions and ground stations sign by the wall clock."""
        for link in (self.companion, self.ground):
            link.advance(_now())


def _now() -> float:
    return datetime.now(UTC).timestamp()
