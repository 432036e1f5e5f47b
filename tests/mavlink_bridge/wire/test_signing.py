"""Accepted senders: the allow-list, and signatures that cannot be forged, replayed or omitted."""

import hashlib

import numpy as np
import pytest

from companion.process.signing_keys import (
    SigningKeyError,
    Timestamps,
    find_key,
    open_signing,
    read_key,
)
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Heartbeat, Source
from mavlink_bridge.wire.signing import EPOCH, TICKS, Check, Signing

KEY, OTHER = bytes(range(32)), bytes(32)
NOW = 400_000_000_0000
FRAMES = 10_000
HEARTBEAT = Heartbeat(12, 2, True, 0x00060000, 4)


def vehicle(system=1, component=1, key=KEY, at=NOW):
    return Codec(system, component, signing=None if key is None else Signing(key, at))


def companion(**options):
    return Codec(1, 191, allow=[Source(1, 1)], signing=Signing(KEY, NOW), **options)


def test_signed_frames_pass_both_ways():
    ours, theirs = companion(), vehicle()
    sent = [Attitude(1.0, np.array([1.0, 0, 0, 0]), np.zeros(3)), HEARTBEAT]
    received = ours.decode_datagram(theirs.encode(sent))
    assert [type(r.message) for r in received] == [Attitude, Heartbeat]
    assert len(theirs.decode_datagram(ours.encode([HEARTBEAT]))) == 1


@pytest.mark.row("11")
def test_no_forged_frame_of_ten_thousand_is_accepted(note):
    """Unsigned, signed by others, replayed, changed, from the past, foreign."""
    rng = np.random.default_rng(5)
    true = vehicle()
    recorded = true.encode([HEARTBEAT])
    ours = companion()
    assert len(ours.decode_datagram(recorded)) == 1
    unsigned, forger = vehicle(key=None), vehicle(key=OTHER)
    past, future = vehicle(at=NOW - 61 * TICKS), vehicle(key=OTHER, at=NOW + 10**9)
    stranger = vehicle(system=7)
    makers = [
        lambda: unsigned.encode([HEARTBEAT]),
        lambda: forger.encode([HEARTBEAT]),
        lambda: recorded,
        lambda: changed(true.encode([HEARTBEAT]), rng),
        lambda: past.encode([HEARTBEAT]),
        lambda: future.encode([HEARTBEAT]),
        lambda: stranger.encode([HEARTBEAT]),
        lambda: Codec(int(rng.integers(2, 256)), 1).encode([HEARTBEAT]),
    ]
    accepted = sum(len(ours.decode_datagram(makers[n % len(makers)]())) for n in range(FRAMES))
    assert accepted == 0
    assert len(ours.decode_datagram(true.encode([HEARTBEAT]))) == 1  # a true frame still is
    s = ours.statistics
    assert s.foreign + s.unsigned + s.replayed + s.bad_frames + s.unknown >= FRAMES * 0.99
    note(f"accepted of {FRAMES}", accepted)


def changed(frame, rng):
    """Return the frame with one changed byte."""
    data = bytearray(frame)
    data[int(rng.integers(10, len(data)))] ^= int(rng.integers(1, 256))
    return bytes(data)


def test_a_forged_frame_from_the_future_does_not_silence_the_true_one():
    """Pymavlink stores a frame's timestamp before it checks the signature."""
    ours, true = companion(), vehicle()
    assert ours.decode_datagram(true.encode([HEARTBEAT]))
    forged = bytearray(true.encode([HEARTBEAT]))
    forged[-12:-6] = b"\xff" * 6
    assert not ours.decode_datagram(bytes(forged))
    assert ours.decode_datagram(true.encode([HEARTBEAT]))


def test_the_number_of_streams_is_bounded():
    signing = Signing(KEY, NOW)
    for link in range(256):
        other = Signing(KEY, NOW + 1, link_id=link)
        frame = Codec(1, 1, signing=other).encode([HEARTBEAT])
        signing.check(frame, 1, 1)
    assert len(signing.streams) == 32


def test_frames_of_other_senders_are_dropped():
    ours = Codec(1, 191, allow=[Source(1, 1), Source(9, 0)])
    assert not ours.decode_datagram(Codec(2, 1).encode([HEARTBEAT]))
    assert ours.statistics.foreign == 1
    assert ours.decode_datagram(Codec(9, 77).encode([HEARTBEAT]))


def test_only_the_service_may_read_the_key(tmp_path):
    file = tmp_path / "key"
    file.write_text(KEY.hex() + "\n")
    file.chmod(0o640)
    with pytest.raises(SigningKeyError, match=r"others can read it too \(mode 640\); chmod 600"):
        read_key(file)
    file.chmod(0o600)
    assert read_key(file) == KEY
    file.write_bytes(KEY)
    assert read_key(file) == KEY
    file.write_text("abc")
    with pytest.raises(SigningKeyError, match="openssl rand -hex 32"):
        read_key(file)
    with pytest.raises(SigningKeyError, match="No such file"):
        read_key(tmp_path / "none")
    assert find_key("key", {"CREDENTIALS_DIRECTORY": str(tmp_path)}) == file
    assert find_key("key", {}).name == "key"


def test_a_credential_may_have_the_mode_of_its_acl(tmp_path, monkeypatch):
    """With DynamicUser systemd grants access by an ACL, which shows as mode 440."""
    file = tmp_path / "key"
    file.write_text(KEY.hex())
    file.chmod(0o440)
    with pytest.raises(SigningKeyError, match="others can read it too"):
        open_signing("one", str(file), 0)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    assert open_signing("one", "key", 0).signing.key == KEY
    file.chmod(0o444)
    with pytest.raises(SigningKeyError, match="others can read it too"):
        open_signing("one", "key", 0)


def test_timestamps_continue_after_a_restart(tmp_path):
    file = tmp_path / "signing.json"
    first = Timestamps(KEY, 0, file)
    start = first.signing.timestamp
    assert abs(start / TICKS + EPOCH - 1.8e9) < 1e9  # this decade
    recorded = Codec(1, 1, signing=Signing(KEY, start)).encode([HEARTBEAT])
    assert first.signing.check(recorded, 1, 1) is Check.GOOD
    first.signing.timestamp += 3600 * TICKS  # a peer's clock was ahead
    first.save()
    again = Timestamps(KEY, 0, file)
    assert again.signing.timestamp > first.signing.timestamp
    assert again.signing.check(recorded, 1, 1) is Check.OLD
    file.write_text("{")
    assert abs(Timestamps(KEY, 0, file).signing.timestamp - start) < 60 * TICKS


def test_timestamps_grow_with_a_clock_that_was_never_set(tmp_path, monkeypatch):
    """A board without a clock battery starts in 1970; timestamps begin in 2015."""
    now = 0.0
    monkeypatch.setattr("companion.process.signing_keys._now", lambda: now)
    stamps = []

    def sign():
        kept = Timestamps(KEY, 0, tmp_path / "signing.json")
        kept.tick(1.0)
        frame = Codec(1, 1, signing=kept.signing).encode([HEARTBEAT])
        stamps.append(int.from_bytes(frame[-12:-6], "little"))
        kept.save()

    sign()
    sign()
    now = EPOCH + 400e6
    sign()
    now = 0.0
    sign()
    assert 0 <= stamps[0] < stamps[1] < TICKS * 10
    assert TICKS * 400e6 <= stamps[2] < stamps[3]


def test_signing_continues_where_the_timestamps_cannot_be_saved(tmp_path):
    kept = Timestamps(KEY, 0, tmp_path / "nowhere" / "signing.json")
    kept.tick(10.0)
    kept.tick(20.0)
    assert kept.signing.timestamp > 0


def test_signed_frames_follow_the_standard():
    frame = Codec(1, 1, signing=Signing(KEY, NOW, link_id=3)).encode([HEARTBEAT])
    assert frame[2] == 1  # MAVLINK_IFLAG_SIGNED
    assert frame[-13] == 3
    assert int.from_bytes(frame[-12:-6], "little") == NOW
    assert frame[-6:] == hashlib.sha256(KEY + frame[:-6]).digest()[:6]


def test_what_the_vehicle_signs_right_after_our_first_frame_is_not_ours():
    """It may sign by the same clock, and as the same sender as another link of ours."""
    ours = Signing(KEY, NOW, link_id=1, own=(1, 191))
    ours.signed(b"a frame")
    assert ours._was_sent(NOW, (1, 191))
    assert not ours._was_sent(NOW + 1, (1, 191))
    assert not ours._was_sent(NOW, (1, 1))
