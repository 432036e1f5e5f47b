"""Timestamps of signed frames, each rule at its last tick. Frames are made from the standard."""

import hashlib

import pytest

from mavlink_bridge.wire import signing
from mavlink_bridge.wire.signing import LAST, Check, Signing, timestamp_at

KEY, NOW = bytes(range(32)), 400_000_000_0000
SECOND, MINUTE = 100_000, 6_000_000
HEAD = bytes([0xFD, 0, 1, 0, 1, 1, 0, 0, 0, 0, 0, 0])  # of a frame without payload


def frame(timestamp, link_id=0, key=KEY):
    """A frame signed by mavlink.io/en/guide/message_signing: to the codec, its ids say nothing."""
    stamped = HEAD + bytes([link_id]) + timestamp.to_bytes(6, "little")
    return stamped + hashlib.sha256(key + stamped).digest()[:6]


def check(ours, timestamp, sender=(1, 1), link_id=0):
    return ours.check(frame(timestamp, link_id), *sender)


def may_be_new(ours, timestamp, sender=(1, 1), link_id=0):
    data = frame(timestamp, link_id)
    return ours.may_be_new(data + b"more", len(data), sender[0] << 8 | sender[1])


@pytest.mark.parametrize(
    ("unix", "timestamp"),
    [(1_420_070_400, 0), (1_420_070_401.5, 150_000), (1_420_070_400.000014, 1), (0.0, 0)],
)
def test_a_timestamp_counts_hundred_thousandths_of_a_second_since_2015(unix, timestamp):
    assert timestamp_at(unix) == timestamp


@pytest.mark.parametrize("size", [0, 31, 33])
def test_a_key_has_32_bytes(size):
    with pytest.raises(ValueError, match=f"a signing key has 32 bytes, got {size}"):
        Signing(bytes(size), NOW)


def test_a_clock_that_goes_back_is_ignored():
    ours = Signing(KEY, NOW)
    ours.advance(1_420_070_400 + NOW / SECOND + 2.0)
    assert ours.timestamp == NOW + 2 * SECOND
    ours.advance(1_420_070_400 + NOW / SECOND + 1.0)
    assert ours.timestamp == NOW + 2 * SECOND


def test_no_two_frames_have_one_timestamp_but_the_last_there_is():
    ours = Signing(KEY, LAST - 2)
    assert [ours.next() for _ in range(4)] == [LAST - 2, LAST - 1, LAST, LAST]


def test_a_signed_frame_is_the_frame_its_link_and_time_and_a_hash():
    ours = Signing(KEY, NOW, link_id=7)
    assert ours.signed(HEAD) == frame(NOW, 7)
    assert ours.signed(HEAD) == frame(NOW + 1, 7)


@pytest.mark.parametrize(("older", "found"), [(MINUTE, Check.OLD), (MINUTE - 1, Check.GOOD)])
def test_the_first_frame_of_a_stream_is_less_than_a_minute_old(older, found):
    ours = Signing(KEY, NOW)
    assert may_be_new(ours, NOW - older) is (found is Check.GOOD)
    assert check(ours, NOW - older) is found


def test_each_frame_of_a_stream_is_newer_than_the_last():
    ours = Signing(KEY, NOW)
    assert check(ours, NOW + 5) is Check.GOOD
    assert not may_be_new(ours, NOW + 5)
    assert not may_be_new(ours, NOW + 4)
    assert may_be_new(ours, NOW + 6)
    assert [check(ours, NOW + n) for n in (5, 4, 6)] == [Check.OLD, Check.OLD, Check.GOOD]


@pytest.mark.parametrize(("older", "found"), [(SECOND, Check.OLD), (SECOND - 1, Check.GOOD)])
@pytest.mark.parametrize("kept", [True, False])
def test_links_of_one_sender_are_less_than_a_second_apart(older, found, kept):
    """kept: what was heard is read from a file, after a restart."""
    if kept:
        ours = Signing(KEY, NOW, streams={(3, 1, 1): NOW + 50, (4, 1, 1): NOW + 20})
    else:
        ours = Signing(KEY, NOW)
        assert check(ours, NOW + 50, link_id=3) is Check.GOOD
        assert check(ours, NOW + 20, link_id=4) is Check.GOOD
    assert may_be_new(ours, NOW + 50 - older, link_id=5) is (found is Check.GOOD)
    assert check(ours, NOW + 50 - older, link_id=5) is found
    assert check(ours, NOW + 50 - older, sender=(1, 2)) is Check.GOOD
    assert check(ours, NOW + 50 - older, sender=(2, 1)) is Check.GOOD


def test_a_peer_whose_clock_is_ahead_accepts_the_next_frame():
    ours = Signing(KEY, NOW)
    assert check(ours, NOW + 500) is Check.GOOD
    assert ours.next() >= NOW + 500
    assert check(ours, NOW - 500, sender=(1, 2)) is Check.GOOD
    assert ours.next() > NOW + 500
    assert check(ours, LAST) is Check.GOOD
    assert ours.timestamp == LAST


@pytest.mark.parametrize("spoilt", range(-13, 0))
def test_a_frame_of_which_a_byte_was_changed_is_forged_and_moves_no_time(spoilt):
    ours, data = Signing(KEY, NOW), bytearray(frame(NOW + 500))
    data[spoilt] ^= 1
    assert not ours.preview(bytes(data), 1, 1)
    assert ours.check(bytes(data), 1, 1) is Check.FORGED
    assert (ours.timestamp, ours.streams) == (NOW, {})
    assert may_be_new(ours, NOW - 500)


def test_a_preview_holds_for_its_stream_alone_and_does_not_hide_the_frame():
    ours = Signing(KEY, NOW)
    assert ours.preview(frame(NOW + 5), 1, 1)
    assert not may_be_new(ours, NOW + 5)
    assert may_be_new(ours, NOW + 6)
    assert may_be_new(ours, NOW + 5, link_id=1)
    assert may_be_new(ours, NOW + 5, sender=(1, 2))
    assert may_be_new(ours, NOW + 5, sender=(2, 1))
    assert check(ours, NOW + 5) is Check.GOOD
    assert ours.streams == {(0, 1, 1): NOW + 5}


def test_of_too_many_streams_those_known_are_still_heard():
    ours = Signing(KEY, NOW)
    found = [check(ours, NOW, link_id=n) for n in range(33)]
    assert found == [Check.GOOD] * 32 + [Check.OLD]
    assert check(ours, NOW + 1, link_id=31) is Check.GOOD
    assert check(ours, NOW + 1, link_id=32) is Check.OLD


def test_what_this_end_has_sent_is_refused_and_what_another_sent_is_not():
    ours = Signing(KEY, NOW, own=(1, 191))
    sent = [ours.next() for _ in range(3)]
    for timestamp in sent:
        assert not may_be_new(ours, timestamp, sender=(1, 191), link_id=9)
        assert check(ours, timestamp, sender=(1, 191), link_id=9) is Check.OLD
    assert check(ours, sent[0], sender=(1, 192)) is Check.GOOD
    assert check(ours, NOW + 10, sender=(1, 191), link_id=9) is Check.GOOD  # by a second of us


@pytest.mark.parametrize(("later", "found"), [(0, Check.OLD), (1, Check.GOOD)])
def test_before_it_has_sent_anything_all_up_to_now_may_be_its_own(later, found):
    """It was sent before a restart."""
    ours = Signing(KEY, NOW, own=(1, 191))
    assert check(ours, NOW + later, sender=(1, 191)) is found
    ours = Signing(KEY, NOW, own=(1, 191))
    ours.next()
    assert check(ours, NOW - 1, sender=(1, 191)) is Check.OLD


def test_timestamps_of_sent_frames_are_remembered_for_a_minute(monkeypatch):
    ours = Signing(KEY, NOW, own=(1, 191))
    ours.next()
    ours.timestamp = NOW + 2 * SECOND
    ours.next()
    # Between the two nothing was sent by this end: another one of these ids has sent it.
    assert may_be_new(ours, NOW + SECOND, sender=(1, 191))
    ours.timestamp = NOW + MINUTE - 1
    ours.next()
    assert may_be_new(ours, NOW + SECOND, sender=(1, 191))
    ours.timestamp = NOW + 2 * SECOND + MINUTE
    ours.next()  # all that is a minute old may have been sent
    assert list(ours._sent) == [NOW + MINUTE - 1, NOW + 2 * SECOND + MINUTE]
    assert ours._sent_set == set(ours._sent)
    assert not may_be_new(ours, NOW + 2 * SECOND, sender=(1, 191), link_id=1)
    monkeypatch.setattr(signing, "_SENT", 3)
    for _ in range(3):
        ours.next()
    assert len(ours._sent) == len(ours._sent_set) == 3
    assert ours._sent_until == NOW + 2 * SECOND + MINUTE
