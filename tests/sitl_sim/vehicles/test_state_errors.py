"""Errors of each grade of state estimate against the table that they are drawn from."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.estimator import Estimate, Estimator
from sitl_sim.vehicles.grades import GRADES, Grade
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.vehicles.sensor_noise import SensorNoise
from sitl_sim.vehicles.state_errors import StateErrors

DEG = math.pi / 180.0


class Fleet:
    """n vehicles that fly on a rail, and their errors every 10 ms."""

    def __init__(self, grade, n=60, seed=3, velocity=(0.0, 0.0, 0.0), ids=None):
        self.vehicles = Vehicles(Airframe(), np.zeros((n, 3)), 0.0)
        self.vehicles.v[:] = velocity
        ids = ids or list(range(1, n + 1))
        self.errors = StateErrors(ids, [grade] * n, seed)
        self.estimate: Estimate = Estimator(ids, [SensorNoise.none()] * n, seed).estimate

    def fly(self, seconds):
        """(T, n, 9): errors of position, velocity, attitude."""
        found = []
        for k in range(round(seconds * 100)):
            if k % 100 == 0:
                self.errors.next_block()
            self.errors.step(k % 100, self.vehicles.state, self.estimate)
            found.append(self.estimate.error.copy())
        return np.array(found)


def without_steps(name):
    return replace(GRADES[name], steps=None)


def test_motion_capture_has_no_slow_errors():
    assert not Fleet(GRADES["mocap"], 2).fly(1.0).any()


def test_gps_wanders_by_what_each_vehicle_drew():
    quiet = replace(without_steps("gps"), baro=(0.0, 0.0), flutter=0.0)
    fleet = Fleet(quiet, n=300)
    sigma = np.array([fleet.errors.wander_sigma(i) for i in range(300)])
    assert sigma[:, 0].min() >= 0.5
    assert sigma[:, 0].max() <= 1.0
    assert sigma[:, 2].min() >= 0.3
    assert sigma[:, 2].max() <= 0.5
    error = fleet.fly(8.6)[:, :, :3] / sigma
    assert error[0].std() == pytest.approx(1.0, abs=0.08)  # it has wandered for long
    assert error[-1].std() == pytest.approx(1.0, abs=0.08)
    # Second-order Gauss-Markov: (1 + t/τ) exp(-t/τ) with τ = 20 s.
    share = 8.59 / 20.0
    expected = (1 + share) * math.exp(-share)
    correlation = np.corrcoef(error[0].ravel(), error[-1].ravel())[0, 1]
    assert correlation == pytest.approx(expected, abs=0.04)


def test_the_velocity_of_gps_does_not_show_the_wander():
    quiet = replace(without_steps("gps"), baro=(0.0, 0.0), latency=(0.0, 0.0))
    error = Fleet(replace(quiet, flutter=0.0, velocity=0.0)).fly(5.0)
    assert np.abs(error[-1, :, :2] - error[0, :, :2]).max() > 0.2
    assert not error[:, :, 3:6].any()
    # The fast error of the position, σ 0.08 m over 2 s, shows beside the velocity's own.
    error = Fleet(quiet).fly(10.0)
    assert error[:, :, 3:5].std() == pytest.approx(math.hypot(0.08, 0.08 / 2.0), rel=0.12)


def test_the_latency_puts_the_estimate_behind_in_flight():
    late = Grade(SensorNoise.none(), latency=(0.1, 0.2))
    fleet = Fleet(late, velocity=(2.0, 0.0, 0.0))
    error = fleet.fly(5.0)[-1]
    np.testing.assert_allclose(error[:, 0], -2.0 * fleet.errors.latency, rtol=1e-3)
    np.testing.assert_allclose(error[:, 3], 0.0, atol=1e-3)
    assert 0.1 <= fleet.errors.latency.min() < 0.12
    assert 0.18 < fleet.errors.latency.max() <= 0.2


@pytest.mark.parametrize(
    ("name", "tilt", "yaw"), [("rtk", (0.5, 0.8), (1, 2)), ("gps", (1, 1.5), (2, 5))]
)
def test_attitude_is_off_by_tilt_and_compass(name, tilt, yaw):
    fleet = Fleet(without_steps(name), n=300)
    error = fleet.fly(0.5)[-1] / DEG
    assert tilt[0] < error[:, 6:8].std() < tilt[1]
    bias = np.abs(fleet.errors.yaw_bias) / DEG
    assert yaw[0] <= bias.min() < bias.max() <= yaw[1]
    spread = np.hypot(error[:, 6:8].std(), math.sqrt((bias**2).mean()))
    assert error[:, 8].std() == pytest.approx(spread, rel=0.12)


def test_vio_drifts_by_about_one_percent_of_the_distance():
    fleet = Fleet(without_steps("vio"), n=150, velocity=(2.0, 0.0, 0.0))
    error = fleet.fly(50.0)  # 100 m
    away = np.sqrt((error[-1, :, :2] ** 2).sum(axis=1).mean())
    assert 0.6 < away < 1.6
    early = np.sqrt((error[999, :, :2] ** 2).sum(axis=1).mean())
    assert early < 0.4 * away
    yaw = error[-1, :, 8].std() / DEG
    assert yaw == pytest.approx(math.hypot(0.1 * math.sqrt(50.0), 0.45), rel=0.15)
    # What VIO sums up it reports: the scale of the distance is that of the velocity.
    assert np.corrcoef(error[-1, :, 3], fleet.errors.scale)[0, 1] > 0.15


def test_vio_jumps_by_a_fifth_of_a_metre_and_counts_it():
    often = replace(GRADES["vio"], steps=replace(GRADES["vio"].steps, every=5.0))
    fleet = Fleet(often, n=20)
    error = fleet.fly(20.0)
    step = np.linalg.norm(np.diff(error[:, :, :2], axis=0), axis=2)
    jumps = step[step > 0.1]
    assert len(jumps) == fleet.errors.resets.sum() == pytest.approx(80, abs=30)
    assert 0.13 < jumps.min() < jumps.max() < 0.27


def test_rtk_floats_for_seconds_says_so_and_is_fixed_again():
    often = replace(GRADES["rtk"], steps=replace(GRADES["rtk"].steps, every=10.0, lasts=(5.0, 5.0)))
    fleet = Fleet(often, n=20)
    found, floats, sigma = [], [], []
    for _ in range(40):
        found.append(fleet.fly(1.0)[-1, :, :2])
        floats.append(fleet.errors.floating.copy())
        sigma.append(fleet.errors.position_sigma[:, 0].copy())
    off, floats = np.linalg.norm(found, axis=2), np.array(floats)
    settled = floats[2:] & floats[1:-1] & floats[:-2]
    low, high = np.quantile(off[2:][settled], [0.05, 0.95])  # some have just begun
    assert 0.18 < low < high < 0.53
    fixed = ~floats
    for earlier in (1, 2, 3):
        fixed[earlier:] &= ~floats[:-earlier]
    assert off[3:][fixed[3:]].max() < 0.1
    assert floats.mean() == pytest.approx(5.0 / 15.0, abs=0.12)
    assert set(np.unique(np.array(sigma)[floats])) == {0.3}
    assert set(np.unique(np.array(sigma)[~floats])) == {0.02}


def test_the_errors_of_a_vehicle_depend_on_its_id_and_the_seed_alone():
    together = Fleet(GRADES["gps"], n=3, ids=[1, 2, 3]).fly(2.0)
    alone = Fleet(GRADES["gps"], n=1, ids=[2]).fly(2.0)
    np.testing.assert_array_equal(together[:, 1], alone[:, 0])
    assert not np.allclose(together[:, 0], together[:, 1])
    assert not np.allclose(alone, Fleet(GRADES["gps"], n=1, ids=[2], seed=4).fly(2.0))
