"""The controller on a plant with lag, drag and delay (`plant.py`)."""

import numpy as np
import pytest

from companion.control.nmpc import NmpcConfig
from companion.model import yaw_of
from tests.companion.control.nmpc.plant import drone, fly, forest

CONFIG = NmpcConfig()
AWAY = 0.58  # m: the safety distance of 0.6 m, less the cost of the lag


def cylinders(*rows):
    return np.array(rows, dtype=float)


def unfailing(log):
    return all(result.usable for tick in log.results for result in tick)


def height_error(log, height=2.0):
    return float(np.abs(log.p[..., 2] - height).max())


@pytest.mark.parametrize("delay", [0.02, 0.1])
def test_a_drone_flies_to_its_goal_and_holds_it(delay):
    log = fly([drone(CONFIG, [0, 0, 2], delay=delay)], [[8, 0, 2]], 12)
    cruise = log.speed[15:45, 0]
    assert cruise.min() > 1.3
    assert cruise.max() < 1.7
    assert height_error(log) < 0.05
    held = log.p[90:, 0] - [8, 0, 2]
    assert np.abs(held).max() < 0.03
    assert np.abs(log.x[-1, 0, 3:6]).max() < 0.01
    assert np.abs(np.diff(log.u[100:, 0], axis=0)).max() < 0.01  # still, not hunting
    assert unfailing(log)


@pytest.mark.parametrize("delay", [0.02, 0.1])
@pytest.mark.parametrize("seed", [3, 4])
def test_forest_with_the_gaze_swinging(seed, delay):
    """0.6 rad to both sides at cruise changes neither speed, height nor clearance."""
    trees = forest(seed)
    log = fly(
        [drone(CONFIG, [-26, 1, 2], delay=delay)],
        [[26, -1, 2]],
        60,
        cylinders=trees,
        gaze=lambda t: 0.6 * np.sin(1.5 * t),
        stop=1.0,
    )
    assert np.linalg.norm(log.p[-1, 0] - [26, -1, 2]) < 1.2
    assert log.clearance(trees) > AWAY
    assert 0.87 < log.speed[15:].mean() / CONFIG.speed < 1.07
    assert log.speed.max() < 2.0
    assert height_error(log) < 0.1
    assert unfailing(log)


def test_gaze_is_followed():
    def gaze(t):
        return 0.6 * np.sin(1.5 * t)

    log = fly([drone(CONFIG, [0, 0, 2])], [[30, 0, 2]], 15, gaze=gaze)
    headings = np.array([yaw_of(x[0, 6:10]) for x in log.x])
    wanted = np.array([gaze(0.1 * n) for n in range(len(headings))])
    assert np.abs(headings - wanted)[15:].max() < np.radians(16)
    assert log.speed[20:].min() > 1.35


@pytest.mark.parametrize("height", [4.0, 0.5])
def test_height_is_changed_slowly_but_on_the_way(height):
    """Straight up and down the camera shows nothing, obliquely ahead it does."""
    still = fly([drone(CONFIG, [0, 0, 2])], [[0, 0, height]], 4)
    assert 0.15 < np.abs(still.x[:, 0, 5]).max() < 0.3
    ahead = fly([drone(CONFIG, [0, 0, 2])], [[20, 0, height]], 6)
    assert np.abs(ahead.x[:, 0, 5]).max() > 0.8 * CONFIG.climb_speed


@pytest.mark.parametrize("y", [0.0, 0.05, -0.3, 0.9])
def test_a_trunk_dead_ahead_is_passed(y):
    trunk = cylinders([6, y, 1])
    log = fly([drone(CONFIG, [0, 0, 2])], [[14, 0, 2]], 20, cylinders=trunk, stop=0.5)
    assert np.linalg.norm(log.p[-1, 0] - [14, 0, 2]) < 0.8
    assert len(log.p) < 130
    assert log.clearance(trunk) > AWAY


def test_gap_just_wide_enough():
    trunks = cylinders([6, 1.7, 1], [6, -1.7, 1])
    log = fly([drone(CONFIG, [0, 0.4, 2])], [[14, 0, 2]], 20, cylinders=trunks, stop=0.5)
    assert len(log.p) < 120
    assert log.clearance(trunks) > AWAY


def test_wall_is_not_crossed():
    log = fly(
        [drone(CONFIG, [0, 0, 2], delay=0.1)],
        [[8, 0, 2]],
        10,
        planes=np.array([[1.0, 0, 0, 5]]),
    )
    assert log.p[:, 0, 0].max() < 5 - AWAY


@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_drones_pass_head_on(offset):
    """Without communication, both give way to their right."""
    drones = [drone(CONFIG, [0, 0, 2]), drone(CONFIG, [12, offset, 2], np.pi)]
    log = fly(drones, [[12, 0, 2], [0, offset, 2]], 20, stop=0.5)
    assert len(log.p) < 120
    assert log.separation() > 0.7
    assert height_error(log) < 0.2
    assert unfailing(log)


def test_drones_that_start_inside_a_safety_radius_part():
    drones = [drone(CONFIG, [0, 0, 2]), drone(CONFIG, [0.55, 0.1, 2])]
    log = fly(drones, [[12, 0, 2], [12, 2, 2]], 15, stop=0.5)
    assert log.separation() > 0.5
    distance = np.linalg.norm(log.p[:, 0] - log.p[:, 1], axis=1)
    assert distance[12:].min() > 0.75
    assert height_error(log) < 0.4  # all thrust goes into getting apart
    assert unfailing(log)


def test_wind_is_compensated():
    there = drone(CONFIG, [0, 0, 2], wind=np.array([0.0, 4.0, 0.0]))
    log = fly([there], [[8, 0, 2]], 14)
    assert np.abs(log.p[-20:, 0] - [8, 0, 2]).max() < 0.05
    assert np.abs(log.p[:, 0, 1]).max() < 0.6


def test_a_large_step_of_the_rate_is_tracked():
    """The model's rates are the plant's: 0.8 of the bound, after the lag."""
    body = drone(CONFIG, [0, 0, 2], delay=0.0)
    u = np.array([9.81, 0.0, 0.0, 0.8 * CONFIG.omega_max])
    for _ in range(5):
        body.advance(u)
    assert body.actual[3] == pytest.approx(0.8 * CONFIG.omega_max, rel=1e-3)
    expected = 0.8 * CONFIG.omega_max * (0.5 - 0.04)
    assert yaw_of(body.x[6:10]) == pytest.approx(expected, abs=0.02)


@pytest.mark.slow
def test_twenty_forests_with_delay():
    for seed in range(20):
        trees = forest(100 + seed)
        log = fly(
            [drone(CONFIG, [-26, 1, 2], delay=0.1)], [[26, -1, 2]], 80, cylinders=trees, stop=1.0
        )
        assert np.linalg.norm(log.p[-1, 0] - [26, -1, 2]) < 1.2, seed
        assert log.clearance(trees) > 0.4, seed
