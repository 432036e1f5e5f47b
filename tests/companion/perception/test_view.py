"""Which places a camera shows, and how well."""

import dataclasses

import numpy as np
import pytest

from companion.perception.camera import FORWARD, CalibrationError, Camera
from companion.perception.config import CameraConfig
from companion.perception.view import View, load_camera
from mavlink_bridge.shared.frames import multiply
from tests.companion.depth_images import CAMERA, state

OWN = state([0.0, 0.0, 2.0])


def test_a_calibration_of_another_size_is_refused(tmp_path):
    Camera.equidistant(320, 200).save(tmp_path / "c.yaml")
    with pytest.raises(CalibrationError, match="made at 320×200"):
        load_camera(CameraConfig(calibration=str(tmp_path / "c.yaml")))


@pytest.mark.parametrize(("needs_foot", "near"), [(True, 0.05), (False, 1.0)])
def test_visibility_of_places_ahead_near_and_behind(needs_foot, near):
    """From 2 m up the foot is out of the picture within 1.7 m; no place behind is seen."""
    places = np.array([[4.0, 0, 2], [1.2, 0, 2], [-4.0, 0, 2]])
    told = View(CAMERA, needs_foot).visibility(OWN, places, None)
    assert told.tolist() == [1.0, near, 0.0]


def test_a_place_in_doubt_shows_only_where_all_that_it_may_be_is_in_the_picture():
    view = View(CAMERA, needs_foot=False)
    beside = 1.0 * np.array([np.cos(1.1), np.sin(1.1), 0.0])  # 63° off, the margin is at 72°
    places = np.array([OWN.p + beside, OWN.p + beside, OWN.p + 4.0 * beside])
    assert view.shows(OWN, places) == [True, True, True]
    # 0.3 m are 17° seen from 1 m, and 4° from 4 m.
    assert view.shows(OWN, places, doubts=np.array([0.0, 0.3, 0.3])) == [True, False, True]


def test_a_place_of_unknown_range_is_not_visible():
    ranges = np.full((50, 80), np.inf, np.float16)
    ranges[:, :40] = np.nan  # left of the axis
    places = np.array([[4.0, 1.0, 2], [4.0, -1.0, 2]])
    told = View(CAMERA, needs_foot=False).visibility(OWN, places, ranges)
    assert told.tolist() == [0.0, 1.0]


def test_a_camera_on_its_side_shows_less_beside():
    portrait = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]  # rolled about its axis
    mount = multiply(np.array(FORWARD), np.array(portrait))
    view = View(dataclasses.replace(CAMERA, mount=mount), needs_foot=False)
    aside = 4.0 * np.array([np.cos(1.05), np.sin(1.05), 0.0])  # 60° off; 50° are in the picture
    assert view.visibility(OWN, (OWN.p + aside)[None], None)[0] == 0.0


@pytest.mark.parametrize(
    ("mount_deg", "body"),
    [
        ([0, 0, 20], [np.cos(np.radians(20)), np.sin(np.radians(20)), 0]),  # to the left
        ([0, 15, 0], [np.cos(np.radians(15)), 0, np.sin(np.radians(15))]),  # up
        ([30, 0, 0], [1, 0, 0]),
    ],
)
def test_a_camera_turned_on_its_mount_sees_its_axis_in_the_middle(mount_deg, body):
    config = CameraConfig(mount_deg=[float(a) for a in mount_deg])
    camera = load_camera(config)
    view = View(camera, needs_foot=False)
    pixel = camera.project(view.to_camera(OWN, np.array([body])))[0]
    np.testing.assert_allclose(pixel, [319.5, 199.5], atol=1e-6)


def test_in_a_camera_rolled_clockwise_the_world_turns_the_other_way():
    """What is to the left comes down."""
    camera = load_camera(CameraConfig(mount_deg=[30.0, 0.0, 0.0]))
    left = View(camera, needs_foot=False).to_camera(OWN, np.array([[1.0, 0.5, 0.0]]))
    u, v = camera.project(left)[0]
    assert u < 300.0
    assert v > 230.0
