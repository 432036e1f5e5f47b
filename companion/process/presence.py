"""This companion's own heartbeat, which tells it from another companion of the same vehicle.

A router may echo what a companion sends, and a recording may be played back. So the heartbeat
carries a number of this process in `custom_mode`, which MAVLink leaves to a component that is no
autopilot.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from companion.supervision.phases import COMPANION_HEARTBEAT
from mavlink_bridge.wire.messages import Heartbeat, Message, Received, Source


class Presence:
    """Marks the heartbeats that are sent, and recognises those of another companion."""

    def __init__(self, own: Source, number: int) -> None:
        """own: ids of this companion. number: of this process, 32 bits; no two have the same."""
        self._own = own
        self._number = number

    def marked(self, messages: Iterable[Message]) -> list[Message]:
        """Return the messages with this companion's number in its heartbeat."""
        return [
            replace(m, custom_mode=self._number) if m == COMPANION_HEARTBEAT else m
            for m in messages
        ]

    def another(self, received: Iterable[Received]) -> bool:
        """Return whether another companion with the same ids is heard."""
        return any(
            r.source == self._own
            and isinstance(r.message, Heartbeat)
            and r.message.custom_mode != self._number
            for r in received
        )
