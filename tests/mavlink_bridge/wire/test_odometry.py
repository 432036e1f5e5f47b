"""ODOMETRY: its axes, its covariances, and what of them is not told."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from tests.mavlink_bridge.wire.fields import heard, wire

NAN, INF = math.nan, math.inf
S = math.sqrt(0.5)
HALF = math.pi / 8  # half of 45°


@pytest.mark.parametrize(
    ("q", "upper"),
    [
        # σ² of 1 east, 0.25 north, 4 up. Forward is north-east: (1 + 0.25) / 2 along and across.
        ([math.cos(HALF), 0, 0, math.sin(HALF)], (0.625, 0.375, 0.0, 0.625, 0.0, 4.0)),
        # East, pitched up by 45°: forward and down are half of east and of up.
        ([math.cos(HALF), 0, -math.sin(HALF), 0], (2.5, 0.0, -1.5, 0.25, 0.0, 2.5)),
        # East, rolled right by 45°: right and down are half of north and of up.
        ([math.cos(HALF), math.sin(HALF), 0, 0], (1.0, 0.0, 0.0, 2.125, 1.875, 2.125)),
    ],
)
def test_the_doubt_of_a_velocity_is_told_along_forward_right_and_down(q, upper):
    xx, xy, xz, yy, yz, zz = upper
    sent = m.Odometry(2.0, np.zeros(3), np.zeros(3), np.array(q, float), np.zeros(3),
                      velocity_sigma=np.array([1.0, 0.5, 2.0]))  # fmt: skip
    told = wire(sent).velocity_covariance
    expected = [xx, xy, xz, 0, 0, 0, yy, yz, 0, 0, 0, zz, *[0] * 9]
    assert told == pytest.approx(expected, abs=1e-6)
    (back,) = Codec(1, 191).decode(Codec(1, 1).encode([sent]))
    assert back.message.velocity_sigma == pytest.approx([1.0, 0.5, 2.0], abs=1e-6)


def odometry(**changed):
    """Fields of an ODOMETRY: forward is north; rows of x, y, z, roll, pitch, yaw."""
    upper = [0.0] * 21
    for at, variance in zip((0, 6, 11, 15, 18, 20), (0.25, 1.0, 4.0, 0.0625, 0.5625, 2.25),
                            strict=True):  # fmt: skip
        upper[at] = variance
    fields = {
        "time_usec": 2000003, "frame_id": 1, "child_frame_id": 12, "x": 1.0, "y": 2.0, "z": -3.0,
        "q": [1.0, 0.0, 0.0, 0.0], "vx": 1.0, "vy": 0.5, "vz": 0.25, "rollspeed": 0.125,
        "pitchspeed": 0.25, "yawspeed": 0.5, "pose_covariance": upper,
        "velocity_covariance": upper, "reset_counter": 3, "estimator_type": 8, "quality": 90,
    }  # fmt: skip
    return heard("ODOMETRY", fields | changed)


def test_odometry_tells_place_motion_and_doubts():
    read = odometry()
    assert (read.time, read.resets, read.estimator, read.quality) == (2.000003, 3, 8, 90)
    assert read.p.tolist() == [2.0, 1.0, 3.0]
    assert read.v == pytest.approx([0.5, 1.0, -0.25])
    assert read.omega.tolist() == [0.125, -0.25, -0.5]
    assert read.position_sigma.tolist() == [1.0, 0.5, 2.0]
    assert read.attitude_sigma.tolist() == [0.25, 0.75, 1.5]
    assert read.velocity_sigma == pytest.approx([1.0, 0.5, 2.0])


@pytest.mark.parametrize(
    ("frame", "child", "place", "v"),
    [
        # MAV_FRAME: LOCAL_NED 1, BODY_NED 8, BODY_FRD 12, LOCAL_FRD 20. The nose points east.
        (1, 1, True, [0.5, 1.0, -0.25]),
        (1, 8, True, [1.0, -0.5, -0.25]),
        (1, 12, True, [1.0, -0.5, -0.25]),
        (1, 20, False, [0.5, 1.0, -0.25]),
        (20, 12, False, [1.0, -0.5, -0.25]),
        (0, 1, False, [0.5, 1.0, -0.25]),
    ],
)
def test_odometry_counts_along_the_axes_that_it_names(frame, child, place, v):
    read = odometry(frame_id=frame, child_frame_id=child, q=[S, 0.0, 0.0, S])
    assert np.isfinite(read.p).all() == np.isfinite(read.p).any() == place
    assert read.v == pytest.approx(v, abs=1e-6)


@pytest.mark.parametrize("field", ["vx", "vy", "vz"])
def test_a_velocity_that_is_not_finite_is_none(field):
    read = odometry(**{field: INF})
    assert np.isnan(read.v).all()
    assert read.v.shape == (3,)
    assert read.velocity_sigma is not None


def test_an_attitude_that_is_not_finite_turns_no_velocity_of_the_body():
    for n in range(4):
        q = [1.0, 0.0, 0.0, 0.0]
        q[n] = NAN
        assert np.isnan(odometry(q=q).v).all()
        assert odometry(q=q).velocity_sigma is None
        assert odometry(q=q, child_frame_id=1).v == pytest.approx([0.5, 1.0, -0.25])


@pytest.mark.parametrize(
    ("at", "value", "told"),
    [
        *[(at, -0.01, False) for at in (0, 6, 11, 15, 18, 20)],
        *[(at, 0.0, True) for at in (0, 6, 11, 15, 18, 20)],
        *[(at, NAN, False) for at in (0, 1, 2, 6, 7, 11, 15, 18, 20)],
        *[(at, INF, False) for at in (0, 1, 2, 6, 7, 11)],
        *[(at, NAN, True) for at in (3, 4, 5, 8, 9, 10, 12, 13, 14, 16, 17, 19)],
    ],
)
def test_a_covariance_that_is_none_tells_no_doubt(at, value, told):
    upper = [0.25, 0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 4.0, 0, 0, 0, 1.0, 0, 0, 1.0, 0, 1.0]
    upper[at] = value
    read = odometry(pose_covariance=upper, velocity_covariance=upper)
    assert (read.position_sigma is not None) == told
    assert (read.attitude_sigma is not None) == told
    assert (read.velocity_sigma is not None) == told


@pytest.mark.parametrize("left_out", ["position_sigma", "attitude_sigma"])
def test_a_doubt_of_the_pose_is_told_whole_or_not_at_all(left_out):
    doubts = {"position_sigma": np.array([1.0, 0.5, 2.0]), "attitude_sigma": np.full(3, 0.1)}
    sent = m.Odometry(2.0, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3),
                      **(doubts | {left_out: None}))  # fmt: skip
    assert np.isnan(wire(sent).pose_covariance).all()
    assert np.isnan(wire(sent).velocity_covariance).all()


def test_the_number_of_resets_wraps():
    zero, level = np.zeros(3), np.array([1.0, 0, 0, 0])
    assert wire(m.Odometry(2.0, zero, zero, level, zero, resets=258)).reset_counter == 2
