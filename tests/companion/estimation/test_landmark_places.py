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


def test_a_look_from_the_very_place_of_a_landmark_tells_no_direction():
    assert Look((1.0, 2.0), (3.0, 2.0), 0.5, 0.1).noise((1.0, 2.0)) == pytest.approx(0.0)


def test_a_drone_drifts_not_at_all_unless_it_is_told():
    drift = Drift()
    assert (drift.position, drift.yaw, drift.tilt, drift.tilt_kept) == (0.0, 0.0, 0.0, 1.0)


def test_a_look_without_a_foot_is_not_shifted_by_a_tilt():
    assert Look((0.0, 0.0), (3.0, 1.0), 0.1, 0.1).pose((3.0, 1.0)) == pytest.approx(
        np.zeros((2, 4))
    )


@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize(("x", "y"), [(3.0, -1.0), (-2.0, 4.0)])
def test_a_tilt_shifts_a_place_as_its_foot_seems_raised(axis, x, y):
    """Tilts about the frame's x and y axes, and about those of a drone that is turned by 0.7."""
    here, yaw, small = np.array([1.0, 0.5]), 0.7, 1e-5
    c, s = np.cos(yaw), np.sin(yaw)
    tilt = small * np.array([[1.0, 0.0, c, -s], [0.0, 1.0, s, c]])[:, axis]
    place = np.array([x, y])
    seems = seen_by_its_foot(place, here, yaw, tilt)
    shift = seems.pose((x, y))[:, axis]
    assert shift == pytest.approx((seems.place - place) / small, rel=1e-3)


@pytest.mark.parametrize(
    ("height", "distance", "lever"),
    [
        (2.0, 0.2, (0.1**2 + 2.0**2) / 2.0),  # as if the foot were 0.1 m off
        (0.1, 1.3, (1.0**2 + 0.3**2) / 0.3),  # as if flown at 0.3 m
    ],
)
def test_very_near_and_very_low_the_lever_of_a_tilt_stays_bounded(height, distance, lever):
    shift = Foot(0.0, height, RADIUS).shift((distance, 0.0))
    assert shift == pytest.approx(np.array([[0.0, -lever, 0.0, -lever], [0.0] * 4]))


def test_the_variance_is_that_of_the_worst_direction():
    k = LandmarkPlaces()
    k.add(Look((0.0, 0.0), (3.0, 4.0), 0.5, 0.1))
    k.add(Look((0.0, 0.0), (3.0, -4.0), 0.1, 0.3))
    assert k.variances() == pytest.approx([0.25, 0.09])
    assert np.array(k.places()) == pytest.approx(np.array([[3.0, 4.0], [3.0, -4.0]]))


def added(*places, sigma=SIGMA):
    """Landmarks that were seen once, from the origin."""
    k = LandmarkPlaces()
    for place in places:
        k.add(look(place, sigma))
    return k


def test_a_drift_makes_far_landmarks_more_doubtful_than_near_ones():
    """A turn by 0.02 rad moves a place 5 m off by 0.1 m, and one 10 m off by 0.2 m."""
    k = added((4.0, 1.0), (1.0, 7.0))
    k.drift((1.0, -3.0), Drift(0.3, 0.02))
    assert k.variances() == pytest.approx([0.01 + 0.09 + 0.01, 0.01 + 0.09 + 0.04])


def test_a_shift_of_one_landmark_is_as_likely_that_of_all_as_the_drift_explains_it():
    k = added((4.0, 1.0), (-3.0, 2.0))
    k.drift((0.0, 0.0), Drift(0.2))
    k.correct(0, look((4.3, 0.9)), 0.0)
    moved = np.array(k.places()) - [[4.0, 1.0], [-3.0, 2.0]]
    total = 0.01 + 0.04 + 0.01  # of the landmark, the drift and the look
    assert moved[0] == pytest.approx(np.array([0.3, -0.1]) * (0.01 + 0.04) / total)
    assert moved[1] == pytest.approx(np.array([0.3, -0.1]) * 0.04 / total)
    before = 0.01 + 0.04
    assert k.variances() == pytest.approx([before * 0.01 / total, before - 0.04**2 / total])


def test_a_turn_that_one_landmark_shows_turns_the_other_about_the_drone():
    """Arms of 3 m to the east and 2 m to the north, seen from (1, 1)."""
    k = added((4.0, 1.0), (1.0, 3.0))
    k.drift((1.0, 1.0), Drift(yaw=0.1))
    k.correct(0, look((4.0, 1.2)), 0.0)
    total = 0.01 + 0.3**2 + 0.01
    assert k.places()[0] == pytest.approx((4.0, 1.0 + 0.2 * (0.01 + 0.3**2) / total))
    assert k.places()[1] == pytest.approx((1.0 - 0.2 * 0.3 * 0.2 / total, 3.0))


def test_a_place_is_never_surer_than_its_floor():
    k = added((4.0, 1.0), (5.0, -2.0))
    k.correct(1, look((5.0, -2.0)), 0.008)
    assert k.variances() == pytest.approx([0.01, 0.008])


@pytest.mark.parametrize("axis", range(2))
def test_neither_axis_of_a_place_is_surer_than_its_floor(axis):
    """A look tells one axis well; the next look moves it as far as its floor leaves it open."""
    place = 4.0 * np.eye(2)[axis]
    k = added(place)
    k.correct(0, Look((0.0, 0.0), tuple(place), 0.001, 9.0), 0.008)
    k.correct(0, look(place * 1.05), 0.0)
    assert k.places()[0][axis] == pytest.approx(4.0 + 0.2 * 0.008 / (0.008 + 0.01))


def test_places_turn_left_about_the_drone():
    k = added((4.0, 1.0), (1.0, 3.0))
    k.turn(np.array([1.0, 1.0, 9.0]), np.pi / 2)
    assert np.array(k.places()) == pytest.approx(np.array([[1.0, 4.0], [-1.0, 1.0]]))


TILT, LEVER = 0.02, (4.0**2 + HEIGHT**2) / HEIGHT  # rad; m/rad, of a foot 4 m off


def by_foot(seems, distance=4.0 + RADIUS):
    """A look to the east at a foot; seems: m, where it does."""
    return Look((0.0, 0.0), (distance + seems, 0.0), SIGMA, 0.05, Foot(0.0, HEIGHT, RADIUS))


@pytest.mark.parametrize("waits", [1, 5])
def test_the_place_of_a_new_foot_is_as_doubtful_as_the_tilt(waits):
    """However long the drone has flown before, the doubt of its tilt is what it is told to be."""
    k = LandmarkPlaces()
    for _ in range(waits):
        k.drift((0.0, 0.0), Drift(tilt=TILT))
    k.add(by_foot(0.0))
    assert k.variances() == pytest.approx([SIGMA**2 + (LEVER * TILT) ** 2])
    k.drift((0.0, 0.0), Drift(tilt=TILT, tilt_kept=0.3))
    assert k.variances() == pytest.approx([SIGMA**2 + (LEVER * TILT) ** 2])


@pytest.mark.parametrize("kept", [0.0, 0.5, 1.0])
def test_a_foot_that_seems_shifted_tells_a_tilt_as_far_as_the_tilt_may_have_changed(kept):
    """The look's noise and the change of the tilt explain the shift, half of it the place's."""
    k = LandmarkPlaces()
    k.drift((0.0, 0.0), Drift(tilt=TILT))
    k.add(by_foot(0.0))
    k.drift((0.0, 0.0), Drift(tilt=TILT, tilt_kept=kept))
    k.correct(0, by_foot(0.1), 0.0)
    changed = (LEVER * TILT) ** 2 * (1.0 - kept)
    by_tilt = 0.5 * 0.1 * changed / (SIGMA**2 + changed)
    assert k.places()[0] == pytest.approx((4.0 + RADIUS + 0.05, 0.0))
    far = ((6.0**2 + HEIGHT**2) / HEIGHT) / LEVER  # a foot at 6 m is shifted by so much more
    expected = 6.0 + RADIUS - far * by_tilt
    assert k.corrected(by_foot(0.0, 6.0 + RADIUS)) == pytest.approx((expected, 0.0))
    now = ((4.05**2 + HEIGHT**2) / HEIGHT) / LEVER
    k.correct(0, by_foot(0.05 + now * by_tilt), 0.0)  # as it is expected by now
    assert k.places()[0] == pytest.approx((4.0 + RADIUS + 0.05, 0.0))
    k.drift((0.0, 0.0), Drift(tilt=TILT, tilt_kept=0.4))
    expected = 6.0 + RADIUS - 0.4 * far * by_tilt
    assert k.corrected(by_foot(0.0, 6.0 + RADIUS)) == pytest.approx((expected, 0.0))


def test_a_tilt_shifts_feet_aside_by_less_and_along_their_line_of_sight():
    """A drone that leans back: feet ahead seem far, and those at 53° by 0.6 of that."""
    k = LandmarkPlaces()
    k.drift((0.0, 0.0), Drift(tilt=TILT))
    k.add(by_foot(0.0))
    k.drift((0.0, 0.0), Drift(tilt=TILT, tilt_kept=0.0))
    k.correct(0, by_foot(0.1), 0.0)
    ahead = 0.05 * (LEVER * TILT) ** 2 / (SIGMA**2 + (LEVER * TILT) ** 2)
    aside = np.array([0.6, 0.8])
    seen = Look((0.0, 0.0), (4.0 + RADIUS) * aside, SIGMA, 0.05, Foot(0.0, HEIGHT, RADIUS))
    assert k.corrected(seen) == pytest.approx((4.0 + RADIUS - 0.6 * ahead) * aside)


def test_a_new_foot_is_placed_less_what_the_tilt_shifts_it():
    k = LandmarkPlaces()
    k.drift((0.0, 0.0), Drift(tilt=TILT))
    k.add(by_foot(0.0))
    k.drift((0.0, 0.0), Drift(tilt=TILT, tilt_kept=0.0))
    k.correct(0, by_foot(0.1), 0.0)
    expected = k.corrected(by_foot(0.0, 6.0 + RADIUS))
    k.add(by_foot(0.0, 6.0 + RADIUS))
    assert k.places()[1] == pytest.approx(expected)
    assert expected[0] < 6.0 + RADIUS - 0.01
