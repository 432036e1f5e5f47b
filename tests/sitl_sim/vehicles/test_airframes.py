"""Airframes of other sizes fly with the same gains; deviations change the truth alone."""

import numpy as np
import pytest

from sitl_sim.vehicles.airframe import Airframe, RateGains
from sitl_sim.vehicles.airframes import AIRFRAMES, Deviation
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles


def test_every_airframe_has_three_times_its_weight_in_thrust():
    for name, airframe in AIRFRAMES.items():
        assert airframe.hover_thrust == pytest.approx(0.333, abs=0.01), name
        assert airframe.radius > airframe.arm


def test_a_deviation_of_one_changes_nothing():
    assert Deviation().airframe(Airframe()) == Airframe()
    assert Deviation().gains(RateGains()) == RateGains()


def test_a_deviation_is_a_factor_on_what_it_names():
    known = Airframe()
    true = Deviation(1.2, 1.1, 0.75, 2.0, 1.5, 0.5, 3.0).airframe(known)
    assert true.mass == pytest.approx(1.2 * known.mass)
    assert true.inertia == pytest.approx(1.1 * np.array(known.inertia))
    assert true.thrust_max == pytest.approx(0.75 * known.thrust_max)
    assert true.drag_linear == pytest.approx(2.0 * np.array(known.drag_linear))
    assert true.drag_quadratic == pytest.approx(2.0 * known.drag_quadratic)
    assert true.motor_time == pytest.approx(1.5 * known.motor_time)
    assert true.battery_resistance == pytest.approx(3.0 * known.battery_resistance)
    gains = Deviation(rate_gains=0.5).gains(RateGains())
    assert (gains.p[0], gains.i[1], gains.d[0]) == (50.0, 60.0, 0.9)
    assert gains.feed_forward == RateGains().feed_forward


def test_a_mixed_fleet_takes_off_and_hovers_also_heavier_and_weaker_than_assumed(make_flight):
    assumed = list(AIRFRAMES.values())
    off = Deviation(mass=1.2, thrust=0.75, rate_gains=0.5)
    vehicles = Vehicles([off.airframe(a) for a in assumed], [[3.0 * i, 0, 0] for i in range(3)], 0)
    f = make_flight(3)
    f.vehicles = vehicles
    f.autopilots = Autopilots(
        vehicles, [1, 2, 3], assumed=assumed, rate_gains=[off.gains(RateGains())] * 3
    )
    hover = f.autopilots.units[0].parameters["MPC_THR_HOVER"]
    assert hover == pytest.approx(assumed[0].hover_thrust, abs=1e-3)  # it does not know better
    for i in range(3):
        assert f.command(400, 1, i=i) == 0
        assert f.command(22, i=i) == 0
    f.run(12.0)
    np.testing.assert_allclose(vehicles.p[:, 2], 2.5, atol=0.3)
    np.testing.assert_allclose(vehicles.p[:, :2], [[0, 0], [3, 0], [6, 0]], atol=0.3)
    thrust = (vehicles.body.thrust_max * vehicles.motor**2).sum(axis=1)
    np.testing.assert_allclose(
        thrust, 1.2 * 9.80665 * np.array([a.mass for a in assumed]), rtol=0.1
    )


def test_a_battery_of_more_resistance_sags_more(make_flight):
    voltages = []
    for battery in (1.0, 3.0):
        frame = Deviation(battery=battery).airframe(Airframe())
        f = make_flight()
        f.vehicles = Vehicles(frame, [[0.0, 0.0, 0.0]], 0.0)
        f.autopilots = Autopilots(f.vehicles, [1])
        f.in_the_air()
        voltages.append(f.autopilots.units[0].battery()[0])
    current = 0.6 + 22.0 * 4 * 0.333**1.5
    assert voltages[0] - voltages[1] == pytest.approx(2 * 0.02 * current, rel=0.1)
