"""The companion dies in flight: when and how each autopilot reacts, against the real ones.

Real figures, measured: PX4 leaves offboard COM_OF_LOSS_T (1.0 s) after the last setpoint;
ArduCopter levels at GUID_TIMEOUT (3.0 s) and stays in guided mode; Betaflight 4.6 drops
1.3 to 1.6 s after the last RC frame. The bridge to a real Betaflight: within 300 ms, in
tests/mavlink_bridge/betaflight.
"""

import pytest

from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.outer_loops import Control

HOVER = Airframe().hover_thrust


TICK = 0.01


def reaction(f, reacted, limit=5.0):
    """Seconds from the last setpoint to the reaction."""
    f.run(0.5)
    while round(f.autopilots.t * 100) % 10:
        f.run(TICK)
    last, f.setpoint = f.autopilots.t, None
    assert f.run(limit, reacted)
    return f.autopilots.t - last


@pytest.mark.parametrize("loss_time", [1.0, 0.4])
def test_px4_leaves_offboard_at_its_loss_time(make_flight, loss_time):
    f = make_flight(parameters={"COM_OF_LOSS_T": loss_time})
    f.in_the_air()
    f.stream([0, 0, 0.3], HOVER)
    f.run(0.5)
    assert f.command(176, 1, 6) == 0
    after = reaction(f, lambda: f.commander.mode is not Mode.OFFBOARD)
    assert after == pytest.approx(loss_time, abs=3 * TICK)
    f.run(2.0)
    assert f.commander.mode is Mode.RETURN
    assert abs(f.vehicles.omega[0, 2]) < 0.1


@pytest.mark.parametrize("timeout", [3.0, 1.0])
def test_ardupilot_levels_at_its_timeout(make_flight, timeout):
    f = make_flight(flavour="ardupilot", parameters={"GUID_OPTIONS": 8, "GUID_TIMEOUT": timeout})
    assert f.command(176, 1, 4) == 0
    assert f.command(400, 1) == 0
    assert f.command(22, 0, 0, 0, 0, 0, 0, 15.0) == 0
    f.run(14.0)
    f.stream([0, 0, 0], HOVER)
    control = f.autopilots._shared.setpoints.control
    after = reaction(f, lambda: control[0] == Control.LEVEL)
    assert after == pytest.approx(timeout, abs=3 * TICK)
    assert f.commander.mode is Mode.OFFBOARD


def test_betaflight_drops_as_long_after_the_last_frame_as_the_real_one(make_flight):
    f = make_flight(flavour="betaflight")
    a = f.autopilots
    for k in range(400):
        channels = [1500, 1500, 1000 if k < 200 else 1600, 1500, 1000 if k < 100 else 1900]
        a.sticks(0, channels)
        f.run(TICK)
    assert a.armed[0]
    last = a.t
    assert f.run(3.0, lambda: not a.armed[0])
    assert 1.3 <= a.t - last <= 1.6
