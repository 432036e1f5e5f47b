"""The tracker: neighbours out of sight, and when they are seen again."""

import numpy as np
import pytest

from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.drone_looks import CRUISE, LEVEL, follow, look, own, still

MANOEUVRES = TrackerConfig(keeps_on=1e-3, manoeuvres=1e6)


def stop_and_go(tracker, rng):
    """See a neighbour fly for 3 s, now at 0.2 m/s, now at 1.8; return where it is."""
    place, v = np.array([4.0, -2.0, 0.0]), 1.0
    for k in range(30):
        v = min(v + 0.3, 1.8) if k % 12 < 6 else max(v - 0.3, 0.2)
        place = place + np.array([0.0, 0.1 * v, 0.0])
        tracker.update(k / 10, [look(place, rng)], still(k / 10), LEVEL, None)
    return place


def test_a_neighbour_that_kept_on_is_remembered_to_keep_on():
    off = []
    for seed in range(20):
        tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(seed)
        for k in range(20):
            place = np.array([4.0, -1.0 + 0.1 * k, 0.0])
            tracker.update(k / 10, [look(place, rng)], still(k / 10), LEVEL, None)
        for k in range(20, 40):
            tracker.update(k / 10, [], still(k / 10), LEVEL, None)
        (lost,) = tracker.tracks()
        off.append(np.linalg.norm(lost.p - [4.0, 2.9, 0.0]))
    assert max(off) < 0.5  # one that slows down stays 0.9 m behind
    assert np.median(off) < 0.25


def test_the_memory_of_one_that_swerved_covers_that_it_stops_and_that_it_flies_on():
    for seed in range(20):
        tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(seed)
        place = stop_and_go(tracker, rng)
        (seen,) = tracker.tracks()
        for k in range(30, 45):
            tracker.update(k / 10, [], still(k / 10), LEVEL, None)
        (lost,) = tracker.tracks()
        sigma = np.sqrt(lost.P[1, 1])
        for there in (place[1] + 0.5, place[1] + 1.5 * 1.4):  # it brakes; it flies on
            assert abs(lost.p[1] - there) < 2.5 * sigma
        assert np.trace(lost.P[:3, :3]) > 10 * np.trace(seen.P[:3, :3])


def test_a_neighbour_that_is_not_where_it_would_have_kept_on_to_has_slowed_down():
    def remembered(in_view):
        tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
        for k in range(15):
            place = np.array([4.0, -1.0 + 0.1 * k, 0.0])
            tracker.update(k / 10, [look(place, rng)], still(k / 10), LEVEL, None)
        for k in range(15, 35):
            tracker.update(k / 10, [], still(k / 10), LEVEL, [False, False])
        on, slower = tracker.positions()
        assert on[1] > slower[1] + 0.1
        tracker.update(3.5, [], still(3.5), LEVEL, in_view)
        (track,) = tracker.tracks()
        return track.p[1]

    unlooked, not_on, not_slower = map(remembered, ([0, 0], [1, 0], [0, 1]))
    assert not_on < unlooked - 0.03
    assert not_slower > unlooked + 0.03


@pytest.mark.parametrize(
    ("looks", "least", "most"), [(2, 1.4, 1.9), (3, 3.0, 3.6), (4, 3.6, 4.1), (12, 3.6, 4.1)]
)
def test_the_more_looks_saw_a_neighbour_the_longer_it_is_remembered(looks, least, most):
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    list(follow(tracker, np.array([4.0, 0.0, 0.0]), CRUISE, looks, rng))
    k = looks
    while tracker.tracks():
        tracker.update(k / 10, [], own(k / 10), LEVEL, [False, False])
        k += 1
    assert least < (k - looks) / 10 <= most


@pytest.mark.parametrize(("looks", "misses"), [(1, 1), (2, 2), (3, 3), (12, 4)])
def test_a_neighbour_that_is_not_at_its_place_is_given_up(looks, misses):
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    list(follow(tracker, np.array([4.0, 0.0, 0.0]), CRUISE, looks, rng))
    for k in range(misses):
        assert len(tracker.positions()) == 2
        time = (looks + k) / 10
        tracker.update(time, [], own(time), LEVEL, [True, True])
    assert not len(tracker.positions())


@pytest.mark.parametrize(("unseen", "aside", "told"), [(0.45, 0.4, True), (1.2, 0.9, False)])
def test_where_a_neighbour_is_seen_again_is_no_velocity(unseen, aside, told):
    """It hovered, is out of view, and is seen farther aside than expected."""
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    for k in range(10):
        tracker.update(k / 10, [look(np.array([2.0, 0.0, 0.0]), rng)], still(k / 10), LEVEL, None)
    back = 0.9 + unseen
    tracker.update(back - 0.1, [], still(back - 0.1), LEVEL, None)
    tracker.update(back, [look(np.array([2.0, aside, 0.0]), rng)], still(back), LEVEL, None)
    (track,) = tracker.tracks()
    assert abs(track.v[1]) > 0.3 if told else abs(track.v[1]) < 0.1
    assert track.p[1] == pytest.approx(aside, abs=0.1)


def test_a_neighbour_that_is_seen_again_where_it_was_expected_keeps_its_velocity():
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    places = [np.array([3.0, 0.1 * k - 1.5, 0.0]) for k in range(30)]
    for k in range(15):
        tracker.update(k / 10, [look(places[k], rng)], still(k / 10), LEVEL, None)
    sure = tracker.tracks()[0].variances[2]
    tracker.update(2.2, [look(places[22], rng)], still(2.2), LEVEL, None)
    (track,) = tracker.tracks()
    assert track.v[1] == pytest.approx(1.0, abs=0.15)
    assert track.variances[2] < 4.0 * sure


def test_a_track_out_of_sight_slows_down_but_not_at_the_first_miss():
    tracker, rng = Tracker(MANOEUVRES), np.random.default_rng(3)
    for k in range(8):
        offset = np.array([4.0, -1.0 + 0.15 * k, 0.0])
        tracker.update(k / 10, [look(offset, rng)], still(k / 10), LEVEL, None)
    (seen,) = tracker.tracks()
    tracker.update(0.8, [], still(0.8), LEVEL, None)
    tracker.predict(0.83)
    assert np.allclose(tracker.tracks()[0].v, seen.v)
    for k in range(9, 18):
        tracker.update(k / 10, [], still(k / 10), LEVEL, None)
    (lost,) = tracker.tracks()
    assert np.linalg.norm(lost.v) < 0.65 * np.linalg.norm(seen.v)
    # In the second since: on at its speed for the first 0.2 to 0.3 s, then slower by damping 0.7.
    flown = np.linalg.norm(lost.p - seen.p) / np.linalg.norm(seen.v)
    assert 0.2 + (1 - np.exp(-0.56)) / 0.7 < flown < 0.3 + (1 - np.exp(-0.49)) / 0.7


@pytest.mark.parametrize("across", [0.5, 1.0, 2.0])
def test_the_less_a_neighbour_flew_along_the_nearer_to_rest_it_is_believed_to_fade(across):
    """It flies ahead at cruise and drifts aside; then it is out of sight for 2.5 s."""
    tracker, rng = Tracker(MANOEUVRES), np.random.default_rng(3)
    velocity = np.array([CRUISE[0], across, 0.0])
    list(follow(tracker, np.array([3.0, -1.5, 0.0]), velocity, 12, rng))
    for k in range(12, 37):
        tracker.update(k / 10, [], own(k / 10), LEVEL, None)
    (lost,) = tracker.tracks()
    faded = 1.0 - np.exp(-0.7 * 2.3)
    kept = (lost.v[0] / CRUISE[0] - (1.0 - faded)) / faded
    assert kept == pytest.approx(np.exp(-((across / 1.5) ** 2)), abs=0.1)
    assert lost.v[1] < 0.35 * across


def test_a_neighbour_that_flew_along_keeps_the_own_velocity_out_of_sight():
    """A drone 2 m abeam leaves the view; both fly on, then both slow down to a third."""
    tracker, rng = Tracker(MANOEUVRES), np.random.default_rng(3)
    abeam = np.array([0.3, 2.0, 0.0])
    list(follow(tracker, abeam, CRUISE, 8, rng))
    p, v = CRUISE * 0.7, CRUISE
    for k in range(8, 28):
        v = CRUISE if k < 18 else CRUISE / 3
        p = p + v * 0.1
        state = VehicleState(k / 10, p, v, LEVEL, np.zeros(3))
        tracker.update(k / 10, [], state, LEVEL, None)
    (lost,) = tracker.tracks()
    # It follows the own velocity at 0.7 1/s: of a fall by 1 m/s half is left after a second.
    assert np.linalg.norm(lost.v - v) < 0.6
    assert np.linalg.norm(lost.p - p - abeam) < 0.9  # at rest it would be 2 m behind by now


@pytest.mark.parametrize("late", [0.12, 0.2])
def test_a_track_out_of_sight_is_the_same_with_late_frames(late):
    """The last frames do not show the neighbour; each is taken `late` before its tick."""

    def known(late):
        tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
        across = np.array([0.0, 1.5, 0.0])
        for k in range(20):
            offset = np.array([4.0, -1.0, 0.0]) + (across - CRUISE) * k / 10
            seen = [look(offset, rng)] if k < 10 else []
            tracker.update(k / 10, seen, own(k / 10), LEVEL, None)
            tracker.predict(k / 10 + late)
        tracker.predict(1.9)
        (track,) = tracker.tracks()
        return track

    early, behind = known(0.0), known(late)
    assert np.allclose(behind.v, early.v, rtol=0.05)
    assert np.allclose(np.diag(behind.P), np.diag(early.P), rtol=0.05)
