"""The tracker: velocities head on and behind another drone; who is a neighbour; its covariance."""

import numpy as np
import pytest

from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.types import Detection
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.drone_looks import CRUISE, LEVEL, follow, look, own, still


def test_the_velocity_of_an_oncoming_neighbour_is_known_within_half_a_second():
    errors, parted = [], 0
    for seed in range(60):
        tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(seed)
        *_, tracks = follow(tracker, np.array([6.0, 0.3, 0.0]), -CRUISE, 6, rng)
        parted += len(tracks) > 1
        errors.append(min(float(np.linalg.norm(t.v + CRUISE)) for t in tracks))
    assert np.sqrt(np.mean(np.square(errors))) < 0.5
    assert parted == 0


def test_a_neighbour_that_comes_before_another_does_not_take_its_track():
    tracker, rng = Tracker(TrackerConfig(gate=11.3, damping=0.0)), np.random.default_rng(3)
    *_, (behind,) = follow(tracker, np.array([6.3, 0.0, 0.0]), CRUISE, 4, rng)
    for k in range(5, 8):
        tracker.update(k / 10, [look(np.array([4.0, 0, 0]), rng)], own(k / 10), LEVEL, None)
    speeds = {t.id: float(np.linalg.norm(t.v - CRUISE)) for t in tracker.tracks()}
    assert len(speeds) == 2
    assert behind.id in speeds
    assert max(speeds.values()) < 1.0


def test_a_half_hidden_neighbour_is_not_taken_for_another_that_went_out_of_sight():
    """A drone 1.3 m away leaves the view; a second later half of another shows 50° beside it."""
    tracker, rng = Tracker(TrackerConfig(damping=0.0)), np.random.default_rng(3)
    *_, (gone,) = follow(tracker, np.array([0.6, -1.1, 0.0]), CRUISE, 8, rng)
    half = np.array([2.6, -0.6, 0.0])
    for k in range(18, 20):
        tracker.update(k / 10, [look(half, rng, share=0.6)], own(k / 10), LEVEL, None)
    (left,) = (t for t in tracker.tracks() if t.id == gone.id)
    assert np.linalg.norm(left.p - CRUISE * 1.9 - [0.6, -1.1, 0.0]) < 0.5
    assert np.linalg.norm(left.v - CRUISE) < 0.7


def test_the_end_of_one_track_leaves_the_others_as_they_are():
    def known(ghost_until):
        tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
        for k in range(30):
            seen = [look(np.array([4.0, -1.0 + 0.1 * k, 0.0]), rng)]
            if k < ghost_until:
                aside = np.array([3.0, -5.0, 0.0])
                seen.append(Detection(aside / np.linalg.norm(aside), 5.8, 0.005, 0.05))
            in_view = [True] * len(tracker.positions())
            tracker.update(k / 10, seen, still(k / 10), LEVEL, in_view)
            tracker.predict(k / 10 + 0.05)
        (track,) = tracker.tracks()
        return track

    alone, beside = known(0), known(6)
    assert np.allclose(beside.p, alone.p)
    assert np.allclose(beside.v, alone.v)
    assert np.allclose(beside.P, alone.P)


@pytest.mark.parametrize(("share", "looks"), [(0.99, 2), (1.01, 4)])
def test_looks_that_are_not_clear_make_a_neighbour_later(share, looks):
    """Each after the first counts 0.3 of log 17: three are more than log 9, of 0.9."""
    tracker, found = Tracker(config := TrackerConfig()), []
    for k in range(5):
        seen = Detection(np.array([1.0, 0.0, 0.0]), 4.0, 0.003, share * config.clear * 4.0)
        tracker.update(k / 10, [seen], own(k / 10), LEVEL, None)
        found.append(len(tracker.tracks()))
    assert found == [int(k + 1 >= looks) for k in range(5)]


def test_looks_in_different_directions_are_not_one_neighbour_where_the_camera_is():
    """Of two drones little more is seen than in which direction they are."""
    tracker = Tracker(TrackerConfig())
    ahead, aside = np.array([1.0, 0.0, 0.0]), np.array([0.6, 0.8, 0.0])
    for k in range(6):
        seen = [Detection(ahead if k % 2 else aside, 3.5, 0.003, 2.5)]
        tracker.update(k / 10, seen, still(k / 10), LEVEL, None)
        assert np.linalg.norm(tracker.positions(), axis=1).min() > 3.0


@pytest.mark.parametrize(("lasting", "least", "most"), [(0.0, 0.4, 4.0), (1.0, 0.0, 0.1)])
def test_a_range_that_drifts_as_less_is_hidden_is_no_velocity(lasting, least, most):
    """A neighbour hovers 3 m away; as it comes out from behind a trunk its range looks shorter."""
    tracker = Tracker(TrackerConfig())
    for k in range(8):
        away = 3.0 + max(3.0 - 0.5 * k, 0.0)
        sigma = 0.3 * away
        seen = Detection(np.array([1.0, 0.0, 0.0]), away, 0.003, sigma, 1.0, lasting * sigma)
        tracker.update(k / 10, [seen], still(k / 10), LEVEL, None)
        if k == 5:
            (track,) = tracker.tracks()
            assert least <= np.linalg.norm(track.v) <= most
    assert abs(tracker.tracks()[0].p[0] - 3.0) < 0.8


def test_a_miss_undoes_more_than_two_looks_that_are_not_clear():
    """log(1 - 0.85) is -1.9, such a look 0.85."""
    tracker = Tracker(config := TrackerConfig())
    for k in range(30):
        seen = Detection(np.array([1.0, 0.0, 0.0]), 4.0, 0.003, 1.01 * config.clear * 4.0)
        shown = [True] * len(tracker.positions())
        tracker.update(k / 10, [seen] if k % 3 else [], own(k / 10), LEVEL, shown)
        assert not tracker.tracks()


def test_a_neighbour_that_attacks_at_five_metres_a_second_keeps_its_track():
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    velocity = np.array([-5.0, 0.4, 0.0])
    named = {t.id for tracks in follow(tracker, np.array([13.0, 0.0, 0.0]), velocity, 16, rng)
             for t in tracks}  # fmt: skip
    (track,) = tracker.tracks()
    assert named == {track.id}
    assert np.linalg.norm(track.v - velocity) < 0.7


def test_a_neighbour_that_comes_out_from_behind_another_is_tracked_as_half_as_fast_as_it_looks():
    """It hovers 4.4 m away; half of it looks 8 m away, then more and more of it shows: 6 m/s."""
    tracker, still = Tracker(TrackerConfig()), np.zeros(3)
    for k in range(12):
        away = 8.0 - 0.6 * min(k, 6)
        seen = Detection(np.array([1.0, 0.0, 0.0]), away, 0.003, sigma_range=0.1 * away)
        state = VehicleState(k / 10, still, still, LEVEL, still)
        tracker.update(k / 10, [seen], state, LEVEL, None)
        assert all(np.linalg.norm(t.v) <= 3.6 for t in tracker.tracks())
    (track,) = tracker.tracks()
    assert abs(track.p[0] - away) < 0.5


@pytest.mark.parametrize("late", [0.03, 0.12, 0.18, 0.23])
def test_frames_that_come_late_do_not_slow_a_track_down(late):
    """Each tick has the frame taken `late` before it; a drone keeps 4 m ahead at cruise."""
    tracker = Tracker(TrackerConfig())
    for k in range(20):
        offset = np.array([4.0, 0.0, 0.0])
        seen = Detection(offset / 4, 4.0, sigma_bearing=0.003, sigma_range=0.02)
        tracker.update(k / 10 - late, [seen], own(k / 10 - late), LEVEL, None)
        tracker.predict(k / 10)
    (track,) = tracker.tracks()
    assert np.linalg.norm(track.v - CRUISE) < 0.05
    assert np.linalg.norm(track.p - CRUISE * 1.9 - offset) < 0.05


def test_the_covariance_stays_symmetric_and_positive():
    """A neighbour circles for minutes, in and out of view."""
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(1)
    for k in range(1000):
        time = k / 10
        still = VehicleState(time, np.zeros(3), np.zeros(3), LEVEL, np.zeros(3))
        around = np.array([4.0 * np.cos(0.3 * time), 4.0 * np.sin(0.3 * time), 0.5])
        place = around + 0.02 * rng.standard_normal(3)
        away = float(np.linalg.norm(place))
        seen = Detection(place / away, away, sigma_bearing=0.003, sigma_range=0.02 * away)
        tracker.update(time, [seen] * (rng.random() > 0.3), still, LEVEL, None)
        tracker.predict(time + 0.02)
        for track in tracker.tracks():
            np.testing.assert_allclose(track.P, track.P.T, atol=1e-9)
            assert np.linalg.eigvalsh(track.P).min() > 0.0


def test_a_time_before_the_last_frame_carries_the_places_back():
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    list(follow(tracker, np.array([4.0, 0.0, 0.0]), CRUISE, 12, rng))
    (now,) = tracker.tracks()
    tracker.predict(0.9)
    (then,) = tracker.tracks()
    assert then.p == pytest.approx(now.p - 0.2 * now.v)
    assert then.v == pytest.approx(now.v)
    assert pytest.approx(now.P, rel=0.01) == then.P


@pytest.mark.parametrize("dt", [0.25, 1.0, 2.0])
def test_tracks_are_carried_to_the_time_that_is_asked_for(dt):
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(6)
    *_, (before,) = follow(tracker, np.array([6.0, 0.3, 0.0]), -CRUISE, 8, rng)
    tracker.predict(0.7 + dt)
    (after,) = tracker.tracks()
    assert (after.p - before.p)[0] < -0.7 * dt
    assert after.P[0, 0] > before.P[0, 0]


def test_one_look_that_may_be_either_of_two_neighbours_is_of_one():
    tracker, still = Tracker(TrackerConfig()), np.zeros(3)

    def see(k, *places):
        looks = [
            Detection(np.array(p) / np.linalg.norm(p), float(np.linalg.norm(p)), 0.06, 0.4)
            for p in places
        ]
        tracker.update(k / 10, looks, VehicleState(k / 10, still, still, LEVEL, still), LEVEL, None)

    for k in range(12):
        see(k, [4.0, 0.3, 0.0], [4.0, -0.3, 0.0])
    see(12, [4.0, 0.05, 0.0])
    assert sorted(t.unseen for t in tracker.tracks()) == pytest.approx([0.0, 0.1])


@pytest.mark.parametrize("size_sigma", [0.0, 0.4])
def test_courses_are_those_of_the_tracks(size_sigma):
    config = TrackerConfig(size_sigma=size_sigma)
    tracker, rng = Tracker(config), np.random.default_rng(3)
    assert tracker.courses()[0] == []
    *_, _ = follow(tracker, np.array([6.3, 0.4, 0.1]), 0.5 * CRUISE, 8, rng)
    tracker.update(0.8, [look(np.array([3.0, -2.0, 0.0]), rng)], own(0.8), LEVEL, None)
    tracks = tracker.tracks()
    ids, places, velocities = tracker.courses()
    assert ids == [t.id for t in tracks] != []
    assert places == pytest.approx(np.array([t.p for t in tracks]), abs=1e-12)
    assert velocities == pytest.approx(np.array([t.v for t in tracks]), abs=1e-12)


def test_who_was_seen_lately_is_told_before_it_is_sure_that_it_is_there():
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    tracker.update(0.0, [look(np.array([4.0, 0.0, 0.0]), rng)], still(0.0), LEVEL)
    assert tracker.tracks() == []
    assert [t.confirmed for t in tracker.lately()] == [False]
    tracker.update(0.1, [look(np.array([4.0, 0.0, 0.0]), rng)], still(0.1), LEVEL)
    assert [t.confirmed for t in tracker.lately()] == [True]
    tracker.predict(0.7)
    assert len(tracker.tracks()) == 1
    assert tracker.lately() == []


@pytest.mark.parametrize(("unseen", "kept"), [(0.3, 0), (0.8, 1)])
def test_where_only_those_seen_lately_were_looked_for_others_are_not_missed(unseen, kept):
    tracker, rng = Tracker(TrackerConfig()), np.random.default_rng(3)
    list(follow(tracker, np.array([4.0, 0.0, 0.0]), CRUISE, 2, rng))
    for k in range(3):
        time = 0.1 + unseen + 0.01 * k
        tracker.update(time, [], own(time), LEVEL, [True, True], partly=True)
        if not len(tracker.positions()):
            break
    assert len(tracker.positions()) == 2 * kept


@pytest.mark.parametrize(
    ("lasting", "sigma", "share"), [(0.0, 0.0, 0.0), (0.1, 0.2, 0.25), (0.3, 0.2, 1.0)]
)
def test_the_share_of_a_range_that_lasts_is_at_most_all_of_it(lasting, sigma, share):
    seen = Detection(np.array([1.0, 0.0, 0.0]), 3.0, 0.003, sigma, 1.0, lasting)
    assert seen.lasting == pytest.approx(share)
