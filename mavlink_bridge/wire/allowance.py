"""How much of what arrives is read in one tick, so that a flood costs a bounded time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from mavlink_bridge.wire.udp import Address

_READ_PACKETS = 2048  # most packets read in one tick; a vehicle sends about 25
_READ_BYTES = 4 << 20  # most bytes read in one tick
_KEPT_PACKETS, _KEPT_BYTES = 256, 32 << 10  # most that are decoded; a vehicle sends about 10 kB
_MESSAGES = 300  # most messages made of them
_SHARE_OF_STRANGERS = 8  # other addresses than the vehicle's have one eighth of it
_DOUBTFUL_PACKETS, _DOUBTFUL_BYTES = 32, 8 << 10  # that do not begin with an accepted frame


class Claim(IntEnum):
    """Kind of a packet's first frame."""

    ACCEPTED = 0  # its checksum is right, and with signing its signature
    GARBAGE = 1  # not whole, or with a wrong checksum
    FOREIGN = 2  # of a sender that is not heard
    UNSIGNED = 3  # not signed with the key
    OLD = 4  # signed, and not new


ACCEPTED, GARBAGE, FOREIGN, UNSIGNED, OLD = Claim  # found faster than an attribute of the class


class Packet(NamedTuple):
    """A packet that has arrived; number: of its arrival. place: its address, None: not known.

    arrived: s, CLOCK_MONOTONIC; None: when it was read, which nobody noted.
    """

    number: int
    data: bytes
    place: Address | None
    claim: Claim
    arrived: float | None = None


@dataclass
class Allowance:
    """What may still be read in this tick. messages, of_strangers: messages yet to be made."""

    packets: int = _READ_PACKETS
    bytes: int = _READ_BYTES
    messages: int = _MESSAGES
    of_strangers: int = _MESSAGES // _SHARE_OF_STRANGERS
    doubtful_packets: int = _DOUBTFUL_PACKETS
    doubtful_bytes: int = _DOUBTFUL_BYTES

    @property
    def spent(self) -> bool:
        """Whether no more is to be read."""
        return self.packets <= 0 or self.bytes <= 0 or self.messages <= 0

    def take_doubtful(self, size: int) -> bool:
        """Return whether a packet that does not begin with an accepted frame is looked through.

        One of its frames may be good. On a line that flips bits such packets are few; an
        attacker's are many, and cost no more than these few.
        """
        if self.doubtful_packets <= 0 or self.doubtful_bytes <= 0:
            return False
        self.doubtful_packets -= 1
        self.doubtful_bytes -= size
        return True


@dataclass
class Newest:
    """The newest packets within a number and a size.

    by_address: of too many it is not the oldest that goes, but the oldest of the address that sent
    most: one that floods starves itself.
    """

    share: int = 1  # has one in so many of what is decoded
    by_address: bool = False
    packets: deque[Packet] = field(default_factory=deque)
    _size: int = 0

    @classmethod
    def of_strangers(cls) -> Newest:
        """Keep packets of other addresses than the vehicle's."""
        return cls(_SHARE_OF_STRANGERS, by_address=True)

    def add(self, packet: Packet) -> list[Packet]:
        """Keep a packet; return those that are too many with it."""
        self.packets.append(packet)
        self._size += len(packet.data)
        dropped = []
        while len(self.packets) > 1 and (
            len(self.packets) > _KEPT_PACKETS // self.share
            or self._size > _KEPT_BYTES // self.share
        ):
            index = self._oldest_of_the_loudest() if self.by_address else 0
            dropped.append(self.packets[index])
            self._size -= len(dropped[-1].data)
            del self.packets[index]
        return dropped

    def _oldest_of_the_loudest(self) -> int:
        """Return the index of the oldest packet of the address from which most bytes are kept."""
        sizes: dict[Address | None, int] = {}
        for packet in self.packets:
            sizes[packet.place] = sizes.get(packet.place, 0) + len(packet.data)
        loudest = max(sizes, key=lambda place: sizes[place])
        return next(n for n, packet in enumerate(self.packets) if packet.place == loudest)
