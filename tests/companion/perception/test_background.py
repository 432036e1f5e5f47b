"""A find that moves with its surroundings loses, one that moves against them gains."""

import cv2
import numpy as np
import pytest

from companion.perception.background import MOST, Background, Moved
from companion.perception.camera import Camera

CAMERA = Camera.equidistant(640, 400)
STILL = np.eye(3)
WAY = 0.1  # m, to the right, in a tenth of a second
MIDDLE = np.array([330.0, 205.0])


def texture(seed):
    """Smooth noise, of twice the picture's size."""
    noise = np.random.default_rng(seed).integers(0, 255, (800, 1280, 3)).astype(np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 3.0)
    return cv2.normalize(blurred, None, 20, 235, cv2.NORM_MINMAX)


def shifted(image, u):
    """The picture (400,640,3) of it, moved by u [px] to the right."""
    move = np.array([[1.0, 0.0, u - 320.0], [0.0, 1.0, -200.0]])
    return cv2.warpAffine(image, move, (640, 400), flags=cv2.INTER_CUBIC)


def pictures(background, drone, size, turned=0.0):
    """Two pictures, and the drone's place in the second one.

    background, drone: px that they move between the two; drone None: there is none. size: px.
    """
    shown = []
    for share in (0.0, 1.0):
        image = shifted(texture(1), share * (background + turned))
        if drone is not None:
            place = MIDDLE[0] - (1.0 - share) * (drone + turned), MIDDLE[1]
            u, v = np.meshgrid(np.arange(640), np.arange(400))
            disc = np.hypot(u - place[0], v - place[1]) < 0.9 * size
            body = shifted(texture(2), share * (drone + turned))
            image = np.where(disc[..., None], body, image)
        shown.append(image)
    return shown


def evidence(distance, behind, *, drone=True, way=WAY, turn=0.0, image=None):
    """Log odds of a find at `distance` [m] before a background at `behind` [m]."""
    size = 0.2 / distance * CAMERA.fx
    moved = [-CAMERA.fx * way / d for d in (behind, distance)]
    shown = pictures(moved[0], moved[1] if drone else None, size, -CAMERA.fx * turn)
    background = Background(CAMERA)
    for each in shown if image is None else image:
        background.follow(each)
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])  # a turn to the right
    gained = background.evidence(
        MIDDLE[None],
        np.array([size]),
        np.array([distance]),
        np.array([1.0 / CAMERA.fx]),
        Moved(back, np.array([way, 0.0, 0.0]), 0.1),
    )
    assert gained.shape == (1,)
    return float(gained[0])


@pytest.mark.parametrize("turn", [0.0, 0.1, -0.05])
@pytest.mark.parametrize("distance", [0.8, 1.5, 2.5])
def test_a_patch_of_the_ground_loses_and_a_drone_before_it_gains(distance, turn):
    assert evidence(distance, 5.0, drone=False, turn=turn) < -1.0
    assert evidence(distance, 5.0, turn=turn) > 1.0


def test_a_drone_just_before_its_background_loses_little():
    assert evidence(6.0, 7.0) > -1.0


def test_who_does_not_move_learns_little():
    for drone in (True, False):
        assert abs(evidence(1.5, 5.0, drone=drone, way=0.0)) < 0.75


def test_no_pair_of_pictures_brings_more_than_the_most():
    assert evidence(0.8, 20.0) == MOST
    assert -MOST < evidence(0.8, 3.0, drone=False) < -1.3


@pytest.mark.parametrize("grey", [0, 128])
def test_without_texture_nothing_is_told(grey):
    plain = np.full((400, 640, 3), grey, np.uint8)
    assert evidence(1.5, 5.0, image=[plain, plain]) == 0.0


def test_the_first_picture_tells_nothing():
    assert evidence(1.5, 5.0, image=pictures(0.0, None, 30.0)[:1]) == 0.0


def test_no_finds_gain_nothing():
    background = Background(CAMERA)
    none = np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0)
    assert background.evidence(*none, Moved(STILL, np.zeros(3), 0.1)).shape == (0,)
