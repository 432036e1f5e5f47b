"""The smaller sizes of a picture."""

import numpy as np
import pytest

from companion.perception.reduced import Reduced


@pytest.mark.parametrize(("width", "height"), [(640, 400), (642, 398), (96, 64), (65, 63)])
def test_each_pixel_is_the_mean_of_its_area(width, height):
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    picture = Reduced(image)
    for step in (2, 4, 8):
        small = picture.colour(width // step, height // step)
        assert small.shape == (height // step, width // step, 3)
        assert picture.grey(width // step, height // step).shape == small.shape[:2]
        if width % step == 0 and height % step == 0:
            areas = image.reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
            assert np.abs(small - areas).max() < 2.0  # rounded once for each half


def test_the_own_size_is_the_picture_itself():
    image = np.zeros((64, 96, 3), np.uint8)
    assert Reduced(image).colour(96, 64) is image
