"""The .tlog as ground stations open it: by pymavlink's reader, which MAVProxy uses."""

import numpy as np
import pytest
from pymavlink import mavutil  # noqa: TID251  (the reader of ground stations)

from companion.flightlog.tlog import TelemetryLog, frames
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition

BEAT = Heartbeat(12, 2, True, 0, 4)


def datagram(n):
    t = n / 50
    messages = [
        Attitude(t, np.array([1.0, 0, 0, 0]), np.zeros(3)),
        LocalPosition(t, np.array([1.0, 2.0, n]), np.zeros(3)),
        BEAT,
    ]
    return Codec(7, 1).encode(messages)


def test_pymavlink_reads_it_back(tmp_path):
    path = tmp_path / "flight.tlog"
    log = TelemetryLog(path)
    for n in range(100):
        log.write(n / 10, [(False, datagram(n)), (False, b"garbage")])
    log.close()
    reader = mavutil.mavlink_connection(str(path))
    heights, stamps = [], []
    while (message := reader.recv_match()) is not None:
        assert message.get_srcSystem() == 7
        if message.get_type() == "LOCAL_POSITION_NED":
            heights.append(-message.z)
            stamps.append(message._timestamp)
    reader.close()
    assert heights == list(range(100))
    assert stamps == pytest.approx(np.arange(100) / 10)


def test_frames_are_whole_under_any_chunking():
    data = b"".join(datagram(n) for n in range(5))
    whole, rest = frames(data)
    assert b"".join(whole) == data
    assert (len(whole), rest) == (15, b"")
    for size in (1, 2, 3, 7, 40, 300):
        found, rest = [], b""
        for at in range(0, len(data), size):
            more, rest = frames(rest + data[at : at + size])
            found += more
        assert found == whole


def test_while_disarmed_streams_are_thinned_and_all_else_is_kept(tmp_path):
    path = tmp_path / "flight.tlog"
    log = TelemetryLog(path)
    for n in range(50):  # disarmed for 5 s, then armed for 1 s
        log.write(n / 10, [(False, datagram(n))], armed=False)
    for n in range(50, 60):
        log.write(n / 10, [(False, datagram(n))], armed=True)
    log.close()
    reader = mavutil.mavlink_connection(str(path))
    kinds = []
    while (message := reader.recv_match()) is not None:
        kinds.append(message.get_type())
    reader.close()
    assert kinds.count("LOCAL_POSITION_NED") == kinds.count("ATTITUDE_QUATERNION") == 5 + 10
    assert kinds.count("HEARTBEAT") == 60
