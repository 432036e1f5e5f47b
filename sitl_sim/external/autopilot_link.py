"""The simulator's end of one MAVLink link of a real autopilot: whole packets, not altered."""

from __future__ import annotations

import select

from mavlink_bridge.wire.udp import Address, UdpEndpoint


class AutopilotLink:
    """Packets between an autopilot and those whom the simulator passes them on to.

    speaks_to: address on which the autopilot listens; None: the autopilot speaks first, to `port`.
    """

    def __init__(self, speaks_to: Address | None = None) -> None:
        self._endpoint = UdpEndpoint(local=("127.0.0.1", 0), remote=speaks_to)
        self._claims = speaks_to is not None
        self.heard = False

    @property
    def port(self) -> int:
        """The local UDP port."""
        return self._endpoint.port

    def receive(self) -> list[bytes]:
        """Return the packets that have arrived, oldest first."""
        packets = list(self._endpoint.receive())
        if packets:
            self.heard = True
            self._endpoint.answer_sender()
        elif self._claims and not self.heard:
            self._endpoint.send(b"\0")  # PX4 answers the first sender instead of its fixed port
        return packets

    def send(self, data: bytes) -> None:
        """Pass a packet to the autopilot."""
        self._endpoint.send(data)

    def wait(self, timeout: float) -> None:
        """Block until a packet arrives or `timeout` [s] has passed."""
        select.select([self._endpoint.fileno()], [], [], timeout)

    def close(self) -> None:
        """Close the port."""
        self._endpoint.close()
