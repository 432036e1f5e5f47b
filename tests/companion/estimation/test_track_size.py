"""Tracks of neighbours of unknown size: what own motion tells of it, and how doubtful it stays."""

import numpy as np
import pytest

from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.types import Detection
from mavlink_bridge.wire.messages import VehicleState

LEVEL, STILL = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
SIGMA = 0.4  # share, of the sizes
SHARE = 0.03  # 1 σ of a range over the range


def weaving(time):
    """Own velocity [m/s] of a drone that weaves along."""
    return np.array([0.5, 1.2 * np.sin(1.1 * time), 0.0])


def straight(time):
    return np.array([0.0, 1.0, 0.0])


def hovering(time):
    return STILL


def follow(flown, size, seed, seconds, origin=STILL, size_sigma=SIGMA):
    """Return the track, the true place and own place after looks at 10 Hz at one neighbour."""
    rng = np.random.default_rng(seed)
    tracker = Tracker(TrackerConfig(size_sigma=size_sigma))
    place = origin + np.array([rng.uniform(4, 7), *rng.uniform(-2, 2, 2)])
    here, v = np.array(origin, float), rng.normal(0, [0.5, 0.5, 0.15])
    for k in range(round(seconds * 10)):
        own = flown(k / 10)
        here, place = here + own / 10, place + v / 10
        away = float(np.linalg.norm(place - here))
        ray = (place - here) / away + rng.normal(0, 0.004, 3)
        looks = away / size * (1 + SHARE * rng.standard_normal())
        seen = Detection(ray / np.linalg.norm(ray), looks, 0.005, SHARE * looks)
        tracker.update(k / 10, [seen], VehicleState(k / 10, here, own, LEVEL, STILL), LEVEL, None)
    (track,) = tracker.tracks()
    return track, place, here


def range_errors(flown, seconds, size_sigma=SIGMA):
    """Return errors of range over range, and over their own 1 σ, for 30 neighbours."""
    shares, normalised = [], []
    for seed in range(30):
        size = float(np.exp(np.random.default_rng([seed, 1]).normal(0, SIGMA)))
        track, place, here = follow(flown, size, seed, seconds, size_sigma=size_sigma)
        away = place - here
        ray = away / np.linalg.norm(away)
        error = float((track.p - place) @ ray)
        shares.append(error / np.linalg.norm(away))
        normalised.append(error / np.sqrt(ray @ track.P[:3, :3] @ ray))
    return np.array(shares), np.array(normalised)


def test_weaving_tells_size_and_range_with_honest_doubt():
    early, _ = range_errors(weaving, 0.3)
    shares, normalised = range_errors(weaving, 5.0)
    assert np.sqrt(np.mean(early**2)) > 0.25
    assert np.sqrt(np.mean(shares**2)) < 0.15
    assert np.mean(np.abs(normalised) < 2.0) > 0.9


@pytest.mark.parametrize("flown", [straight, hovering])
def test_without_own_acceleration_the_range_stays_doubtful(flown):
    """Linear states: nothing is learnt from noise, as an extended filter of the size's log does."""
    _, normalised = range_errors(flown, 5.0)
    assert np.sqrt(np.mean(normalised**2)) < 1.3
    track, _, here = follow(flown, 1.0, 0, 5.0)
    away = np.linalg.norm(track.p - here)
    assert np.sqrt(np.trace(track.P[:3, :3])) > 0.3 * away


def test_a_tracker_that_believes_in_one_size_is_wrong_and_sure():
    _, normalised = range_errors(weaving, 5.0, size_sigma=0.0)
    assert np.mean(np.abs(normalised) < 2.0) < 0.3


def test_where_the_flight_is_does_not_matter():
    near, place, _ = follow(weaving, 1.6, 3, 3.0)
    far, moved, _ = follow(weaving, 1.6, 3, 3.0, origin=np.array([300.0, -200.0, 20.0]))
    assert np.allclose(far.p - moved, near.p - place, atol=1e-4)
    assert np.allclose(far.P, near.P, rtol=1e-3, atol=1e-6)
    assert far.scale == pytest.approx(near.scale, rel=1e-4)


def test_a_neighbour_out_of_sight_is_remembered_and_its_speed_fades():
    tracker = Tracker(TrackerConfig(size_sigma=SIGMA, keeps_on=1e-3, manoeuvres=1e6))
    for k in range(12):
        offset = np.array([4.0, 0.1 * k, 0.0])
        away = float(np.linalg.norm(offset))
        seen = [Detection(offset / away, away, 0.005, SHARE * away)]
        tracker.update(k / 10, seen, VehicleState(k / 10, STILL, STILL, LEVEL, STILL), LEVEL, None)
    (before,) = tracker.tracks()
    for k in range(12, 24):
        tracker.update(k / 10, [], VehicleState(k / 10, STILL, STILL, LEVEL, STILL), LEVEL, None)
    (after,) = tracker.tracks()
    assert 0.3 < after.p[1] - before.p[1] < 1.2
    assert np.linalg.norm(after.v) < 0.55 * np.linalg.norm(before.v)
