"""Height over ground by a rangefinder, or by none: slopes, drift of the own height, its doubt."""

import numpy as np
import pytest

from companion.estimation.height import HeightEstimator
from companion.estimation.slope import Slope
from mavlink_bridge.wire.messages import DistanceSensor, VehicleState
from tests.companion.estimation.height_looks import (
    DOWN,
    LASER,
    LEVEL,
    RISE,
    at,
    look,
    over_a_slope,
)


def fly(estimator, ground, seconds=20.0, drift=0.0, fitted=True, q=LEVEL, below=lambda t: np.inf):
    """Fly on at 1.5 m/s, 2 m over the ground at the start; return errors and doubts [m]."""
    rng, found = np.random.default_rng(2), []
    upright = 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2)
    for k in range(round(10 * seconds)):
        t = 0.1 * k
        true = 2.0 - ground(1.5 * t)
        p, v = np.array([1.5 * t, 0.0, 2.0 + drift * t]), np.array([1.5, 0.0, drift])
        seen = min(true, below(t)) / upright + rng.normal(0.0, 0.03)
        looks = [DistanceSensor(t, seen, 0.1, 12.0, DOWN, LASER)] if fitted else []
        h = estimator.update(VehicleState(t, p, v, q, np.zeros(3)), looks)
        found.append((h.value - true, h.sigma))
    return np.array(found[10:]).T


def test_a_slope_is_followed():
    errors, sigmas = fly(HeightEstimator(), lambda x: -np.tan(np.radians(10.0)) * x)
    assert np.abs(errors).max() < 0.2
    assert sigmas.max() < 0.1


def test_a_drifting_height_is_not_followed_into_the_ground():
    errors, _ = fly(HeightEstimator(), lambda x: 0.0, seconds=60.0, drift=1.0 / 60.0)
    assert np.abs(errors).max() < 0.1
    unmeasured, sigmas = fly(HeightEstimator(), lambda x: 0.0, 60.0, 1.0 / 60.0, fitted=False)
    assert unmeasured[-1] == pytest.approx(1.0, abs=0.05)
    assert sigmas[-1] > 0.5  # and the drone knows that it does not know


def test_what_passes_below_is_not_the_ground():
    errors, _ = fly(HeightEstimator(), lambda x: 0.0, below=lambda t: 0.8 if 5 < t < 5.35 else 9.0)
    assert np.abs(errors).max() < 0.1


def test_a_step_of_the_ground_is_believed_after_half_a_second():
    errors, _ = fly(HeightEstimator(), lambda x: 1.0 * (x > 7.5))
    assert np.abs(errors[-100:]).max() < 0.1


def test_a_tilted_beam_measures_the_height():
    roll = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])
    errors, _ = fly(HeightEstimator(), lambda x: 0.0, q=roll)
    assert np.abs(errors).max() < 0.1


@pytest.mark.parametrize("climb", [1.5, -1.5])
def test_a_look_counts_for_the_moment_at_which_it_was_taken(climb):
    """Its beam is a tenth of a second older than the state that it is compared with."""
    estimator = HeightEstimator()
    for t in np.arange(0.0, 3.0, 0.1):
        p, v = np.array([0.0, 0.0, 5.0 + climb * t]), np.array([0.0, 0.0, climb])
        look = DistanceSensor(t - 0.1, p[2] - 0.1 * climb, 0.1, 12.0, DOWN, LASER)
        h = estimator.update(VehicleState(t, p, v, LEVEL, np.zeros(3)), [look])
    assert h.value == pytest.approx(p[2], abs=0.02)


def test_a_vehicle_that_stands_on_the_ground_has_no_height_whatever_its_estimator_tells():
    """With GPS one told 1.16 m before the take-off, looked for trunks, and saw nothing clearly."""
    estimator, still = HeightEstimator(), np.zeros(3)
    for k in range(300):
        own = VehicleState(0.1 * k, np.array([0.0, 0.0, 1.16 + 0.002 * k]), still, LEVEL, still)
        height = estimator.update(own, [], 0.5, stands=True)
        assert height.value == 0.0
    own = VehicleState(30.1, np.array([0.0, 0.0, 3.76]), still, LEVEL, still)
    height = estimator.update(own, [], 0.5)
    assert height.value == pytest.approx(2.0, abs=0.01)
    assert height.sigma == pytest.approx(0.112, abs=0.005)  # 0.1 m, and 0.2 s of wandering


def test_where_the_own_frame_began_the_ground_is_at_0_to_a_decimetre():
    height = HeightEstimator().update(at(5.0, 3.0, -4.0, 1.7), [])
    assert height.value == pytest.approx(1.7)
    assert height.sigma == pytest.approx(0.1)
    assert (height.ground.level, height.ground.at) == (0.0, (3.0, -4.0))
    assert height.ground.rise == (0.0, 0.0)
    assert height.drift == 0.0


@pytest.mark.parametrize(("doubt", "drift"), [(0.0, 0.02**2), (0.2, 0.002), (0.05, 0.02**2)])
def test_without_a_look_the_doubt_grows_with_time_and_way(doubt, drift):
    """4 s and 5 m along the ground; a doubt of 0.2 m wanders by 2 · 0.04 m² in 40 s."""
    estimator = HeightEstimator()
    estimator.update(at(10.0), [], doubt)
    height = estimator.update(at(14.0, 3.0, 4.0, 9.0), [], doubt)
    assert height.sigma == pytest.approx(np.sqrt(0.01 + 4.0 * drift + 5.0 * 0.01))
    assert estimator.update(at(13.0, 3.0, 4.0, 9.0), [], doubt).sigma == height.sigma


@pytest.mark.parametrize(("told", "sigma"), [(0.0, 0.03), (0.02, 0.03), (0.1, 0.1)])
def test_a_look_counts_by_its_error_of_3_cm_or_more_as_told(told, sigma):
    height = HeightEstimator().update(at(0.0), [look(1.8, sigma=told)])
    gain = 0.01 / (0.01 + sigma**2)
    assert height.value == pytest.approx(2.0 - 0.2 * gain)
    assert height.sigma == pytest.approx(np.sqrt(0.01 * (1.0 - gain)))


@pytest.mark.parametrize(
    ("what", "heard"),
    [
        (look(1.8, least=1.79, most=1.81), True),
        (look(1.8, least=1.8), False),
        (look(1.8, most=1.8), False),
        (look(1.8, quality=1), False),
        (look(1.8, quality=2), True),
        (look(1.8, orientation=24), False),
    ],
)
def test_a_look_without_an_echo_or_elsewhere_says_nothing(what, heard):
    height = HeightEstimator().update(at(0.0), [what])
    assert (height.value < 1.99) is heard
    assert (height.sigma < 0.09) is heard


@pytest.mark.parametrize(("cosine", "heard"), [(0.81, True), (0.79, False)])
def test_a_beam_that_looks_aside_says_nothing(cosine, heard):
    half = 0.5 * np.arccos(cosine)
    q = [np.cos(half), 0.0, np.sin(half), 0.0]
    height = HeightEstimator().update(at(0.0, q=q), [look(1.8 / cosine)])
    assert (height.value < 1.99) is heard


@pytest.mark.parametrize(("off", "believed"), [(0.51, True), (0.53, False), (-0.53, False)])
def test_a_look_beyond_five_standard_deviations_is_not_the_ground(off, believed):
    """Of the level by 0.1 m, and of the look by 0.03 m: 0.522 m."""
    height = HeightEstimator().update(at(0.0), [look(2.0 - off)])
    assert (height.value != 2.0) is believed


def test_the_fifth_such_look_in_a_row_is_a_step_of_the_ground_and_as_sure_as_one_look():
    estimator = HeightEstimator()
    assert estimator.update(at(0.0), 4 * [look(1.0)]).value == 2.0
    height = estimator.update(at(0.0), [look(1.0)])
    assert height.value == pytest.approx(1.0, abs=0.001)
    assert height.sigma == pytest.approx(np.sqrt(0.0009 / 1.0009))


def test_a_good_look_between_others_starts_their_count_anew():
    estimator = HeightEstimator()
    looks = [*4 * [look(1.0)], look(2.0), *4 * [look(1.0)]]
    assert estimator.update(at(0.0), looks).value == pytest.approx(2.0)


def test_of_a_level_so_much_is_drift_as_the_own_height_is_in_more_doubt_than_the_terrain():
    """The terrain's is 0.3 m: with 0.4 m, 16 parts of 25."""
    height = HeightEstimator().update(at(0.0), [look(1.8)], 0.4)
    assert height.drift == pytest.approx(0.64 * height.ground.level)
    assert height.ground.level == pytest.approx(2.0 - height.value)


def test_a_look_from_a_drone_that_moves_and_leans_is_of_the_place_that_its_beam_meets():
    """It leans by 0.5 rad ahead and climbs; the look is 0.2 s old."""
    q = [np.cos(0.25), 0.0, np.sin(0.25), 0.0]
    own = at(1.0, z=2.0, q=q, v=(1.0, 0.0, 0.5))
    height = HeightEstimator().update(own, [look(1.9 / np.cos(0.5), time=0.8)])
    assert height.value == pytest.approx(2.0, abs=1e-9)


def test_after_a_reset_the_ground_is_at_0_again():
    estimator = HeightEstimator()
    estimator.update(at(0.0), 5 * [look(1.0)])
    estimator.reset()
    height = estimator.update(at(50.0, 30.0), 4 * [look(1.0)])
    assert (height.value, height.sigma) == (2.0, pytest.approx(0.1))


def test_a_slope_is_told_with_the_ground():
    estimator = HeightEstimator()
    fly(estimator, lambda x: -0.2 * x)
    height = estimator.update(at(20.0, 30.0), [])
    assert height.ground.rise == pytest.approx((-0.2, 0.0), abs=0.04)


def test_a_height_whose_doubt_is_not_told_drifts_by_2_cm_a_root_second():
    estimator = HeightEstimator()
    estimator.update(at(0.0), [])
    assert estimator.update(at(9.0), []).sigma == pytest.approx(np.sqrt(0.01 + 0.0036))


@pytest.mark.parametrize("axis", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_a_leaning_beam_that_meets_a_known_slope_aside_tells_the_level_below_the_drone(axis):
    """It leans by 0.4 rad, and its beam meets the plane at z = rise · (x, y)."""
    axis, estimator = np.array(axis), over_a_slope()
    q = [np.cos(0.2), -np.sin(0.2) * axis[1], np.sin(0.2) * axis[0], 0.0]  # its top towards axis
    far = 2.0 / (np.cos(0.4) - np.sin(0.4) * (RISE @ axis))
    before = estimator.update(at(16.1), []).value
    after = estimator.update(at(16.1, q=q), 5 * [look(far, 16.1)]).value
    assert after == pytest.approx(before, abs=0.01)
    wrong = estimator.update(at(16.1, q=q), 5 * [look(2.0 / np.cos(0.4), 16.1)]).value
    assert abs(wrong - before) > 0.03


@pytest.mark.parametrize("doubt", [0.0, 0.3])
def test_a_slope_under_the_rangefinder_is_as_sure_as_the_own_height(doubt):
    """In 40 s it wanders by what is doubted: by 2 · 0.3² / 40 m² in a second."""
    estimator, slope = HeightEstimator(), Slope()
    for k in range(12):
        t, x = 1.0 * k, 1.0 * k
        estimator.update(at(t, x), [look(2.0 + 0.1 * x, t)], doubt)
        slope.move(min(x, 1.0))
        slope.pass_over((x, 0.0, -0.1 * x), t, 0.03, np.sqrt(2.0 * doubt**2 / 40.0))
    rise = estimator.update(at(11.0, 11.0), []).ground.rise
    assert rise == pytest.approx(slope.rise)
    assert rise[0] < -0.01
