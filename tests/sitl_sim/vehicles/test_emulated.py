"""Several autopilots together: own frames, mixed fleets, faults, reproducibility."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.messages import Command, LocalPosition, Received, Source
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.vehicles.sensor_noise import SensorNoise


def test_the_own_frame_changes_telemetry_and_not_the_flight(make_flight):
    """Origin and yaw of the frame change telemetry, not the flight."""
    yaw, origin = 0.7, np.array([[10.0, -4.0, 0.0]])
    f = make_flight(origin=origin, yaw_offset=[yaw], noise=SensorNoise.none())
    f.in_the_air()
    f.run(1.0)
    p, q = f.vehicles.p[0], f.vehicles.q[0]
    c, s = math.cos(yaw), math.sin(yaw)
    own = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ (p - origin[0])
    unit = f.autopilots.units[0]
    np.testing.assert_allclose(unit.frame.point(p), own, atol=1e-12)
    np.testing.assert_allclose(unit.frame.to_world(own), p, atol=1e-12)
    lat, lon, _ = unit.frame.to_geo(p)
    np.testing.assert_allclose(unit.frame.from_geo(lat, lon), p[:2], atol=1e-6)
    sent = unit.frame.attitude(q)
    assert 2 * math.atan2(sent[3], sent[0]) == pytest.approx(-yaw, abs=0.02)
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 2.5], atol=0.2)


def test_mixed_fleet_takes_parameters_where_they_are_known(make_flight):
    f = make_flight(2, flavour=["px4", "ardupilot"], parameters={"COM_OF_LOSS_T": 0.5})
    assert f.autopilots.units[0].parameters["COM_OF_LOSS_T"] == 0.5
    with pytest.raises(ValueError, match="NONSENSE"):
        make_flight(2, flavour=["px4", "ardupilot"], parameters={"NONSENSE": 0.5})


def test_reboot_sets_the_clock_back_and_disarms(make_flight):
    f = make_flight(boot_offset=[100.0])
    f.in_the_air()
    before = f.last(LocalPosition).time
    f.autopilots.reboot(0)
    f.run(0.5)
    assert before > 100.0
    assert f.last(LocalPosition).time < 0.6
    assert not f.commander.armed
    f.run(5.0)
    assert f.vehicles.p[0, 2] == 0.0


def test_position_jump_and_gyro_bias(make_flight):
    f = make_flight()
    f.in_the_air()
    f.command(511, 32, 20000)
    f.autopilots.shift_position(0, [2.0, 0.0, 0.0])
    f.run(0.1)
    assert f.last(LocalPosition).p[0] == pytest.approx(2.0, abs=0.2)
    f.autopilots.bias_gyro(0, [0.05, 0.05, 0.0])
    f.run(5.0)
    assert f.vehicles.p[0, 0] == pytest.approx(-2.0, abs=0.5)


def test_gust_weak_motor_and_thrust_scale_keep_it_flying(make_flight):
    f = make_flight()
    f.in_the_air()
    f.vehicles.body.thrust_max[:] *= 0.85
    f.vehicles.body.thrust_max[0, 2] *= 0.8
    f.run(2.0, wind=[5.0, 0.0, 0.0])
    f.run(5.0)
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 2.5], atol=0.4)


def fly_three(step):
    vehicles = Vehicles(Airframe(), [[0, 0, 0], [3, 0, 0], [6, 0, 0]], 0.3)
    a = Autopilots(vehicles, [1, 2, 3], seed=5)
    nan = math.nan
    for i in range(3):
        a.receive(i, Received(Source(255, 190), Command(400, (1, 0, nan, nan, nan, nan, nan))))
        a.receive(i, Received(Source(255, 190), Command(22, (nan,) * 7)))
    t = 0.0
    while t < 2.9999:
        t = round(t + step, 6)
        a.advance(t)
    return vehicles


def test_the_same_seed_gives_the_same_bytes_for_any_steps_of_time():
    a, b = fly_three(0.002), fly_three(0.1)
    for x, y in zip(a.state, b.state, strict=True):
        assert x.tobytes() == y.tobytes()
    assert not np.array_equal(a.p[0], a.p[1] - [3, 0, 0])  # each has its own noise


def test_two_vehicles_with_one_id_are_refused():
    with pytest.raises(ValueError, match="one system id"):
        Autopilots(Vehicles(Airframe(), np.zeros((2, 3)), 0.0), [4, 4])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"flavour": "px5"}, "choose one of .*px4"),
        ({"parameters": {"MPC_THR_HOVR": 0.3}}, "MPC_THR_HOVER"),
    ],
)
def test_errors_list_the_choices(make_flight, options, message):
    with pytest.raises(ValueError, match=message):
        make_flight(**options)
