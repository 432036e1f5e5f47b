"""Places of landmarks, which the drift of the own pose moves together."""

import numpy as np
import pytest

from companion.estimation.landmark_places import Drift, LandmarkPlaces

PLACES = np.array([[4.0, 1.0], [5.0, -2.0], [-6.0, 0.5]])
SIGMA = 0.1


def known(*places):
    """Landmarks that were seen often enough to be sure."""
    k = LandmarkPlaces()
    for n, place in enumerate(places):
        k.add(tuple(place), SIGMA**2)
        for _ in range(20):
            k.correct(n, tuple(place), SIGMA**2, 1e-4)
    return k


def test_a_look_at_two_landmarks_moves_the_third_which_is_behind_the_drone():
    shift, k = np.array([0.4, -0.3]), known(*PLACES)
    for step in range(1, 21):  # the own position drifts; the third landmark is out of view
        k.drift((0.0, 0.0), Drift(0.05, 0.0))
        for n in (0, 1):
            k.correct(n, tuple(PLACES[n] + shift * step / 20), SIGMA**2, 1e-4)
    assert k.place(2) == pytest.approx(PLACES[2] + shift, abs=0.12)
    assert k.variance(2) < 2 * 0.05**2 * 20  # far less than the drift alone would make it


def test_a_turn_of_the_own_heading_turns_what_is_not_seen():
    k, turn = known(*PLACES), 0.1
    c, s = np.cos(turn), np.sin(turn)
    turned = PLACES @ np.array([[c, s], [-s, c]])
    for _ in range(1, 21):
        k.drift((0.0, 0.0), Drift(0.002, 0.03))
        for n in (0, 1):
            k.correct(n, tuple(turned[n]), 0.03**2, 1e-4)
    assert k.place(2) == pytest.approx(turned[2], abs=0.15)


def test_what_is_out_of_sight_grows_doubtful_and_what_is_seen_does_not():
    k = known(*PLACES)
    for _ in range(100):
        k.drift((0.0, 0.0), Drift(0.03, 0.0))
    assert k.variance(2) == pytest.approx(100 * 0.03**2, rel=0.1)
    for _ in range(20):
        k.correct(2, tuple(PLACES[2]), SIGMA**2, 1e-4)
    assert k.variance(2) < 0.05**2


def test_a_landmark_that_goes_leaves_the_others_as_they_are():
    k = known(*PLACES)
    k.keep([0, 2])
    assert len(k) == 2
    assert k.place(1) == pytest.approx(PLACES[2])
