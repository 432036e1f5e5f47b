"""A velocity that is wrong for seconds is told from a position that slides now and then."""

import numpy as np
import pytest

from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.velocity_by_sight import VelocityBySight
from companion.estimation.velocity_error import VelocityError
from mavlink_bridge.wire.messages import LocalPosition

V = np.array([0.0, 1.5, 0.0])


def fly(wrong, slide, seconds=60.0, sigma=0.1, shown=np.inf):
    """Fly north at 50 Hz with 1 cm of noise.

    wrong(t): (3,) m/s that the velocity is off; slide(t): (3,) m that the position is. shown: m/s,
    1 σ to which the ground shows the velocity. Return the frame, and errors of place [m] and
    velocity [m/s] that are left in the odometry, (T,3) each.
    """
    frame, rng, places, speeds = OdometryFrame(), np.random.default_rng(3), [], []
    frame.by_sight = VelocityBySight(shown=shown)
    for k in range(round(seconds * 50)):
        t = k / 50
        p = V * t + slide(t) + rng.normal(0.0, 0.01, 3)
        (out,) = frame.localised([LocalPosition(t, p, V + wrong(t))], sigma)
        places.append(out.p - V * t)
        speeds.append(out.v - V)
    return frame, np.array(places), np.array(speeds)


def east(size):
    return np.array([size, 0.0, 0.0])


def none(t):
    return np.zeros(3)


def wavers(t):
    """As PX4's velocity does whose accelerometer is far noisier than it assumes."""
    return east(0.5 * np.sin(2 * np.pi * t / 12.0))


def test_a_velocity_that_wavers_is_corrected_by_the_positions():
    frame, places, speeds = fly(wavers, none)
    raw = 0.5 / np.sqrt(2)
    late = speeds[20 * 50 :, 0]
    assert np.sqrt((late**2).mean()) < 0.5 * raw
    drift = places[22 * 50 :, 0] - places[20 * 50 : -2 * 50, 0]  # what a remembered trunk is off
    assert np.abs(drift).max() < 0.3
    assert np.abs(frame.offset).max() < 1.0


def test_a_position_that_slides_once_leaves_the_velocity_as_it_is():
    _, _, speeds = fly(none, lambda t: east(0.4 * np.clip((t - 20.0) / 1.5, 0.0, 1.0)))
    np.testing.assert_array_equal(speeds, 0.0)


@pytest.mark.parametrize(("shown", "most"), [(np.inf, 1.5), (0.12, 0.3)])
def test_what_the_ground_shows_bounds_what_sliding_positions_say_of_the_velocity(shown, most):
    """GPS signals take another path for 0.7 s, and back: two slides of 1.3 m, one after another."""

    def slides(t):
        out, back = (1.0 - np.exp(-max(t - since, 0.0)) for since in (20.0, 20.7))
        return east(1.5 * out - 2.5 * back)

    _, _, speeds = fly(none, slides, sigma=0.15, shown=shown)
    worst = np.abs(speeds).max()
    assert worst < most
    assert np.isfinite(shown) or worst > 0.4  # without ground in sight the two cannot be told apart


def test_a_velocity_within_its_own_doubt_is_believed():
    _, _, speeds = fly(wavers, none, sigma=0.4)
    np.testing.assert_array_equal(speeds, [wavers(k / 50) for k in range(len(speeds))])


def test_jumps_of_the_position_say_nothing_of_the_velocity():
    frame, _, speeds = fly(none, lambda t: east(0.5 * (int(t / 3.0) % 2)))
    assert frame.steps > 10
    np.testing.assert_array_equal(speeds, 0.0)


def after(rate, sigma=0.0, **how):
    """What is found after positions have left the velocity by a `rate` (3,) m/s for long."""
    found = VelocityError()
    found.update(1e3 * np.array(rate), 1e3, sigma, **how)
    return found.error


@pytest.mark.parametrize(
    ("rate", "sigma", "wrong"),
    [(0.149, 0.0, 0), (0.151, 0.0, 1), (0.299, 0.2, 0), (0.301, 0.2, 1), (-0.301, 0.2, 1)],
)
def test_a_velocity_is_wrong_from_15_cm_a_second_and_one_and_a_half_times_its_doubt_on(
    rate, sigma, wrong
):
    """Positions slide by 0.1 m/s themselves: that share stays with them."""
    expected = wrong * rate * rate**2 / (rate**2 + 0.1**2)
    assert after([rate, 0.0, 0.0], sigma) == pytest.approx([expected, 0.0, 0.0])


def test_what_is_wrong_along_the_ground_decides_for_the_climb_too():
    assert after([0.3, 0.4, -0.2]) == pytest.approx(0.25 / 0.26 * np.array([0.3, 0.4, -0.2]))
    assert after([0.0, 0.1, 0.5]).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("by_sight", "share"), [(0.3, 0.36), (0.1, 0.04), (0.6, 25 / 26)])
def test_what_the_ground_leaves_open_is_the_most_that_the_velocity_is_wrong_by(by_sight, share):
    """Of the square of 0.5 m/s."""
    assert after([0.0, 0.5, 0.0], by_sight=by_sight) == pytest.approx([0.0, 0.5 * share, 0.0])


def test_the_rate_is_averaged_over_four_tenths_of_a_second_and_its_square_over_ten_seconds():
    found = VelocityError()
    assert found.error.tolist() == [0.0, 0.0, 0.0]
    found.update(np.array([500.0, 0.0, 0.0]), 1e3, 0.0)
    found.update(np.zeros(3), 0.4, 0.0)
    rate = 0.5 * np.exp(-1.0)
    power = 0.25 * np.exp(-0.04) + rate**2 * (1.0 - np.exp(-0.04))
    assert found.error == pytest.approx([rate * power / (power + 0.01), 0.0, 0.0])
