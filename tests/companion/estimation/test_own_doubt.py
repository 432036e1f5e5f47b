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


def test_without_a_report_the_doubt_is_that_of_motion_capture():
    doubt = OwnDoubt()
    assert (doubt.position, doubt.height, doubt.velocity) == (0.05, 0.05, 0.05)
    assert (doubt.tilt, doubt.yaw) == (0.006, 0.006)
    assert (doubt.rejects, doubt.inhibit_reason) == (False, "")


def test_a_pose_drifts_by_errors_of_the_velocity_that_last_for_seven_tenths_of_a_second():
    doubt = OwnDoubt(velocity=0.2, tilt=0.03, yaw=0.05)
    assert doubt.wander == pytest.approx(0.2 * np.sqrt(1.4))
    drift = doubt.drift(4.0)
    assert drift.position == pytest.approx(0.4 * np.sqrt(1.4))
    assert drift.yaw == pytest.approx(0.1 * np.sqrt(0.2))
    assert drift.tilt == 0.03
    assert drift.tilt_kept == pytest.approx(np.exp(-0.4))


def test_within_no_time_a_pose_does_not_drift():
    for dt in (0.0, -1.0):
        drift = OwnDoubt(tilt=0.03).drift(dt)
        assert (drift.position, drift.yaw, drift.tilt, drift.tilt_kept) == (0.0, 0.0, 0.03, 1.0)


def test_of_the_axes_along_the_ground_the_more_doubtful_one_counts():
    told = [odometry([0.5, 0.6, 0.4], [0.3, 0.1, 0.2], [0.01, 0.02, 0.05])]
    doubt = OwnDoubtEstimator().hear(told)
    assert doubt == OwnDoubt(position=0.6, height=0.4, velocity=0.3, tilt=0.02, yaw=0.05)


@pytest.mark.parametrize("bad", [[np.inf, 0.1, 0.1], [0.1, 0.1, -1e-9], [0.1, np.nan, 0.1]])
def test_one_axis_that_is_no_deviation_spoils_its_three_and_no_others(bad):
    assert OwnDoubtEstimator().hear([odometry(bad, [0.0] * 3, bad)]) == OwnDoubt(velocity=0.0)


def test_what_was_told_once_stays_until_it_is_told_anew():
    estimator = OwnDoubtEstimator()
    estimator.hear([odometry([0.6] * 3, None, None), EstimatorStatus(1.0, 0, 0.5, 0.5, 2.0)])
    doubt = estimator.hear([odometry(None, [0.3] * 3, None)])
    assert (doubt.position, doubt.velocity, doubt.rejects) == (0.6, 0.3, True)
    assert doubt.inhibit_reason
    assert estimator.hear([]) == estimator.doubt == doubt


@pytest.mark.parametrize("sensor", range(4))
@pytest.mark.parametrize(("ratio", "rejects"), [(1.0, False), (1.01, True)])
def test_a_test_ratio_above_one_of_any_sensor_is_a_rejection(sensor, ratio, rejects):
    ratios = [ratio if k == sensor else 0.1 for k in range(4)]
    status = EstimatorStatus(1.0, ALL, 0.5, 0.5, *ratios)
    assert OwnDoubtEstimator().hear([status]).rejects is rejects


@pytest.mark.parametrize(
    ("flags", "accuracy", "reason"),
    [
        (ALL, 5.0, ""),
        (ALL, 5.06, "autopilot: its position is sure to 5.1 m, 5 m are needed"),
        (0x10, 0.5, "autopilot: its estimator has no attitude"),
        (0x1 | 0x2 | 0x4, 9.0, "autopilot: its estimator has no horizontal position"),
    ],
)
def test_the_words_of_what_is_missing(flags, accuracy, reason):
    status = EstimatorStatus(1.0, flags, accuracy, 0.5)
    assert OwnDoubtEstimator().hear([status]).inhibit_reason == reason
