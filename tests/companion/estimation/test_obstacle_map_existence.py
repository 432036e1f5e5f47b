"""The obstacle map: which trunks it takes for being there, and for how long."""

import numpy as np
import pytest

from tests.companion.estimation.trunk_looks import MISSES, hide, odds, see, seen_times, trunk


@pytest.mark.parametrize(
    ("looks", "later", "left"),
    [(3, 1.72, 1), (3, 1.73, 0), (5, 2.69, 1), (5, 2.70, 0), (6, 2.70, 1), (6, 99.0, 1)],
)
def test_a_trunk_of_few_looks_is_forgotten_soon(looks, later, left):
    """One that just counts after 1.5 s, others in proportion to the log of their odds."""
    known = seen_times(looks, trunk(4.0))
    assert len(see(known, time=later, visibility=hide)) == left


def test_the_time_unseen_counts_from_the_last_look():
    known = seen_times(4, trunk(4.0))
    see(known, trunk(4.0), time=1.0)
    assert len(see(known, time=2.4, visibility=hide)) == 1


def test_the_odds_of_a_trunk_rise_by_looks_and_fall_by_misses_until_it_is_unlikely():
    look, miss = np.log(0.7 / 0.17), np.log(1.0 - 0.7)
    known = seen_times(6, trunk(4.0))
    assert odds(0.2) + 5 * look < odds(0.999) < odds(0.2) + 6 * look
    for n in range(3):
        assert known._landmarks[0].odds == pytest.approx(odds(0.999) + n * miss)
        see(known, depth=True)
    see(known, trunk(4.0))
    after = odds(0.999) + 3 * miss + look
    assert known._landmarks[0].odds == pytest.approx(after)
    assert after + 5 * miss > odds(0.1) > after + 6 * miss
    assert [len(see(known, depth=True)) for _ in range(6)] == [1, 1, 1, 1, 1, 0]


def test_a_place_that_shows_in_part_is_missed_in_part():
    known = seen_times(6, trunk(4.0))
    see(known, depth=True, visibility=lambda places: np.full(len(places), 0.4))
    assert known._landmarks[0].odds == pytest.approx(odds(0.999) + np.log(1.0 - 0.4 * 0.7))


def test_eyes_that_see_a_trunk_every_second_time_keep_it():
    known = seen_times(6, trunk(4.0))
    for _ in range(200):
        see(known, depth=True)
        assert len(see(known, trunk(4.0))) == 1


def test_a_trunk_known_for_good_stays_where_no_trunk_at_all_is_seen_any_more():
    """Eyes that fail are likelier than a trunk that is gone."""
    known = seen_times(6, trunk(4.0))
    assert not known.blank
    told = []
    for _ in range(9):
        assert len(see(known)) == 1
        told.append(known.blank)
    assert told == [False] + 8 * [True]
    see(known, trunk(4.0))
    assert not known.blank


@pytest.mark.parametrize("others", [[], [trunk(4.0, left=-2.5)]])
def test_a_trunk_of_few_looks_or_beside_one_that_is_seen_is_missed(others):
    looks, misses = (6, MISSES) if others else (5, 7)
    known = seen_times(looks, trunk(4.0), *others)
    left = [len(see(known, *others)) - len(others) for _ in range(misses)]
    assert left == [1] * (misses - 1) + [0]
    assert not known.blank


def test_eyes_do_not_fail_where_the_trunk_is_out_of_view_or_hidden():
    known = seen_times(6, trunk(4.0))
    for _ in range(4):
        see(known, yaw=np.pi)
        see(known, visibility=lambda places: 0.4 * np.ones(len(places)))
        assert not known.blank


def test_a_new_trunk_has_not_been_missed_yet():
    known = seen_times(1, trunk(4.0), ghosts=1e-4)
    left = [len(see(known, depth=True)) for _ in range(MISSES)]
    assert left == [1] * (MISSES - 1) + [0]


@pytest.mark.parametrize(("distance", "left"), [(19.9, 1), (20.1, 0)])
def test_a_trunk_is_kept_up_to_20_m(distance, left):
    known = seen_times(6, trunk(4.0))
    assert len(see(known, at=(4.0 - distance, 0.0), visibility=hide)) == left


@pytest.mark.parametrize(
    ("distance", "left"),
    [(6.1, 1), (5.9, 0), (0.85, 0), (0.75, 1)],  # within 0.3 m of its surface it fills the view
)
def test_a_trunk_must_be_seen_within_6_m_unless_it_is_very_near(distance, left):
    known = seen_times(6, trunk(4.0))
    for _ in range(MISSES):
        found = see(known, at=(4.0 - distance, 0.0), depth=True)
    assert len(found) == left


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("aside", "left"), [(0.78, 0), (0.82, 1)])
def test_a_trunk_must_be_seen_up_to_02_rad_from_the_edge_of_the_view(side, aside, left):
    known = seen_times(6, trunk(4.0))
    for _ in range(MISSES):
        found = see(known, yaw=side * aside, half_view=1.0, depth=True)
    assert len(found) == left


def test_the_frame_tells_how_far_it_shows_the_axis_at_the_height_of_the_drone():
    known, asked = seen_times(6, trunk(4.0)), []
    see(known, visibility=lambda places: asked.append(places) or np.zeros(len(places)))
    assert np.concatenate(asked) == pytest.approx(np.array([[4.0, 0.0, 2.0]]))


def test_a_farther_trunk_does_not_cover_a_nearer_one():
    known = seen_times(6, trunk(3.0), trunk(5.0))
    for _ in range(MISSES):
        found = see(known, trunk(5.0))
    assert found[:, 0] == pytest.approx([5.0])
