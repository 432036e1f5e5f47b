"""The pose of a vehicle between the instants at which it reports its attitude and its place."""

import math

import numpy as np
import pytest

from mavlink_bridge.shared.frames import euler_from_quaternion, quaternion_from_euler
from mavlink_bridge.wire.messages import Attitude, EulerAttitude, LocalPosition, Odometry
from sitl_sim.external.reported_poses import ReportedPoses


def yawed(time, yaw, kind=Attitude):
    return kind(time, quaternion_from_euler(0.1, -0.2, yaw), np.array([0.0, 0.0, 1.0]))


def placed(time, x):
    return LocalPosition(time, np.array([x, 2.0, 3.0]), np.array([1.0, 0.0, 0.0]))


def odometry(time, x, yaw=0.0):
    q = quaternion_from_euler(0.0, 0.0, yaw)
    return Odometry(time, np.array([x, 0.0, 0.0]), np.zeros(3), q, np.zeros(3))


@pytest.fixture
def poses():
    return ReportedPoses()


def yaw_at(poses, time):
    return euler_from_quaternion(poses.at(time).q_wb)[2]


def test_it_lies_between_samples_that_come_at_different_times(poses):
    poses.hear([yawed(1.00, 3.0), placed(1.01, 5.0), yawed(1.10, 3.2), placed(1.21, 7.0)])
    assert poses.known_until == 1.10
    assert poses.newest == 1.21
    state = poses.at(1.06)
    assert state.p == pytest.approx([5.5, 2.0, 3.0])
    assert yaw_at(poses, 1.06) == pytest.approx(3.12, abs=1e-3)  # the short way
    assert yaw_at(poses, 1.10) == pytest.approx(3.2 - 2 * math.pi, abs=1e-9)


def test_nothing_is_assumed_beyond_the_samples_or_across_a_silence(poses):
    assert poses.at(1.0) is None
    poses.hear([yawed(1.0, 0.0), yawed(1.1, 0.0), placed(1.0, 0.0), placed(1.05, 0.1)])
    assert poses.at(1.06) is None
    assert poses.at(0.99) is None
    poses.hear([yawed(1.5, 0.0), placed(1.1, 0.1), placed(1.5, 1.0)])
    assert poses.at(1.3) is None
    assert poses.at(1.5).p[0] == 1.0


def test_a_pose_once_a_second_is_too_seldom(poses):
    poses.hear([yawed(1.0, 0.0), yawed(1.1, 0.0), placed(1.0, 0.0), placed(2.0, 0.0)])
    assert not poses.flowing
    poses.hear([placed(2.1, 0.0)])
    assert poses.flowing


def test_what_is_missing_is_named(poses):
    assert poses.lacking == ["attitude", "position"]
    poses.hear([yawed(1.0, 0.0)])
    assert poses.lacking == ["position"]
    assert poses.known_until == -math.inf


def test_the_fine_streams_are_preferred_as_soon_as_they_come(poses):
    poses.hear([odometry(1.00, 1.0, 0.5), odometry(1.02, 2.0, 0.5)])
    assert poses.at(1.01).p[0] == pytest.approx(1.5)
    poses.hear([yawed(1.04, 0.7), placed(1.04, 9.0), odometry(1.06, 4.0, 0.9)])
    poses.hear([yawed(1.06, 0.7), placed(1.06, 9.5), yawed(1.08, 2.0, EulerAttitude)])
    assert poses.known_until == 1.06
    assert poses.at(1.05).p[0] == pytest.approx(9.25)
    assert yaw_at(poses, 1.05) == pytest.approx(0.7)


def test_numbers_that_are_none_and_no_rotations_are_refused(poses):
    poses.hear([yawed(1.0, 0.0), placed(1.0, 0.0), placed(1.1, math.nan)])
    poses.hear([Attitude(1.1, np.array([2.0, 0.0, 0.0, 0.0]), np.zeros(3))])
    assert poses.known_until == 1.0


def test_a_clock_that_goes_back_is_another_boot(poses):
    poses.hear([yawed(50.0, 0.0), placed(50.0, 1.0), placed(49.9, 2.0)])
    assert poses.restarts == 0
    poses.hear([yawed(3.0, 0.0), placed(3.0, 0.0)])
    assert poses.restarts == 1
    assert poses.at(3.0).p[0] == 0.0
