"""Take-off, hold, landing and return of the emulated PX4."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.messages import ExtendedSystemState, Heartbeat
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.px4 import PX4

HOVER = Airframe().hover_thrust


def test_takeoff_reaches_its_altitude_and_holds(make_flight):
    f = make_flight(parameters={"MIS_TAKEOFF_ALT": 5.0})
    f.in_the_air()
    f.run(5.0)
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 5], atol=0.3)
    assert np.linalg.norm(f.vehicles.v[0]) < 0.3
    assert f.last(Heartbeat).custom_mode == PX4.modes[Mode.HOLD]
    assert f.last(ExtendedSystemState).landed_state == 2


@pytest.mark.parametrize(("asked", "reached"), [(488.0 + 4.0, 4.0), (5.0, 2.5)])
def test_takeoff_to_an_altitude_above_the_sea(make_flight, asked, reached):
    f = make_flight()
    f.command(400, 1)
    nan = math.nan
    assert f.command(22, 0, 0, 0, nan, nan, nan, asked) == 0
    f.run(10.0)
    assert f.vehicles.p[0, 2] == pytest.approx(reached, abs=0.3)


def test_holds_against_wind(make_flight):
    f = make_flight()
    f.in_the_air()
    f.run(10.0, wind=[4.0, 0.0, 0.0])
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 2.5], atol=0.4)


def test_land_is_gentle_and_disarms(make_flight):
    f = make_flight()
    f.in_the_air()
    assert f.command(21) == 0
    speeds = []
    assert f.run(15.0, lambda: speeds.append(f.vehicles.v[0, 2]) or not f.commander.armed)
    assert min(speeds) > -1.2
    assert f.vehicles.p[0, 2] == 0.0
    assert f.texts()[-2:] == ["Landing detected", "Disarmed by landing"]
    assert (f.vehicles.motor[0] < 0.06).all()


def test_touchdown_stays_within_the_accelerations_of_a_plausible_truth(make_flight):
    """No acceleration beyond 80 m/s² between samples at 100 Hz."""
    f = make_flight()
    f.in_the_air()
    f.command(21)
    v = []
    f.run(15.0, lambda: v.append(f.vehicles.v[0].copy()) or not f.commander.armed)
    assert np.linalg.norm(np.diff(v, axis=0), axis=1).max() / 0.01 < 80


def test_return_climbs_flies_home_and_lands(make_flight):
    f = make_flight(parameters={"RTL_RETURN_ALT": 4.0})
    f.in_offboard()
    f.stream([0, 0.25, 0], 1.02 * HOVER)
    f.run(1.0)
    f.stream([0, 0, 0], 1.05 * HOVER)
    assert f.run(5.0, lambda: f.vehicles.p[0, 0] > 4.0)
    assert f.command(20) == 0
    f.setpoint = None
    heights = []
    assert f.run(60.0, lambda: heights.append(f.vehicles.p[0, 2]) or not f.commander.armed)
    assert max(heights) > 3.7
    assert np.linalg.norm(f.vehicles.p[0, :2]) < 0.5


def test_px4_takes_its_time_to_lift_off(make_flight):
    """PX4 1.17 in SIH: 2 m up 4.7 to 5.3 s after NAV_TAKEOFF, 1.5 s after it was armed, to 3 m."""
    f = make_flight(parameters={"MIS_TAKEOFF_ALT": 3.0})
    f.command(400, 1)
    f.run(1.5)
    f.command(22)
    asked = f.autopilots.t
    assert f.run(8.0, lambda: f.vehicles.p[0, 2] > 2.0)
    assert 4.3 <= f.autopilots.t - asked <= 5.3, f.autopilots.t - asked
