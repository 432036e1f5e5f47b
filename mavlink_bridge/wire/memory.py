"""Two connected endpoints in one process, without sockets."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator


class MemoryEndpoint:
    """One end: packets wait until they are received; without a peer none is sent."""

    def __init__(self, peer: MemoryEndpoint | None = None) -> None:
        """Connect to `peer`, the other end, in both directions."""
        self._waiting: deque[bytes] = deque()
        self._peer = peer
        if peer is not None:
            peer._peer = self

    def receive(self) -> Iterator[bytes]:
        """Yield the packets that have arrived."""
        while self._waiting:
            yield self._waiting.popleft()

    def send(self, data: bytes) -> bool:
        """Pass a packet to the peer; return False where there is none."""
        if self._peer is None:
            return False
        self._peer._waiting.append(data)
        return True

    def fileno(self) -> int:
        """Raise OSError: there is no descriptor, and packets arrive at once."""
        raise OSError("a memory endpoint has no file descriptor")

    def close(self) -> None:
        """Do nothing: no resource is held."""
