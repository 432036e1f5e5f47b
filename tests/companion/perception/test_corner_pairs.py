"""Corners are followed to a fraction of a pixel, each picture once."""

import cv2
import numpy as np
import pytest

from companion.perception.corner_pairs import CornerFollower

RNG = np.random.default_rng(4)
SCENE = cv2.GaussianBlur(RNG.integers(0, 255, (500, 740, 3), np.uint8), (0, 0), 4)


def picture(left, up):
    """The scene, seen `left` px farther left and `up` px farther up."""
    return np.ascontiguousarray(SCENE[50 - up : 450 - up, 50 - left : 690 - left])


def test_corners_move_as_the_picture_does():
    follower = CornerFollower(640, 400)
    assert follower.update(1.0, picture(0, 0)) is None
    pairs = follower.update(1.1, picture(9, -4))
    assert (pairs.before, pairs.after) == (1.0, 1.1)
    assert len(pairs.pixels) > 30
    moved = pairs.pixels[:, 2:] - pairs.pixels[:, :2]
    np.testing.assert_allclose(np.median(moved, axis=0), [9.0, -4.0], atol=0.1)
    assert np.abs(moved - [9.0, -4.0]).max() < 1.5
    assert (pairs.pixels > -0.5).all()
    assert (pairs.pixels < [639.5, 399.5] * 2).all()


@pytest.mark.parametrize("stamp", [1.0, 0.9, 1.4])
def test_old_pictures_and_those_after_a_gap_are_not_compared(stamp):
    follower = CornerFollower(640, 400)
    follower.update(1.0, picture(0, 0))
    assert follower.update(stamp, picture(2, 0)) is None


def test_a_blank_picture_has_no_pairs():
    follower = CornerFollower(640, 400)
    blank = np.full((400, 640, 3), 90, np.uint8)
    follower.update(1.0, blank)
    assert len(follower.update(1.1, blank).pixels) == 0
