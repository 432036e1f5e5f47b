"""Pictures of a far textured sphere against the attitude that the vehicle tells."""

from collections import Counter

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from companion.perception.camera import Camera
from companion.perception.camera_alignment import Alignment, CameraAlignment
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.reduced import Reduced
from companion.perception.view import View
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

CAMERA = Camera.equidistant(320, 200, 160.0)
PERIOD = 0.1
HERE = np.array([0.0, 0.0, 2.0])


def attitude(time):
    """A drone that looks to and fro, and leans a little."""
    yaw = 0.8 * np.sin(2 * np.pi * time / 1.8)
    lean = [0.12 * np.sin(2.3 * time), 0.1 * np.sin(3.1 * time + 1.0)]
    return Rotation.from_euler("ZYX", [yaw, *lean])


def state(time):
    x, y, z, w = attitude(time).as_quat()
    omega = (attitude(time - 1e-3).inv() * attitude(time + 1e-3)).as_rotvec() / 2e-3
    return VehicleState(time, HERE, np.zeros(3), np.array([w, x, y, z]), omega)


def sphere():
    """A texture (512,1024) of longitude and latitude."""
    noise = np.random.default_rng(3).uniform(0, 255, (512, 1024)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3.0), None, 0, 255, cv2.NORM_MINMAX)


TEXTURE = sphere()


def picture(time, camera=CAMERA, mount=None, place=None):
    """Return the picture of the sphere at `time` by a camera turned by `mount` (3,) rad.

    place: (3,), of the camera in a sphere of radius 1; None: in its middle.
    """
    turned = Rotation.from_rotvec([0.0, 0, 0] if mount is None else mount).as_matrix()
    rays = camera.directions @ turned.T @ rotation_matrix(camera.mount).T
    rays = rays @ attitude(time).as_matrix().T
    if place is not None:
        along = rays @ place
        far = np.sqrt(along**2 + 1.0 - place @ place) - along
        rays = far[..., None] * rays + place
    u = (np.arctan2(rays[..., 1], rays[..., 0]) / (2 * np.pi) + 0.5) * 1023
    v = (np.arcsin(np.clip(rays[..., 2], -1, 1)) / np.pi + 0.5) * 511
    grey = cv2.remap(TEXTURE, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def estimate(taken, seconds=4.0, alignment=None, start=0.0, ground=LEVEL, wander=0.0):
    alignment = alignment or CameraAlignment(View(CAMERA, needs_foot=False))
    for n in range(round(seconds / PERIOD)):
        time = start + n * PERIOD
        alignment.update(time, time, Reduced(taken(time)), state, ground, wander)
    return alignment


def test_a_camera_as_configured_is_found_so():
    found = estimate(picture).estimate
    assert found.contradiction == ""
    assert found.lag == 0.0
    assert found.scale == pytest.approx(1.0, abs=0.01)
    assert np.abs(found.tilt).max() < np.radians(1.0)
    assert max(found.sigmas) < 0.08


@pytest.mark.parametrize("lag", [-0.1, 0.06, 0.1, 0.15])
def test_the_lag_of_the_stamps_is_found(lag):
    found = estimate(lambda t: picture(t - lag)).estimate
    assert found.lag == pytest.approx(lag, abs=0.01)
    assert found.contradiction == ""


@pytest.mark.parametrize(
    ("taken", "words"),
    [
        (lambda t: np.ascontiguousarray(picture(t)[:, ::-1]), "mirrored or upside down"),
        (lambda t: np.ascontiguousarray(picture(t)[::-1, ::-1]), "mirrored or upside down"),
        (lambda t: picture(t, Camera.equidistant(320, 200, 145.0)), "the focal length is"),
        (lambda t: picture(t, Camera.equidistant(320, 200, 178.0)), "the focal length is"),
        (lambda t: picture(t, mount=[0.0, 0.0, np.radians(10)]), "10° off its mount"),
        (lambda t: picture(t, mount=[np.radians(10), 0.0, 0.0]), "10° off its mount"),
        (lambda t: picture(t, mount=[0.0, np.radians(10), 0.0]), "10° off its mount"),
        (lambda t: picture(t - 0.25), "0.25 s before their stamps"),
    ],
)
def test_a_camera_other_than_configured_is_told(taken, words):
    assert words in estimate(taken).estimate.contradiction


def test_rates_of_long_ago_are_asked_once():
    asked = Counter()

    def at(time):
        asked[round(time, 3)] += 1
        return state(time)

    alignment = CameraAlignment(View(CAMERA, needs_foot=False))
    for n in range(30):
        alignment.update(0.1 * n, 0.1 * n, Reduced(picture(0.1 * n)), at)
    assert alignment.estimate.scale == pytest.approx(1.0, abs=0.02)
    assert np.mean(list(asked.values())) < 2.5


@pytest.mark.parametrize("fov_deg", [145.0, 155.0, 170.0])
def test_the_focal_length_is_measured(fov_deg):
    camera = Camera.equidistant(320, 200, fov_deg)
    found = estimate(lambda t: picture(t, camera)).estimate
    assert found.scale == pytest.approx(160.0 / fov_deg, abs=0.015)


@pytest.mark.parametrize("lag", [-0.075, -0.025, 0.025, 0.075])
def test_a_lag_between_those_tried_is_no_focal_length(lag):
    alignment = CameraAlignment(View(CAMERA, needs_foot=False))
    for n in range(14):  # just enough turns to tell, most of them while the turn grows faster
        alignment.update(0.1 * n, 0.1 * n, Reduced(picture(0.1 * n - lag)), state)
        found = alignment.estimate
        assert found.contradiction == ""
        if np.isfinite(found.sigmas[1]):
            assert abs(found.scale - 1.0) < max(3.0 * found.sigmas[1], 0.02)
    assert found.scale == pytest.approx(1.0, abs=0.02)


def test_a_camera_that_is_knocked_in_flight_is_noticed_within_three_seconds():
    alignment = estimate(picture)
    assert alignment.estimate.contradiction == ""
    knocked = estimate(lambda t: picture(t, mount=[0.0, 0.0, 0.4]), 3.0, alignment, 4.0)
    assert "off its mount" in knocked.estimate.contradiction


def test_a_velocity_that_is_told_wrong_is_no_fault_of_the_camera():
    """All that is seen is 4 m away, and the drone moves at up to 1 m/s that nobody tells."""

    def swaying(time):
        phases = 2.3 * time + np.array([0.0, 1.0, 0.0])
        return picture(time, place=0.1 * np.sin(phases) * [1.0, 1.0, 0.0])

    def standard_deviations_off(wander):
        found = estimate(swaying, 8.0, wander=wander).estimate
        return abs(found.scale - 1.0) / found.sigmas[1]

    assert standard_deviations_off(0.0) > 2.0
    assert standard_deviations_off(0.3) < 1.0


def test_a_lag_that_is_known_by_half_is_used():
    """Turns of a GPS drone tell the lag to 0.015 s at first: what it most likely is serves."""
    found = estimate(lambda t: picture(t - 0.035), 2.4, wander=0.3).estimate
    assert 3.0 * found.sigmas[0] > 0.035
    assert found.lag == pytest.approx(0.035, abs=0.005)


def test_pictures_from_near_the_ground_tell_nothing():
    wide = Camera.equidistant(320, 200, 145.0)
    found = estimate(lambda t: picture(t, wide), ground=GroundPlane(1.7)).estimate
    assert found.sigmas == (np.inf,) * 3
    assert found.contradiction == ""


def test_a_drone_that_does_not_turn_learns_nothing():
    alignment = CameraAlignment(View(CAMERA, needs_foot=False))
    for n in range(30):
        own = VehicleState(0.1 * n, HERE, np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
        alignment.update(0.1 * n, 0.1 * n, Reduced(picture(0.1 * n)), lambda t, own=own: own)
    assert alignment.estimate.sigmas == (np.inf,) * 3
    assert alignment.estimate.contradiction == ""


@pytest.mark.parametrize(
    ("alignment", "measures"),
    [
        (Alignment(), False),
        (Alignment(scale=1.01, sigmas=(0.01, 0.01, 0.02)), True),
        (Alignment(scale=1.01, sigmas=(0.01, 0.05, 0.02)), False),
        (Alignment(scale=1.1, sigmas=(0.01, 0.01, 0.02)), False),
        (Alignment(sigmas=(0.01, 0.01, 0.02), contradiction="off its mount"), False),
    ],
)
def test_motion_is_measured_by_a_lens_that_is_known(alignment, measures):
    assert alignment.measures is measures
