"""Mutated frames by the million: `python tests/fuzz/mutate.py --frames 1000000` (make fuzz).

Every frame is a valid one after damage: bits flipped, bytes changed, cut, doubled, spliced. With
signing, an accepted frame that differs from the frame sent is a forgery.
"""

import argparse
import resource
import sys
import time

import numpy as np

from mavlink_bridge.betaflight import msp
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Source
from mavlink_bridge.wire.signing import Signing

KEY = bytes(range(32))
NOW = 4_000_000_000_000


def mavlink_frames():
    """Return signed frames of a vehicle."""
    vehicle = Codec(1, 1, signing=Signing(KEY, NOW))
    messages = [
        m.Heartbeat(12, 2, True, 0x00060000, 4),
        m.Attitude(2.0, np.array([0.5, 0.5, -0.5, 0.5]), np.array([0.1, 0.2, 0.3])),
        m.LocalPosition(2.0, np.array([1.0, 2.0, 3.0]), np.array([0.5, -0.5, 0.25])),
        m.StatusText(4, "arming refused: no position"),
        m.SystemTime(12.5, 0.0),
        m.ParamValue("COM_OF_LOSS_T", 1.0, 9, 10, 3),
        m.CommandAck(400, 0, 1, 191),
    ]
    return [vehicle.encode([message]) for message in messages]


def msp_frames():
    """Return answers of a controller."""
    sizes = {msp.Msp.ATTITUDE: 6, msp.Msp.RAW_IMU: 18, msp.Msp.STATUS_EX: 25, msp.Msp.RAW_GPS: 16}
    return [b"$M>" + msp.encode(c, bytes(range(n)))[3:] for c, n in sizes.items()]


def mutate(frame, rng):
    """Return the frame after one to four kinds of damage; never the frame itself."""
    data = bytearray(frame)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(len(data))) if data else 0
        kind = rng.integers(5)
        if kind == 0 and data:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1 and data:
            data[at] = int(rng.integers(256))
        elif kind == 2:
            del data[at:]
        elif kind == 3:
            data[at:at] = data[: int(rng.integers(1, 40))]
        else:
            data[at:at] = rng.bytes(int(rng.integers(1, 20)))
    return bytes(data) if data != frame else bytes(frame[:-1])


def count_mavlink(count, seed):
    """Return forgeries accepted with signing, frames accepted without, and the longest buffer.

    Without signing, a frame that is damaged in its signature alone is accepted.
    """
    rng = np.random.default_rng([seed, 1])
    frames = mavlink_frames()
    signed = Codec(1, 191, allow=[Source(1, 1)], signing=Signing(KEY, NOW))
    plain, stream = (Codec(1, 191, allow=[Source(1, 1)]) for _ in range(2))
    forged = passed = longest = 0
    for n in range(count):
        true = frames[n % len(frames)]
        data = mutate(true, rng)
        whole = true in data  # a valid frame with bytes around it is no forgery
        forged += len(signed.decode_datagram(data)) * (not whole)
        passed += len(plain.decode_datagram(data)) * (not whole)
        stream.decode(data)  # as from a serial line: later bytes may complete a frame
        longest = max(longest, len(stream._buffer))
    return forged, passed, longest


def count_msp(count, seed):
    """Return accepted frames and the longest buffer; one in 256 passes MSP's one-byte XOR."""
    rng = np.random.default_rng([seed, 2])
    frames, decoder, passed, longest = msp_frames(), msp.MspDecoder(), 0, 0
    for n in range(count):
        true = frames[n % len(frames)]
        data = mutate(true, rng)
        passed += len(decoder.decode(data)) * (true not in data)
        longest = max(longest, len(decoder._buffer))
    return passed, longest


def main():
    """Print the counts; return 1 where a forgery was accepted or a buffer grew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    started, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    forged, passed, longest = count_mavlink(options.frames, options.seed)
    print(
        f"MAVLink: {options.frames} mutated frames, no exception, {forged} forgeries accepted "
        f"with signing, {passed} passed the checksum without; longest buffer {longest} B"
    )
    answers, longest_msp = count_msp(options.frames, options.seed)
    print(
        f"MSP: {options.frames} mutated frames, no exception, {answers} passed the one-byte "
        f"checksum; longest buffer {longest_msp} B"
    )
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3
    print(f"{time.monotonic() - started:.0f} s, memory {grown:+.1f} MB")
    bounded = longest <= 600 and longest_msp <= 300 and grown < 10
    return 0 if forged == 0 and bounded else 1


if __name__ == "__main__":
    sys.exit(main())
