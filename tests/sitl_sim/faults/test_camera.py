"""Faults of the camera and of a perfect detector's reports."""

import cv2
import numpy as np
import pytest

from sitl_sim.faults.camera import FaultyCamera


def frames(schedule, kind, n=20, **more):
    c = FaultyCamera(schedule(kind=kind, **more), 0)
    rng = np.random.default_rng(0)
    row = np.array([[0.0, 0.0, 1.0, 4.0, 0.005, 0.03]])
    return [
        c.alter(
            0.1 * k,
            10 + 0.1 * k,
            {
                "neighbours": np.vstack([row, row * 0.5]),
                "image": rng.integers(40, 200, (8, 8, 3), np.uint8),
            },
        )
        for k in range(n)
    ]


def test_camera_faults(schedule):
    assert all(not arrays for _, arrays in frames(schedule, "camera_dead"))
    frozen = [a["image"] for _, a in frames(schedule, "camera_frozen")]
    assert all((image == frozen[0]).all() for image in frozen)
    assert {int(a["image"].max()) for _, a in frames(schedule, "camera_black")} == {0}
    assert {int(a["image"].min()) for _, a in frames(schedule, "camera_saturated")} == {255}
    fogged = frames(schedule, "camera_fog", amount=0.98)
    assert all(1.0 < np.std(a["image"], axis=(0, 1)).max() < 5.0 for _, a in fogged)  # its noise
    late = [stamp for stamp, _ in frames(schedule, "camera_late", amount=0.2)]
    assert late[5] == pytest.approx(10.3)
    assert all(len(a["neighbours"]) == 0 for _, a in frames(schedule, "missed", amount=1.0))
    assert all(len(a["neighbours"]) == 3 for _, a in frames(schedule, "ghosts", amount=1.0))
    assert frames(schedule, "range_bias", amount=1.2)[0][1]["neighbours"][0, 3] == pytest.approx(
        4.8
    )


def test_a_camera_that_shakes_turns_each_picture_to_any_side_up_to_its_amount(schedule):
    """Of 160° in 640 px a degree is 4 px; the sines of a shake have a mean of 0, and 0.7 as rms."""
    camera = FaultyCamera(schedule(kind="camera_vibration", amount=1.0), 0)
    noise = np.random.default_rng(0).integers(0, 255, (400, 640, 3)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 3.0)
    middle = (slice(150, 250), slice(260, 380), 0)
    before = image[middle].astype(float)
    shifts = []
    for k in range(60):
        stamp, arrays = camera.alter(0.1 * k, 10.0, {"image": image})
        assert stamp == 10.0
        shifts.append(cv2.phaseCorrelate(before, arrays["image"][middle].astype(float))[0])
    shifts = np.array(shifts)
    assert np.abs(shifts).max() < 4.6  # as well as the shift can be measured
    assert np.abs(shifts.mean(axis=0)).max() < 1.0
    assert (shifts.std(axis=0) > 2.2).all()
    assert (shifts.std(axis=0) < 3.4).all()
    calm = FaultyCamera(schedule(kind="camera_vibration", amount=0.0), 0)
    assert (calm.alter(0.0, 10.0, {"image": image})[1]["image"][middle] == image[middle]).all()
