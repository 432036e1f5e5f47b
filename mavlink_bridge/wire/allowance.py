"""How much of what arrives is read in one tick, so that a flood costs a bounded time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from mavlink_bridge.wire.udp import Address

_READ_PACKETS = 2048  # most packets read in one tick; a vehicle sends about 25
_READ_BYTES = 4 << 20  # most bytes read in one tick
_KEPT_PACKETS, _KEPT_BYTES = 256, 64 << 10  # most that are decoded; a vehicle sends about 10 kB
_MESSAGES = 300  # most messages made of them
_SHARE_OF_STRANGERS = 8  # other addresses than the vehicle's have one eighth of it


@dataclass
class Allowance:
    """What may still be read in this tick. messages, of_strangers: messages yet to be made."""

    packets: int = _READ_PACKETS
    bytes: int = _READ_BYTES
    messages: int = _MESSAGES
    of_strangers: int = _MESSAGES // _SHARE_OF_STRANGERS

    @property
    def spent(self) -> bool:
        """Whether no more is to be read."""
        return self.packets <= 0 or self.bytes <= 0 or self.messages <= 0

    def take(self, size: int) -> None:
        """Count one packet of `size` bytes."""
        self.packets -= 1
        self.bytes -= size


@dataclass
class Newest:
    """The newest packets, with their addresses, within a number and a size.

    dropped: bytes of the older ones. strange: they come from another address than the vehicle's,
    and are fewer.
    """

    strange: bool = False
    dropped: int = 0
    packets: deque[tuple[bytes, Address | None]] = field(default_factory=deque)
    _size: int = 0

    def add(self, packet: bytes, place: Address | None) -> None:
        """Keep a packet from `place`, and drop the oldest where that is too much.

        Of strangers it is the oldest of the address that sent most: one that floods starves itself.
        """
        share = _SHARE_OF_STRANGERS if self.strange else 1
        self.packets.append((packet, place))
        self._size += len(packet)
        while len(self.packets) > 1 and (
            len(self.packets) > _KEPT_PACKETS // share or self._size > _KEPT_BYTES // share
        ):
            index = self._oldest_of_the_loudest() if self.strange else 0
            old = len(self.packets[index][0])
            del self.packets[index]
            self._size -= old
            self.dropped += old

    def _oldest_of_the_loudest(self) -> int:
        """Return the index of the oldest packet of the address from which most bytes are kept."""
        sizes: dict[Address | None, int] = {}
        for packet, place in self.packets:
            sizes[place] = sizes.get(place, 0) + len(packet)
        loudest = max(sizes, key=lambda place: sizes[place])
        return next(n for n, (_, place) in enumerate(self.packets) if place == loudest)
