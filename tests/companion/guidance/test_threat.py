"""Threat: how neighbours are rated, and in which order they come."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.guidance.threat import ThreatConfig, rated_neighbours, threat
from tests.companion.tracks import OWN, track

CONFIG, D_REF = ThreatConfig(), 2.0
NUMBER = st.floats(-12, 12)


def rated(p, v=(0.0, 0.0, 0.0)):
    return threat(OWN, np.array(p, float), np.array(v, float), D_REF, CONFIG)


def test_nearer_and_faster_closing_are_worse():
    assert rated([2, 0, 0]) > rated([3, 0, 0])
    assert rated([3, 0, 0], [-1, 0, 0]) > rated([3, 0, 0], [1, 0, 0])


def test_a_near_neighbour_that_flies_along_is_worse_than_a_far_one_that_closes():
    assert rated([0, 0.8, 0], [1.5, 0, 0]) > rated([3.0, 0, 0])


def test_the_threat_of_a_neighbour_at_the_own_place_is_finite():
    assert np.isfinite(rated([0, 0, 0]))


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER, NUMBER, NUMBER), max_size=9), st.randoms())
def test_the_worst_comes_first_in_whatever_order_tracks_are_given(places, random):
    tracks = [track(n, p[:3], [p[3], p[4], 0.0]) for n, p in enumerate(places)]
    worst = rated_neighbours(OWN, tracks, D_REF, CONFIG)
    shuffled = list(tracks)
    random.shuffle(shuffled)
    assert [t.id for t, _ in rated_neighbours(OWN, shuffled, D_REF, CONFIG)] == [
        t.id for t, _ in worst
    ]
    assert all(np.linalg.norm(t.p) <= CONFIG.range_max for t, _ in worst)
    values = [value for _, value in worst]
    assert values == sorted(values, reverse=True)
