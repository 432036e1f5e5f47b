"""A wire without sockets: two endpoints in one process, each hearing what the other sends."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator


class MemoryEndpoint:
    """One end. Bytes wait until they are received; without a peer nothing goes out."""

    def __init__(self, peer: MemoryEndpoint | None = None) -> None:
        """peer: the other end, which hears this one from now on, and is heard."""
        self._waiting: deque[bytes] = deque()
        self._peer = peer
        if peer is not None:
            peer._peer = self

    def receive(self) -> Iterator[bytes]:
        """Every packet that waits."""
        while self._waiting:
            yield self._waiting.popleft()

    def send(self, data: bytes) -> bool:
        """Hand a packet over; False where there is no peer."""
        if self._peer is None:
            return False
        self._peer._waiting.append(data)
        return True

    def fileno(self) -> int:
        """None to select() on: what was sent is there at once."""
        raise OSError("a memory endpoint has no file descriptor")

    def close(self) -> None:
        """Nothing is held."""
