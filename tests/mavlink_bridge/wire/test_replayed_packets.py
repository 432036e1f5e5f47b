"""Packets that are played back, echoed or spoilt: what is heard of them."""

import numpy as np
import pytest

from companion.process.presence import Presence
from companion.settings.sections import LinkConfig
from companion.supervision.phases import COMPANION_HEARTBEAT
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Attitude, Heartbeat, Source
from mavlink_bridge.wire.signing import TICKS, Signing
from tests.mavlink_bridge.wire.hostile_packets import (
    KEY,
    ME,
    NOW,
    VEHICLE,
    flipped,
    heartbeat,
    received,
    signed_codec,
    sources,
)


@pytest.mark.row("26")
@pytest.mark.parametrize("later", [0.0, 5.0, 59.0, 600.0])
@pytest.mark.parametrize("source", [ME, VEHICLE])
def test_signed_packets_played_back_are_not_heard(source, later, note):
    """Its own packets reach the codec only by reflection; the vehicle's were heard before."""
    ours = signed_codec()
    if source == ME:
        recorded = [ours.encode([COMPANION_HEARTBEAT]) for _ in range(20)]
    else:
        recorded = [heartbeat(VEHICLE, NOW + n) for n in range(1, 21)]
        assert all(sources(ours, data) == [VEHICLE] for data in recorded)
    ours._signing.advance(NOW / TICKS + 1_420_070_400 + later)
    ours.encode([COMPANION_HEARTBEAT])
    heard = sum(len(sources(ours, data)) for data in recorded)
    assert heard == 0
    assert ours.statistics.replayed == 20
    note(f"played back, {source.component}, {later:g} s later: heard", heard)


@pytest.mark.row("26")
def test_packets_of_a_flight_before_the_restart_are_not_heard():
    before = signed_codec()
    recorded = [before.encode([COMPANION_HEARTBEAT]) for _ in range(20)]
    after = signed_codec(at=before._signing.timestamp)
    assert [sources(after, data) for data in recorded] == [[]] * 20
    after.encode([COMPANION_HEARTBEAT])
    assert [sources(after, data) for data in recorded] == [[]] * 20


def test_what_was_recorded_on_another_link_is_refused_once_it_is_old():
    ours = signed_codec()
    assert sources(ours, heartbeat(VEHICLE, NOW + 10 * TICKS, link_id=0)) == [VEHICLE]
    assert sources(ours, heartbeat(VEHICLE, NOW + 8 * TICKS, link_id=1)) == []
    assert sources(ours, heartbeat(VEHICLE, NOW + 10 * TICKS - 50, link_id=1)) == [VEHICLE]


@pytest.mark.row("11")
@pytest.mark.parametrize(("age", "heard"), [(59.9, [VEHICLE]), (60.1, [])])
def test_a_new_stream_is_at_most_a_minute_old(age, heard):
    assert sources(signed_codec(), heartbeat(VEHICLE, NOW - round(age * TICKS))) == heard


def test_literal_bytes_are_what_the_codec_writes():
    ours = signed_codec(link_id=3)
    written = ours.encode([Heartbeat(12, 2, True, 7, 4, 0x01)])
    assert written == heartbeat(ME, NOW, link_id=3, custom_mode=7)


@pytest.mark.row("12")
@pytest.mark.parametrize("signed", [True, False])
def test_two_companions_of_one_vehicle_hear_each_other_and_not_their_echo(signed):
    pair = []
    for number in (5, 6):
        config = LinkConfig(system_id=1)
        signing = Signing(KEY, NOW) if signed else None
        pair.append((Codec(1, 191, config.heard(), signing), Presence(ME, number)))
    noticed = [0, 0]
    for step in range(5):  # in phase, as when both run on NTP
        sent = [c.encode(p.marked([COMPANION_HEARTBEAT])) for c, p in pair]
        for i, (codec, presence) in enumerate(pair):
            assert not presence.another(codec.decode_datagram(sent[i])), step
            noticed[i] += presence.another(codec.decode_datagram(sent[1 - i]))
            if signed:
                codec._signing.timestamp += 1000 + 17 * i
    assert min(noticed) >= 4


def test_a_packet_whose_first_frame_is_spoilt_is_read_on():
    """A radio flips a bit; a router puts the frame of another system in front."""
    ours = Link(MemoryEndpoint(vehicle := MemoryEndpoint()), signed_codec(), VEHICLE)
    good = [heartbeat(VEHICLE, NOW + n) for n in range(1, 7)]
    for packet in (
        good[0] + good[1],
        flipped(good[2]) + good[3],
        heartbeat(Source(9, 1)) + good[4],
        good[5],
    ):
        vehicle.send(packet)
    assert received(ours) == [VEHICLE] * 5


def test_a_copy_of_what_tells_its_time_is_heard_once():
    """Without signing a recorded packet is as good as the true one, but tells nothing new."""
    vehicle, ours = Codec(1, 1), Codec(1, 191, [VEHICLE])
    state = Attitude(2.0, np.array([1.0, 0, 0, 0]), np.zeros(3))
    packet = vehicle.encode([state])
    assert len(ours.decode_datagram(packet) + ours.decode_datagram(packet)) == 1
    assert len(ours.decode_datagram(vehicle.encode([state]))) == 1  # its next frame
    beat = heartbeat(VEHICLE)  # of a sender that does not count its frames
    assert len(ours.decode_datagram(beat) + ours.decode_datagram(beat)) == 2
