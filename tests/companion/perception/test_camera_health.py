"""The faults of a camera, frame by frame."""

import numpy as np
import pytest

from companion.perception.camera_health import CameraFault, CameraHealth, CameraHealthConfig
from mavlink_bridge.wire.video import Frame


def picture(seed):
    return np.random.default_rng(seed).integers(50, 200, (64, 64, 3), np.uint8)


def test_each_fault_of_a_picture():
    health = CameraHealth(CameraHealthConfig())
    frames = [
        (Frame(0.0, {"image": picture(0)}), CameraFault.NONE),
        (Frame(0.1, {"image": picture(0)}), CameraFault.FROZEN),
        (Frame(0.2, {"image": np.zeros((64, 64, 3), np.uint8)}), CameraFault.BLACK),
        (Frame(0.3, {"image": np.full((64, 64, 3), 255, np.uint8)}), CameraFault.SATURATED),
        (Frame(0.4, {}), CameraFault.DEAD),
        (Frame(0.5, {"image": picture(1)}), CameraFault.NONE),
        (Frame(0.5, {"image": picture(1)}), CameraFault.NONE),  # the same frame again: none newer
        (Frame(0.5, {"image": picture(1)}), CameraFault.LATE),
    ]
    for n, (frame, fault) in enumerate(frames):
        assert health.check(0.1 * n, frame) is fault, n
    assert health.check(1.1, frames[-1][0]) is CameraFault.DEAD
    assert health.blind(1.1) == pytest.approx(0.4, abs=0.01)
    assert health.check(1.2, Frame(1.2, {"neighbours": np.zeros((0, 6))})) is CameraFault.NONE
    assert health.blind(1.2) == 0.0


def test_a_picture_that_does_not_fit_the_calibration_is_a_misfit():
    health = CameraHealth(CameraHealthConfig())
    frame = Frame(0.0, {"image": picture(0)})
    assert health.check(0.0, frame, fits=False) is CameraFault.MISFIT
    assert not health.usable


def test_a_frame_without_a_needed_array_is_dead_and_one_of_unknown_ranges_has_no_depth():
    health, far = CameraHealth(CameraHealthConfig(), {"image", "depth"}), np.full((20, 32), np.inf)
    unknown = np.where(np.arange(32) < 31, np.nan, far)
    frames = [
        ({"depth": far}, CameraFault.NONE),
        ({}, CameraFault.DEAD),
        ({"depth": far * np.nan}, CameraFault.NO_DEPTH),
        ({"depth": np.zeros((20, 32))}, CameraFault.NO_DEPTH),
        ({"depth": unknown}, CameraFault.NO_DEPTH),
    ]
    for n, (depth, fault) in enumerate(frames):
        frame = Frame(0.1 * n, {"image": picture(n), **depth})
        assert health.check(0.1 * n, frame) is fault, n
    assert health.check(0.6, Frame(0.6, {"depth": far})) is CameraFault.DEAD


def test_a_stamp_in_the_future_is_a_fault_until_the_next_frame():
    health = CameraHealth(CameraHealthConfig())
    assert health.check(10.0, Frame(9.97, {"image": picture(0)})) is CameraFault.NONE
    near = Frame(10.15, {"image": picture(1)})
    assert health.check(10.1, near) is CameraFault.NONE  # clocks differ
    late = Frame(10.22, {"image": picture(4)})
    assert health.check(10.1, late) is CameraFault.AHEAD
    assert health.check(10.1, late, horizon=10.15) is CameraFault.NONE  # the tick came late
    assert health.check(10.2, Frame(70.0, {"image": picture(2)})) is CameraFault.AHEAD
    assert not health.usable
    assert health.blind(10.2) > 0.0
    assert health.check(10.3, Frame(10.27, {"image": picture(3)})) is CameraFault.NONE
    assert health.check(10.6, Frame(10.27, {"image": picture(3)})) is CameraFault.LATE


def test_a_picture_in_which_nothing_can_be_told_apart_is_unclear():
    rng = np.random.default_rng(1)

    def seen(picture, noise):
        noisy = np.clip(picture + rng.normal(0.0, noise, (400, 640, 3)), 0, 255).astype(np.uint8)
        health = CameraHealth(CameraHealthConfig())
        fault = health.check(0.0, Frame(0.0, {"image": noisy}))
        assert health.usable is (fault is CameraFault.NONE)
        return fault

    trunk = np.full((400, 640, 3), 90.0)
    trunk[:, 300:340] = 60.0  # one trunk before one colour is enough
    slope = np.linspace(60.0, 120.0, 400)[:, None, None] * np.ones((1, 640, 3))
    for noise in (0.5, 3.0, 10.0):
        assert seen(np.full((400, 640, 3), 128.0), noise) is CameraFault.UNCLEAR
        assert seen(slope, noise) is CameraFault.UNCLEAR  # fog, brighter above
        assert seen(trunk, noise) is CameraFault.NONE
