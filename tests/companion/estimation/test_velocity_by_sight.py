"""A velocity that is wrong with its position is corrected by the ground; a right one is not."""

import numpy as np
import pytest

from companion.estimation.height import Height
from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.velocity_by_sight import VelocityFromGround
from companion.perception.ground_flow import GroundFlow
from mavlink_bridge.wire.messages import LocalPosition, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
HEIGHT = Height(2.0, 0.15)


def true_velocity(t):
    """A weaving drone at 1.5 m/s."""
    return np.array([1.5 * np.cos(0.5 * np.sin(0.4 * t)), 1.5 * np.sin(0.5 * np.sin(0.4 * t)), 0.0])


def fly(wrong, seconds=20.0, noise=0.1, scale=1.05, sees=lambda t: True, seed=4):
    """Fly with telemetry at 50 Hz and a tick and a picture each 0.1 s.

    wrong(t): (3,) m/s that velocity and position are off. noise: m/s, 1 σ of the flow's error,
    which lasts 0.5 s. scale: of the flow, by a wrong height. sees(t): whether the picture shows
    ground. Return times (T,), the error (T,2) m/s of the velocity that is used, and that of the
    place (T,2) m.
    """
    rng, frame, ground = np.random.default_rng(seed), OdometryFrame(), VelocityFromGround()
    place, slid, off = np.zeros(3), np.zeros(3), np.zeros(2)
    states, found, before, shown = {}, [], 0.0, np.zeros(3)
    for k in range(1, round(seconds * 50) + 1):
        t = k / 50
        v = true_velocity(t)
        place, slid = place + v / 50, slid + wrong(t) / 50
        told = LocalPosition(t, place + slid, v + wrong(t) + rng.normal(0.0, 0.03, 3))
        (local,) = frame.localised([told], 0.05)
        states[k] = VehicleState(t, local.p, local.v, LEVEL, np.zeros(3))
        found.append((t, *(local.v - v)[:2], *(local.p - place)[:2]))
        if k % 5:
            continue
        off = off * np.exp(-0.1 / 0.5) + noise * np.sqrt(1 - np.exp(-0.4)) * rng.normal(size=2)
        if before and sees(t):
            way = scale * (place - shown)[:2] + 0.1 * off
            flow = GroundFlow(before, t, way, HEIGHT.value)
            ground.see(flow, states[k - 5], states[k], HEIGHT)
        before, shown = t, place
        frame.by_sight = ground.decide(t).correction
    rows = np.array(found)
    return rows[:, 0], rows[:, 1:3], rows[:, 3:]


def slide(size, begin=5.0, end=12.0):
    """A velocity that goes wrong at once, and is right again."""
    return lambda t: np.array([0.0, size, 0.0]) if begin <= t < end else np.zeros(3)


def rms(errors):
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_velocity_is_corrected_within_a_second_and_let_go_again(seed):
    t, v, _ = fly(slide(0.8), seed=seed)
    assert rms(v[(t > 6.0) & (t < 12.0)]) < 0.3
    assert np.abs(v[(t > 5.95) & (t < 6.05), 1]).mean() < 0.4
    assert rms(v[t > 13.0]) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_a_right_velocity_is_left_alone(seed):
    _, v, p = fly(lambda t: np.zeros(3), seconds=60.0, seed=seed)
    _, alone, _ = fly(lambda t: np.zeros(3), seconds=60.0, sees=lambda t: False, seed=seed)
    assert rms(v - alone) < 0.05
    assert np.abs(p).max() < 0.3


def test_what_is_seen_stays_where_it_is_in_odometry():
    t, _, p = fly(slide(0.8))
    moved = np.linalg.norm(p[np.searchsorted(t, 11.9)] - p[np.searchsorted(t, 5.0)])
    assert moved < 1.6  # of 5.5 m


def test_a_camera_that_sees_no_ground_any_more_lets_the_correction_fade():
    t, v, _ = fly(slide(0.8, end=40.0), seconds=30.0, sees=lambda t: t < 8.0)
    assert abs(v[np.searchsorted(t, 8.2), 1]) < 0.4
    assert v[-1, 1] == pytest.approx(0.8, abs=0.15)


def test_nothing_is_corrected_before_a_picture_came():
    by_sight = VelocityFromGround().decide(3.0)
    assert not by_sight.correction.any()
    assert np.isfinite(by_sight.sigma)
