"""What a booting autopilot says of itself on a MAVLink link: armed, located, fit to be armed."""

from __future__ import annotations

import numpy as np

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import CommandId, MessageId
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    Heartbeat,
    LocalPosition,
    Message,
    StatusText,
    SystemStatus,
)
from sitl_sim.external.autopilot_link import AutopilotLink

_ARMABLE = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
_WATCHED = {MessageId.SYS_STATUS: 5.0, MessageId.LOCAL_POSITION_NED: 5.0}  # Hz
_ASK = 1.0  # s between two requests for what is watched
_WORDS = 3  # texts that are kept


class Readiness:
    """What one autopilot said last; system: its id."""

    def __init__(self, system: int) -> None:
        self.armed = self.armable = self.located = False
        self.words: list[str] = []  # the last ones, newest last
        self.stamp = 0.0  # s, its clock, of its newest attitude
        self.gap = 1.0  # s between its last two attitudes
        self._system = system
        self._codec = Codec(255, 190)
        self._decoder = Codec(255, 190)
        self._asked = -_ASK

    def ask(self, now: float, link: AutopilotLink) -> None:
        """Ask for what is watched, once a second of `now` [s]; ArduPilot sends nothing unasked."""
        if link.heard and now - self._asked >= _ASK:
            self._asked = now
            link.send(self._codec.encode(self._requests()))

    def _requests(self) -> list[Message]:
        rest = (0.0, 0.0, 0.0, 0.0, 0.0)
        return [
            Command(
                int(CommandId.SET_MESSAGE_INTERVAL),
                (float(message), 1e6 / rate, *rest),
                self._system,
            )
            for message, rate in _WATCHED.items()
        ]

    def hear(self, packet: bytes) -> None:
        """Read a packet of the autopilot."""
        for received in self._decoder.decode_datagram(packet):
            message = received.message
            if isinstance(message, Heartbeat) and received.source.component == 1:
                self.armed = message.armed
            elif isinstance(message, Attitude):
                if message.time > self.stamp:
                    self.gap, self.stamp = message.time - self.stamp, message.time
            elif isinstance(message, SystemStatus):
                self.armable = bool(message.health & _ARMABLE)
            elif isinstance(message, LocalPosition):
                self.located |= bool(np.isfinite(message.p).all())
            elif isinstance(message, StatusText):
                self.words = [*self.words, message.text][-_WORDS:]
