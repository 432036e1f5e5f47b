"""Places of landmarks, which the drift of the own pose moves together."""

import numpy as np
import pytest

from companion.estimation.landmark_places import Drift, Foot, LandmarkPlaces, Look

PLACES = np.array([[4.0, 1.0], [5.0, -2.0], [-6.0, 0.5]])
SIGMA = 0.1


def look(place, sigma=SIGMA):
    """A look from the origin, as sure along the line of sight as across it."""
    return Look(np.zeros(2), np.array(place), sigma, sigma)


def known(*places):
    """Landmarks that were seen often enough to be sure."""
    k = LandmarkPlaces()
    for n, place in enumerate(places):
        k.add(look(place))
        for _ in range(20):
            k.correct(n, look(place), 1e-4)
    return k


def test_a_look_at_two_landmarks_moves_the_third_which_is_behind_the_drone():
    shift, k = np.array([0.4, -0.3]), known(*PLACES)
    for step in range(1, 21):  # the own position drifts; the third landmark is out of view
        k.drift((0.0, 0.0), Drift(0.05, 0.0))
        for n in (0, 1):
            k.correct(n, look(PLACES[n] + shift * step / 20), 1e-4)
    assert k.places()[2] == pytest.approx(PLACES[2] + shift, abs=0.12)
    assert k.variances()[2] < 2 * 0.05**2 * 20  # far less than the drift alone would make it


def test_a_turn_of_the_own_heading_turns_what_is_not_seen():
    k, turn = known(*PLACES), 0.1
    c, s = np.cos(turn), np.sin(turn)
    turned = PLACES @ np.array([[c, s], [-s, c]])
    for _ in range(1, 21):
        k.drift((0.0, 0.0), Drift(0.002, 0.03))
        for n in (0, 1):
            k.correct(n, look(turned[n], 0.03), 1e-4)
    assert k.places()[2] == pytest.approx(turned[2], abs=0.15)


def test_what_is_out_of_sight_grows_doubtful_and_what_is_seen_does_not():
    k = known(*PLACES)
    for _ in range(100):
        k.drift((0.0, 0.0), Drift(0.03, 0.0))
    assert k.variances()[2] == pytest.approx(100 * 0.03**2, rel=0.1)
    for _ in range(20):
        k.correct(2, look(PLACES[2]), 1e-4)
    assert k.variances()[2] < 0.05**2


def test_a_landmark_that_goes_leaves_the_others_as_they_are():
    k = known(*PLACES)
    k.keep([0, 2])
    assert len(k) == 2
    assert k.places()[1] == pytest.approx(PLACES[2])


RADIUS, HEIGHT = 0.3, 2.0
FEET = np.array([[3.0, 1.0], [5.0, -3.0], [7.0, 2.0], [9.0, -1.0], [4.0, 4.0]])


def seen_by_its_foot(place, here, yaw, tilt):
    """The look at a trunk whose foot seems raised: tilt (2,) rad about the own frame's x and y."""
    offset = place - here
    distance = np.linalg.norm(offset)
    u = offset / distance
    foot = distance - RADIUS
    depression = np.arctan2(HEIGHT, foot) - (tilt[0] * u[1] - tilt[1] * u[0])
    seems = HEIGHT / np.tan(depression) + RADIUS
    return Look(here, here + seems * u, 0.1, 0.05, Foot(yaw, HEIGHT, RADIUS))


@pytest.mark.parametrize("turns_with_the_drone", [False, True])
def test_a_wrong_tilt_does_not_pass_for_a_shift_of_the_trunks(turns_with_the_drone):
    """A drone flies past trunks and looks round with 1° of tilt error, told to be 1° sure."""

    def largest_error(sigma):
        k, wrong = LandmarkPlaces(), np.radians([0.6, -0.8])
        for step in range(120):
            here, yaw = np.array([0.05 * step, 0.0]), 0.7 * np.sin(0.3 * step)
            c, s = np.cos(yaw), np.sin(yaw)
            tilt = np.array([[c, -s], [s, c]]) @ wrong if turns_with_the_drone else wrong
            k.drift(tuple(here), Drift(0.03, 0.0, sigma, np.exp(-0.01)))
            for n, place in enumerate(FEET):
                seen = seen_by_its_foot(place, here, yaw, tilt)
                if n < len(k):
                    k.correct(n, seen, 1e-4)
                else:
                    k.add(seen)
        return max(np.linalg.norm(np.array(k.places()[n]) - p) for n, p in enumerate(FEET))

    assert largest_error(np.radians(1.0)) < 0.5 * largest_error(0.0)


def test_the_noise_of_the_looks_does_not_shrink_the_distances():
    rng, k, short = np.random.default_rng(5), LandmarkPlaces(), []
    for step in range(200):
        here = np.array([0.01 * step, 0.0])
        k.drift(tuple(here), Drift(0.03, 0.0, np.radians(1.5), 0.98))
        for n, place in enumerate(FEET):
            offset = place - here
            noise = 0.1 * np.linalg.norm(offset) * rng.standard_normal()
            seems = place + noise * offset / np.linalg.norm(offset)
            seen = Look(here, seems, 0.1 * np.linalg.norm(offset), 0.05, Foot(0.0, HEIGHT, RADIUS))
            if n < len(k):
                k.correct(n, seen, 1e-4)
            else:
                k.add(seen)
    here = np.array([2.0, 0.0])
    for n, place in enumerate(FEET):
        short.append(np.linalg.norm(np.array(k.places()[n]) - here) / np.linalg.norm(place - here))
    assert np.mean(short) == pytest.approx(1.0, abs=0.04)


def test_a_look_is_doubtful_along_its_line_of_sight_and_across_it():
    seen = Look(np.array([1.0, 0.0]), np.array([4.0, 4.0]), 0.5, 0.1)
    noise = seen.noise(np.array([4.0, 4.0]))  # along (0.6, 0.8)
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    assert noise @ along == pytest.approx(0.25 * along)
    assert noise @ across == pytest.approx(0.01 * across)
