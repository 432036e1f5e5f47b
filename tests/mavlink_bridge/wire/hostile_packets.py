"""Packets of a hostile line, made from the standard, and those who send and hear them."""

import contextlib
import hashlib
import socket
import struct

from companion.settings.sections import LinkConfig
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Source
from mavlink_bridge.wire.signing import Signing
from mavlink_bridge.wire.udp import UdpEndpoint

KEY, NOW = bytes(range(32)), 400_000_000_0000
ME, VEHICLE = Source(1, 191), Source(1, 1)


def crc(data):
    """CRC-16/MCRF4XX, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
    return value


def heartbeat(source, stamp=None, link_id=0, sequence=0, custom_mode=0, key=KEY):
    """Return a HEARTBEAT by mavlink.io/en/guide/serialization and message_signing."""
    payload = struct.pack("<IBBBBB", custom_mode, 2, 12, 0x81, 4, 3)
    flags = 0 if stamp is None else 1
    head = bytes([9, flags, 0, sequence, source.system, source.component, 0, 0, 0])
    frame = b"\xfd" + head + payload + struct.pack("<H", crc(head + payload + bytes([50])))
    if stamp is None:
        return frame
    frame += bytes([link_id]) + stamp.to_bytes(6, "little")
    return frame + hashlib.sha256(key + frame).digest()[:6]


def flipped(frame):
    changed = bytearray(frame)
    changed[12] ^= 0x10
    return bytes(changed)


def signed_codec(at=NOW, link_id=0):
    config = LinkConfig(system_id=1, component_id=191)
    return Codec(1, 191, config.heard(), Signing(KEY, at, link_id))


def sources(codec, data):
    return [r.source for r in codec.decode_datagram(data)]


@contextlib.contextmanager
def companion_and_senders():
    """Yield a companion's link that knows its vehicle, and five senders."""
    codec = Codec(1, 191, [VEHICLE, ME, Source(255, 190)])
    ours = Link(UdpEndpoint(local=("127.0.0.1", 0)), codec, VEHICLE)
    senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(5)]
    for s in senders:
        s.connect(("127.0.0.1", ours.endpoint.port))
        s.settimeout(1.0)
    try:
        yield ours, senders
    finally:
        for end in (ours, *senders):
            end.close()


def received(link):
    """All that waits; loopback delivers at once."""
    return [r.source for _ in range(2) for r in link.receive()]
