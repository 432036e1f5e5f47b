"""Odometry frame: steps of the position move the map, and never the drone."""

import numpy as np
import pytest

from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.velocity_by_sight import VelocityBySight
from mavlink_bridge.wire.messages import LocalPosition, Odometry

V = np.array([1.5, 0.0, 0.0])
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def fly(frame, step, seconds=4.0, resets=None, noise=(0.0, 0.0), sigma=0.05):
    """Fly straight on at 30 Hz; step(t): (3,) m that the position is off. Return the odometry."""
    rng, found = np.random.default_rng(5), []
    for k in range(round(seconds * 30)):
        t = k / 30
        p = V * t + step(t) + rng.normal(0.0, noise[0], 3)
        v = V + rng.normal(0.0, noise[1], 3)
        sent = [LocalPosition(t, p, v)]
        if resets is not None:
            sent.append(Odometry(t, p, v, LEVEL, np.zeros(3), resets=resets(t)))
        (local, *_) = frame.localised(sent, sigma)
        found.append((t, local.p))
    return found


def errors(found):
    return np.array([np.linalg.norm(p - V * t) for t, p in found])


def test_without_steps_the_position_is_the_reported_one():
    frame = OdometryFrame()
    found = fly(frame, lambda t: np.zeros(3), seconds=60.0, noise=(0.01, 0.03))
    assert frame.steps == 0
    assert not frame.offset.any()
    assert errors(found).max() < 0.06


def test_a_jump_of_vio_moves_the_map_and_not_the_drone():
    frame, jump = OdometryFrame(), np.array([0.15, -0.2, 0.05])
    found = fly(frame, lambda t: jump * (t >= 2.0))
    assert errors(found).max() < 1e-6
    assert frame.offset == pytest.approx(jump)


def test_a_step_that_slides_in_leaves_little_in_the_odometry():
    frame, step = OdometryFrame(), np.array([0.0, 1.2, 0.4])
    found = fly(frame, lambda t: step * (1.0 - np.exp(-max(t - 2.0, 0.0))), 8.0, sigma=0.15)
    assert errors(found).max() < 0.35
    assert frame.offset == pytest.approx(step, abs=0.3)


def test_a_large_jump_that_a_reset_announces_is_taken_out():
    frame, jump = OdometryFrame(), np.array([3.0, 0.0, 0.0])
    found = fly(frame, lambda t: jump * (t >= 2.0), resets=lambda t: 4 + (t >= 2.0))
    late = [e for (t, _), e in zip(found, errors(found), strict=True) if t > 2.1]
    assert max(late) < 1e-6  # one sample comes before the reset is known: it is refused later
    assert frame.offset == pytest.approx(jump)


def test_a_large_jump_that_nothing_announces_stays_a_fault():
    frame, jump = OdometryFrame(), np.array([3.0, 0.0, 0.0])
    found = fly(frame, lambda t: jump * (t >= 2.0))
    assert errors(found)[-1] == pytest.approx(3.0)
    assert not frame.offset.any()


def test_the_first_count_of_resets_announces_none():
    frame, jump = OdometryFrame(), np.array([3.0, 0.0, 0.0])
    found = fly(frame, lambda t: jump * (t >= 0.2), seconds=1.0, resets=lambda t: 4)
    assert errors(found)[-1] == pytest.approx(3.0)
    assert not frame.offset.any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_velocity_that_is_no_number_spoils_nothing_after_it(bad, axis):
    frame = OdometryFrame()
    frame.by_sight = VelocityBySight(turn=0.1, error=np.array([0.2, 0.0, 0.0]))
    v = np.array([1.0, 0.0, 0.0])
    for k in range(10):
        told = v.copy()
        told[axis] = bad if k == 5 else v[axis]
        ((local,), (odometry,)) = (
            list(frame.localised([m], 0.05))
            for m in (
                LocalPosition(0.02 * k, 0.02 * k * v, told),
                Odometry(0.02 * k, 0.02 * k * v, told, np.array([1.0, 0, 0, 0]), np.zeros(3)),
            )
        )
        assert np.isfinite(frame.offset).all()
        assert np.isfinite([*local.v, *odometry.v]).all() == (k != 5)
    assert frame.offset[0] == pytest.approx(-0.2 * 0.18, abs=0.01)
