"""A velocity that is wrong for seconds is told from a position that slides now and then."""

import numpy as np
import pytest

from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.velocity_by_sight import VelocityBySight
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
