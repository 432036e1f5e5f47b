"""Batteries discharge and sag."""

import pytest

from mavlink_bridge.wire.messages import SystemStatus


@pytest.mark.parametrize(("flavour", "mode"), [("px4", (1, 4, 3)), ("ardupilot", (1, 4))])
def test_a_battery_discharges_in_flight(make_flight, flavour, mode):
    f = make_flight(flavour=flavour)
    f.command(176, *mode)
    f.command(400, 1)
    f.command(511, 1, 5e5)
    f.command(22, 0, 0, 0, 0, 0, 0, 500.0 if flavour == "px4" else 12.0)
    f.run(15.0)
    first = f.last(SystemStatus)
    f.run(20.0)
    last = f.last(SystemStatus)
    assert last.remaining < first.remaining
    assert 12.0 < last.voltage < first.voltage < 16.8
    if flavour == "px4":
        assert last.current == -1.0  # A, not measured
    else:
        assert 3.0 < last.current < 30.0
