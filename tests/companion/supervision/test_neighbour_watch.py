"""The neighbour watch at its bounds: what counts as broken, and whose speed is measured."""

import numpy as np
import pytest

from companion.supervision.neighbour_watch import NeighbourWatch
from companion.types import Track


def track(p, v=(0.0, 0.0, 0.0), sigma=0.01, name=3, age=9.0, unseen=0.0, sigma_v=0.0):
    covariance = np.diag([sigma**2] * 3 + [sigma_v**2] * 3)
    return Track(name, np.array(p, float), np.array(v, float), covariance, age, unseen)


def watch():
    return NeighbourWatch(acceleration=2.0, speed=3.0)


def after(dt, first, last, others=()):
    """Return what the watch says of two looks at one neighbour, `dt` s apart."""
    it = watch()
    it.update(10.0, [first, *others])
    return it.update(10.0 + dt, [last, *others])


def moved(x, dt=0.5, v=0.0, sigma=0.0, last=0.0, **more):
    first, then = track((0, 0, 2), (v, 0, 0), sigma), track((x, 0, 2), (last, 0, 0), sigma, **more)
    return after(dt, first, then)


def test_a_speed_counts_over_a_quarter_of_a_second_at_least():
    assert moved(9.0, dt=0.24).broken == ()
    assert moved(9.0, dt=0.25).broken == ("neighbour 3: 36.0 m/s, 3 m/s are assumed",)
    assert len(moved(9.0, dt=0.5).broken) == 1


def test_a_look_counts_for_half_a_second():
    it = watch()
    it.update(10.0, [track((9.0, 0.0, 2.0))])
    it.update(10.3, [track((0.0, 0.0, 2.0))])
    assert it.update(10.51, [track((0.0, 0.0, 2.0))]).broken == ()


@pytest.mark.parametrize(("speed", "broken"), [(2.99, 0), (3.01, 1)])
def test_a_speed_up_to_the_bound_is_within_it(speed, broken):
    assert len(moved(0.5 * speed, v=speed, last=speed).broken) == broken


@pytest.mark.parametrize(("sigma", "broken"), [(0.05, 1), (0.06, 0)])
def test_a_speed_is_broken_beyond_three_sigma(sigma, broken):
    """4 m/s of mean speed; its σ is √2 × σ / 0.5 s: 0.24 m/s, or more than a third of 1 m/s."""
    doubt = 3.0 * np.sqrt(2.0) * sigma / 0.5
    assert (doubt < 0.5) == (sigma == 0.05)
    assert len(moved(1.75, sigma=sigma, v=3.5).broken) == broken


# Off its course by 2 m/s² for 0.5 s, and for 0.2 s that its track may not know: 0.35 m in 0.5 s.
@pytest.mark.parametrize(("off", "broken"), [(0.44, 0), (0.46, 1)])
@pytest.mark.parametrize("v", [0.0, 1.0])
def test_a_turn_off_the_course_up_to_the_bound_is_within_it(off, broken, v):
    found = after(
        0.5, track((0, 0, 2), (v, 0, 0), 0.0), track((0.5 * v, off, 2), (v, 0, 0), 0.0)
    ).broken
    assert len(found) == broken
    if broken:
        more = off / (0.5 * 0.25 + 0.2 * 0.5)
        assert found == (f"neighbour 3: {more:.1f} m/s² off its course, 2 m/s² are assumed",)


def test_the_doubt_of_place_and_speed_widens_the_course():
    before, then = track((0, 0, 2), sigma=0.03, sigma_v=0.1), track((0, 0.7, 2), sigma=0.04)
    spread = 3.0 * np.sqrt(0.03**2 + 0.05**2 + 0.04**2)
    assert 0.45 + spread < 0.7
    assert len(after(0.5, before, then).broken) == 1
    then = track((0, 0.45 + spread - 0.01, 2), sigma=0.04)
    assert after(0.5, before, then).broken == ()
    then = track((0, 0.45 + spread + 0.01, 2), sigma=0.04)
    assert len(after(0.5, before, then).broken) == 1


@pytest.mark.parametrize(("mean", "counts"), [(1.49, False), (1.51, True)])
def test_a_mean_speed_counts_where_it_is_half_a_metre_a_second_faster(mean, counts):
    (t,) = moved(0.5 * mean, last=1.0, v=mean).tracks
    assert t.v == pytest.approx([mean if counts else 1.0, 0, 0])


def test_a_mean_speed_counts_beyond_its_doubt():
    doubt = 3.0 * np.sqrt(2.0) * 0.02 / 0.5
    for more, counts in ((-0.02, False), (0.02, True)):
        mean = 1.5 + doubt + more
        (t,) = moved(0.5 * mean, last=1.0, v=mean, sigma=0.02).tracks
        assert (t.v[0] == pytest.approx(mean)) == counts


def test_the_place_of_a_track_and_the_other_tracks_stay_as_they_are():
    other = track((7, 7, 2), name=8)
    found = after(0.5, track((0, 0, 2)), track((2, 0, 2), sigma=0.01), [other]).tracks
    assert [t.id for t in found] == [3, 8]
    assert found[0].p.tolist() == [2, 0, 2]
    assert found[1] is other


@pytest.mark.parametrize(("unseen", "broken"), [(0.15, 1), (0.16, 0)])
def test_where_memory_puts_a_track_is_no_evidence(unseen, broken):
    assert len(moved(5.0, unseen=unseen).broken) == broken
    it = watch()
    it.update(10.0, [track((0, 0, 2))])
    it.update(10.1, [track((0, 0, 2), unseen=unseen)])
    assert len(it.update(10.4, [track((5, 0, 2))]).broken) == broken


def test_tracks_are_told_apart_by_their_ids():
    it = watch()
    it.update(10.0, [track((0, 0, 2), name=1), track((5, 0, 2), name=2)])
    assert it.update(10.5, [track((5, 0, 2), name=2), track((0, 0, 2), name=1)]).broken == ()
    found = it.update(10.9, [track((5, 0, 2), name=1), track((0, 0, 2), name=2)]).broken
    assert [words.partition(":")[0] for words in found] == ["neighbour 1", "neighbour 2"]


def test_reset_forgets():
    it = watch()
    it.update(10.0, [track((0, 0, 2))])
    it.reset()
    found = it.update(10.4, [track((5, 0, 2), name=9)])
    assert (found.broken, [t.id for t in found.tracks]) == ((), [9])


def ended(later, **more):
    """Return the rest of a track of 1 m/s that ended."""
    it = watch()
    it.update(10.0, [track((0, 0, 2), (1, 0, 0), **more)])
    return it.update(10.0 + later, []).tracks


@pytest.mark.parametrize(("age", "kept"), [(0.5, 1), (0.49, 0)])
def test_a_track_that_lived_for_half_a_second_was_no_ghost(age, kept):
    assert len(ended(0.1, age=age)) == kept


@pytest.mark.parametrize(("later", "unseen", "kept"), [
    (0.99, 0.0, 1), (1.01, 0.0, 0), (0.09, 0.9, 1), (0.11, 0.9, 0),
])  # fmt: skip
def test_an_ended_track_counts_for_a_second_after_it_was_seen(later, unseen, kept):
    found = ended(later, unseen=unseen)
    assert len(found) == kept
    for t in found:
        assert t.p.tolist() == pytest.approx([later, 0.0, 2.0])
        assert t.unseen == pytest.approx(unseen + later)


def test_an_ended_track_counts_on_from_tick_to_tick():
    it = watch()
    it.update(10.0, [track((0, 0, 2), (1, 0, 0)), track((5, 5, 2), name=4)])
    places = [
        [t.p[0] for t in it.update(10.0 + 0.3 * n, [track((5, 5, 2), name=4)]).tracks[1:]]
        for n in range(1, 5)
    ]
    assert places == [[pytest.approx(0.3)], [pytest.approx(0.6)], [pytest.approx(0.9)], []]


@pytest.mark.parametrize(("place", "age", "names"), [
    ((0.2, 0.99, 2.0), 0.0, [9]),
    ((0.2, 1.01, 2.0), 0.0, [9, 3]),
    ((0.2, 0.0, 2.0), 0.69, [9]),
    ((0.2, 0.0, 2.0), 0.71, [9, 3]),
    ((1.21, 0.0, 2.0), 0.0, [9, 3]),
])  # fmt: skip
def test_a_new_track_within_a_metre_is_the_same_neighbour(place, age, names):
    it = watch()
    it.update(10.0, [track((0, 0, 2), (1, 0, 0))])
    found = it.update(10.2, [track(place, name=9, age=age)]).tracks
    assert [t.id for t in found] == names
    # One that was taken for the same stays so.
    later = it.update(10.3, [track((8, 8, 2), name=9, age=1.0)]).tracks
    assert [t.id for t in later] == names
