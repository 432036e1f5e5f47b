"""Pilots of foreign drones on emulated autopilots: they climb, and fly as they should."""

import numpy as np
import pytest

from sitl_sim.vehicles.foreign import ForeignFleet, Hover, Pursue, Straight

WIND = [2.0, 1.0, 0.0]


def flown(flight, pilots, seconds, wind=0.0):
    """Fly at 50 Hz; return positions and velocities (T,n,3)."""
    a = flight.autopilots
    fleet = ForeignFleet(a, pilots)
    p, v = [], []
    for k in range(round(seconds * 50)):
        fleet.update(k / 50)
        a.advance((k + 1) / 50, wind)
        p.append(flight.vehicles.p.copy())
        v.append(flight.vehicles.v.copy())
    return np.array(p), np.array(v)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_a_pursuer_reaches_its_speed_and_its_prey(make_flight, flavour):
    f = make_flight(2, flavour)
    f.vehicles.p[1] = [20.0, 9.0, 0.0]
    prey = Hover(1, [20.0, 9.0, 4.0])
    pursuer = Pursue(0, [0.0, 0.0, 2.0], [1], np.zeros(2), speed=5.0, after=9.0)
    p, v = flown(f, [prey, pursuer], 16.0)
    assert np.linalg.norm(p[440, 0] - [0.0, 0.0, 2.0]) < 0.4  # it waits, in the air, until 9 s
    assert 4.8 < np.linalg.norm(v[:, 0], axis=1).max() < 5.7  # it overshoots as it sets off
    assert np.linalg.norm(p[:, 0] - p[:, 1], axis=1).min() < 0.2


def test_a_pursuer_takes_the_nearest_that_is_in_the_air_and_stays_above_the_ground():
    pursuer = Pursue(0, [0.0, 0.0, 2.0], [1, 2], np.zeros(3), speed=3.0, after=0.0)
    p = np.array([[0.0, 0.0, 2.0], [4.0, 0.0, 0.0], [0.0, 8.0, 2.0]])
    assert pursuer.velocity(1.0, p) == pytest.approx([0.0, 3.0, 0.0])  # drone 1 is on the ground
    p[1, 2] = 2.0
    assert pursuer.velocity(1.0, p) == pytest.approx([3.0, 0.0, 0.0])
    p[0], p[1, 2] = [0.0, 0.0, 0.5], 0.4
    assert pursuer.velocity(1.0, p)[2] == 0.0
    p[1:, 2] = 0.0
    assert np.linalg.norm(pursuer.velocity(1.0, p) - [0.0, 0.0, 1.5]) < 1e-9  # back to its place


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_a_straight_one_keeps_its_line_in_wind_and_stays_at_its_last_target(make_flight, flavour):
    f = make_flight(1, flavour)
    last = np.array([18.0, 6.0, 4.0])
    pilot = Straight(0, [0.0, 0.0, 2.0], [[18.0, 0.0, 2.0], last], speed=3.0)
    p, v = flown(f, [pilot], 26.0, WIND)
    first = p[(p[:, 0, 0] > 3.0) & (p[:, 0, 0] < 17.0) & (p[:, 0, 1] < 1.0), 0]
    assert len(first) > 100
    assert np.abs(first[:, 1:] - [0.0, 2.0]).max() < 0.3
    assert np.linalg.norm(v[:, 0], axis=1).max() == pytest.approx(3.0, abs=0.5)
    assert np.linalg.norm(p[-50:, 0] - last, axis=1).max() < 0.4


def test_a_hovering_one_stays_by_the_truth_whatever_its_autopilot_believes(make_flight):
    f = make_flight(1)
    f.autopilots.shift_position(0, [3.0, 0.0, 0.0])
    p, _ = flown(f, [Hover(0, [0.0, 0.0, 2.0])], 14.0)
    assert np.linalg.norm(p[-50:, 0] - [0.0, 0.0, 2.0], axis=1).max() < 0.4


def test_in_another_mode_it_is_not_the_pilot_that_flies(make_flight):
    f = make_flight(1)
    flown(f, [Hover(0, [0.0, 0.0, 2.0])], 9.0)
    f.commander.set_mode(type(f.commander.mode).LAND)
    fleet = ForeignFleet(f.autopilots, [Hover(0, [0.0, 0.0, 2.0])])
    fleet._flying.add(0)
    limits = f.autopilots._shared.setpoints.limits[0].copy()
    for k in range(60):
        fleet.update(k / 50)
        f.autopilots.advance(9.0 + (k + 1) / 50)
    assert f.vehicles.p[0, 2] < 1.8  # it lands
    assert f.autopilots._shared.setpoints.limits[0] == pytest.approx(limits)


@pytest.mark.parametrize("y", [-0.3, 0.0, 0.4])
def test_a_straight_one_flies_round_trunks(make_flight, y):
    f = make_flight(1, "px4")
    trunks = np.array([[9.0, y, 1.0], [14.0, -y, 0.5], [40.0, 0.0, 1.0]])
    pilot = Straight(0, [0.0, 0.0, 2.0], [[20.0, 0.0, 2.0]], 2.0, trunks)
    p, v = flown(f, [pilot], 26.0)
    apart = np.hypot(*(p[:, 0, None, :2] - trunks[:, :2]).transpose(2, 0, 1)) - trunks[:, 2]
    assert apart.min() > 0.3
    assert np.linalg.norm(p[-1, 0] - [20.0, 0.0, 2.0]) < 0.4
    on_way = (p[:, 0, 0] > 3.0) & (p[:, 0, 0] < 17.0)
    assert np.linalg.norm(v[on_way, 0], axis=1).min() > 1.4  # it does not slow down for them
