"""A codec remembers frames and senders, up to its bounds."""

import numpy as np
import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Heartbeat, RateSetpoint, Source

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
BEAT = Heartbeat(12, 2, False, 0, 3)


def attitudes(count, codec=None, first=0.0):
    """Frames of attitudes, a second apart."""
    codec = codec or Codec(1, 1)
    return [codec.encode([Attitude(first + n, LEVEL, np.zeros(3))]) for n in range(count)]


@pytest.mark.parametrize(("others", "again"), [(127, 0), (128, 1)])
def test_a_copy_of_one_of_the_newest_128_frames_tells_nothing(others, again):
    codec, frames = Codec(1, 191), attitudes(129)
    assert len(codec.decode_datagram(frames[0])) == 1
    for frame in frames[1 : 1 + others]:
        assert len(codec.decode_datagram(frame)) == 1
    assert len(codec.decode_datagram(frames[0])) == again
    assert codec.statistics.received == others + 2


def test_a_copy_of_what_has_no_time_is_heard_each_time():
    codec, frame = Codec(1, 191), Codec(1, 1).encode([BEAT])
    heard = [codec.decode_datagram(frame) for _ in range(3)]
    assert [len(h) for h in heard] == [1, 1, 1]
    assert heard[0][0].message is heard[2][0].message


def test_of_many_frames_the_newest_are_read_and_all_are_counted():
    codec, other = Codec(1, 191), Codec(1, 1)
    frames = attitudes(4, other)
    data = b"".join([frames[0], frames[1], other.encode([BEAT]), frames[2], frames[3]])
    # The numbers of the frames are 0, 1, 4, 2, 3: the heartbeat came early.
    heard = codec.read(codec.frames(data), most=2)
    assert [r.message.time for r in heard] == [2.0, 3.0]
    assert codec.statistics.received == 5
    assert sum(r.unread for r in heard) == 3
    assert codec.read(codec.frames(attitudes(1, first=9.0)[0]), most=0) == []
    assert len(codec.read(codec.frames(attitudes(1, first=11.0)[0]), most=5)) == 1


def test_losses_are_counted_for_64_senders():
    codec = Codec(1, 191)
    senders = [(system, component) for system in (1, 2) for component in range(1, 34)]
    missing = []
    for sender in senders:
        own = Codec(*sender)
        first, _, third = (own.encode([BEAT]) for _ in range(3))
        codec.decode_datagram(first)
        (heard,) = codec.decode_datagram(third)
        missing.append(heard.missing)
    assert missing == [1] * 64 + [0] * 2


@pytest.mark.parametrize("system", [0, 256, -1])
def test_a_system_id_is_one_byte_and_not_zero(system):
    with pytest.raises(ValueError, match=f"MAVLink system id must be 1…255, got {system}"):
        Codec(system, 1)


def test_numbers_of_frames_go_round():
    codec, heard = Codec(1, 1), []
    for n in range(300):
        (frame,) = Codec(1, 191).frames(codec.encode([BEAT]))
        heard.append(frame.sequence)
        assert codec.statistics.sent == n + 1
    assert heard == [n % 256 for n in range(300)]


def test_a_cut_frame_is_forgotten_and_counted():
    frame = attitudes(1)[0]
    codec = Codec(1, 191)
    assert codec.decode(frame[:20]) == []
    codec.restart()
    assert codec.statistics.bad_bytes == 20
    assert codec.decode(frame[20:]) == []
    assert len(codec.decode(frame)) == 1


def test_allowed_senders_by_system_or_by_component():
    codec = Codec(1, 191, [Source(3, 0), Source(4, 7)])
    heard = {
        (system, component)
        for system in (2, 3, 4, 5)
        for component in (0, 1, 6, 7, 8, 255)
        if codec.decode_datagram(Codec(system, component).encode([BEAT]))
    }
    assert heard == {(3, c) for c in (0, 1, 6, 7, 8, 255)} | {(4, 7)}
    assert codec.statistics.foreign == 17
    nobody = Codec(1, 191, [])
    assert nobody.decode_datagram(Codec(1, 1).encode([BEAT])) == []


def test_what_is_sent_is_signed_only_with_a_key():
    frame = Codec(1, 191).encode([RateSetpoint(0.0, np.zeros(3), 0.3, 1)])
    assert frame[2] == 0
    assert not Codec(1, 191).signs
