"""The pace of ticks: their clock, and the greeting to a vehicle that sends only HEARTBEAT."""

import os
import time

import numpy as np

from companion.process.pace import ClockPace
from mavlink_bridge.autopilots.ardupilot import ArduPilot
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Attitude, Command, Heartbeat, Received, Source, SystemTime
from mavlink_bridge.wire.udp import UdpEndpoint

AUTOPILOT = "ardupilot"  # of the emulated vehicles
LEVEL = np.array([1.0, 0, 0, 0])


class NoFrames:
    """A camera that never has a frame."""

    def __init__(self):
        self._end, self._other = os.pipe()

    def fileno(self):
        return self._end

    def waits(self, timeout=0.0):
        return False


def test_a_vehicle_that_sends_only_heartbeats_is_asked_for_streams():
    link = Link(UdpEndpoint(local=("127.0.0.1", 0)), Codec(1, 191, [Source(1, 1)]))
    vehicle = UdpEndpoint(remote=("127.0.0.1", link.endpoint.port))
    wire, streams, said = Codec(1, 1), ArduPilot(1).request_streams(), []
    pace = ClockPace(link, NoFrames(), 0.1, Source(1, 1), streams)
    until = time.monotonic() + 10.0

    def stopped():
        vehicle.send(wire.encode([Heartbeat(3, 2, False, 4, 4)]))
        said.extend(r.message for data in vehicle.receive() for r in wire.decode_datagram(data))
        if any(isinstance(m, Command) for m in said):
            vehicle.send(wire.encode([Attitude(5.0, LEVEL, np.zeros(3))]))
        return time.monotonic() > until

    inputs = pace.next(stopped)
    assert inputs is not None
    assert 5.0 <= inputs.time < 6.0
    asked = len(said)
    assert said[: len(streams)] == streams
    assert pace.next(stopped) is not None
    assert len(said) == asked  # once it has answered it is the phases that ask
    link.close()
    vehicle.close()


def test_an_emulated_ardupilot_starts_on_the_clock(world, start_daemon):
    config = world.config(1)
    config.write_text(
        config.read_text().replace("system_id: 1", f"system_id: 1, autopilot: {AUTOPILOT}")
    )
    daemon = start_daemon(config)
    assert daemon.listen(20.0, until="READY=1"), daemon.log()


def test_only_the_vehicle_sets_the_clock():
    pace = ClockPace(None, None, 0.1, Source(1, 1))
    vehicle = Attitude(time.monotonic() - 1000.0, LEVEL, np.zeros(3))
    pace._hear_clock([Received(Source(1, 1), vehicle)])
    known = pace._offset
    others = [Source(255, 190), Source(2, 1), Source(1, 191)]
    pace._hear_clock([Received(s, SystemTime(time.monotonic() + 4e3)) for s in others * 3])
    assert pace._offset == known
