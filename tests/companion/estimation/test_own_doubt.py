"""Own doubt: what the autopilot's estimator reports, and what stops a flight from beginning."""

import numpy as np
import pytest

from companion.estimation.own_doubt import OwnDoubt, OwnDoubtEstimator
from mavlink_bridge.wire.messages import EstimatorStatus, Odometry

P, Q = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
ALL = 0x1 | 0x2 | 0x4 | 0x10 | 0x20


def odometry(place, velocity, attitude):
    sigmas = [None if s is None else np.array(s) for s in (place, velocity, attitude)]
    return Odometry(1.0, P, P, Q, P, *sigmas)


def test_the_reported_covariances_are_the_doubt():
    doubt = OwnDoubtEstimator().hear(
        [odometry([0.6, 0.5, 0.4], [0.1, 0.1, 0.2], [0.02, 0.01, 0.05])]
    )
    assert doubt == OwnDoubt(position=0.6, height=0.4, velocity=0.2, tilt=0.02, yaw=0.05)


@pytest.mark.parametrize("bad", [None, [np.nan] * 3, [-1.0, 0.1, 0.1]])
def test_what_is_not_reported_keeps_its_prior(bad):
    assert OwnDoubtEstimator().hear([odometry(bad, bad, bad)]) == OwnDoubt()


def test_more_doubt_of_the_velocity_is_more_drift():
    sure, unsure = OwnDoubt(velocity=0.05), OwnDoubt(velocity=0.15)
    assert unsure.drift(0.1).position == pytest.approx(3.0 * sure.drift(0.1).position)
    assert sure.drift(0.4).position == pytest.approx(2.0 * sure.drift(0.1).position)


@pytest.mark.parametrize(
    ("flags", "accuracy", "reason"),
    [
        (ALL, 0.5, ""),
        (0x1 | 0x8, 0.5, ""),  # relative position: VIO
        (ALL & ~0x1, 0.5, "no attitude"),
        (ALL & ~0x10, 0.5, "no horizontal position"),
        (ALL, 7.0, "7.0 m"),
    ],
)
def test_an_estimator_without_a_state_to_fly_by_says_why(flags, accuracy, reason):
    estimator = OwnDoubtEstimator()
    found = estimator.hear([EstimatorStatus(1.0, flags, accuracy, 0.5)]).inhibit_reason
    assert reason in found
    assert bool(found) is bool(reason)


def test_the_reason_goes_when_the_estimator_recovers():
    estimator = OwnDoubtEstimator()
    estimator.hear([EstimatorStatus(1.0, 0, 0.5, 0.5)])
    assert not estimator.hear([EstimatorStatus(2.0, ALL, 0.5, 0.5)]).inhibit_reason
