"""Batteries discharge and sag."""

from mavlink_bridge.wire.messages import SystemStatus


def test_a_battery_discharges_in_flight(make_flight):
    f = make_flight()
    f.in_the_air()
    first = f.last(SystemStatus)
    f.run(20.0)
    last = f.last(SystemStatus)
    assert last.remaining < first.remaining
    assert 12.0 < last.voltage < first.voltage < 16.8
    assert 3.0 < last.current < 30.0
