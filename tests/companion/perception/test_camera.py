"""Pixels ↔ directions, and the calibrations that are refused."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.perception.camera import CalibrationError, Camera
from mavlink_bridge.shared.frames import rotation_matrix

IDEAL = Camera.equidistant(640, 400)
REAL = Camera(640, 400, 231.0, 229.5, 322.0, 197.5, np.array([0.02, -0.011, 0.004, -0.0008]))


@given(st.floats(0, 639), st.floats(0, 399), st.sampled_from([IDEAL, REAL]))
def test_project_inverts_unproject(u, v, camera):
    direction = camera.unproject(np.array([[u, v]]))
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    np.testing.assert_allclose(camera.project(7.0 * direction), [[u, v]], atol=1e-6)


def test_field_of_view_is_160_degrees_over_the_width():
    left, right = IDEAL.unproject(np.array([[-0.5, 199.5], [639.5, 199.5]]))
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(160.0)


@pytest.mark.parametrize("camera", [IDEAL, REAL])
def test_project_agrees_with_opencv(camera):
    points = np.random.default_rng(1).normal((0, 0, 2), 1.0, (200, 3))
    points = points[points[:, 2] > 0.05]
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    theirs, _ = cv2.fisheye.projectPoints(
        points[None], np.zeros(3), np.zeros(3), matrix, camera.k.reshape(4, 1)
    )
    np.testing.assert_allclose(camera.project(points), theirs[0], atol=1e-6)


def test_axes_of_the_mount():
    forward, left, up = rotation_matrix(IDEAL.mount)  # the body's axes in the camera frame
    np.testing.assert_allclose(forward, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(left, [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(up, [0, -1, 0], atol=1e-12)


def test_a_point_behind_has_no_pixel():
    assert np.isnan(IDEAL.project(np.array([[0.0, 0.0, -1.0]]))).all()


def test_solid_angles_add_up_to_the_cone():
    # A cone of half angle 50° (the image's half height) has 2π (1 − cos 50°) steradian.
    inside = IDEAL.directions[..., 2] > np.cos(np.radians(49.5))
    expected = 2 * np.pi * (1 - np.cos(np.radians(49.5)))
    assert IDEAL.solid_angle[inside].sum() == pytest.approx(expected, rel=2e-3)


def test_a_calibration_is_saved_and_loaded(tmp_path):
    REAL.save(tmp_path / "cal.yaml")
    back = Camera.load(tmp_path / "cal.yaml")
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(back, key) == getattr(REAL, key)
    np.testing.assert_array_equal(back.k, REAL.k)


GOOD = "width: 640\nheight: 400\nfx: 229\nfy: 229\ncx: 319.5\ncy: 199.5\n"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "mapping"),
        ("width: 640", "missing height"),
        (GOOD + "k9: 1", "unknown k9"),
        (GOOD + "k1: abc", "number"),
        (GOOD + "k1: .nan", "finite"),
        (GOOD.replace("fx: 229", "fx: -1"), "positive"),
        (GOOD + "mount: [1, 1, 0, 0]", "unit quaternion"),
        (GOOD + "mount:", "unit quaternion"),
        (GOOD + "mount: 1", "unit quaternion"),
        (GOOD + "mount: [.nan, 1, 0, 0]", "unit quaternion"),
        (GOOD.replace("640", "0.5"), "whole numbers"),
        (GOOD + "k1: 0.3\nk2: -0.5", "nothing beyond 53° off the axis"),
        (GOOD.replace("229", "2290"), "image 16° across"),
        (GOOD.replace("fx: 229", "fx: 600"), "fx near fy"),
        ("a: [", "cannot read"),
        ("a: 2026-99-99", "cannot read"),
    ],
)
def test_an_invalid_calibration_is_refused_by_its_mistake(tmp_path, text, word):
    path = tmp_path / "cal.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=word) as error:
        Camera.load(path)
    assert str(path) in str(error.value)


def test_a_missing_calibration_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="cannot read"):
        Camera.load(tmp_path / "none.yaml")


def test_corners_beyond_the_lens_have_its_largest_angle():
    """The polynomial peaks at 101°, beyond the picture's sides but not its corners."""
    camera = Camera(640, 400, 229.0, 229.0, 319.5, 199.5, np.array([0.05, -0.03, 0.0, 0.0]))
    assert not camera.inhibit_reason
    angles = np.arccos(camera.directions[..., 2])
    assert np.degrees(angles[0, 0]) == pytest.approx(101.4, abs=0.2)
    assert (np.diff(angles[0, :320]) < 1e-3).all()  # smaller towards the middle
