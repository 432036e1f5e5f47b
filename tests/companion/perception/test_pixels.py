"""Sums and percentiles of pixels are those of numpy."""

import numpy as np
import pytest

from companion.perception.pixels import percentile, row_sums


@pytest.mark.parametrize("percent", [0.0, 50.0, 75.0, 98.0, 100.0])
@pytest.mark.parametrize("shape", [(1,), (2,), (7, 5), (40, 31)])
def test_a_percentile_is_numpys(percent, shape):
    pixels = np.random.default_rng(3).integers(0, 256, shape).astype(np.uint8)
    for values in (pixels, pixels[::-1], pixels / 7.0):
        assert percentile(values, percent) == pytest.approx(np.percentile(values, percent))


def test_sums_of_rows_are_numpys():
    pixels = np.random.default_rng(3).integers(0, 256, (40, 31)).astype(np.uint8)
    for part in (pixels, pixels[:, 3:20], pixels > 128, (pixels > 128)[1:, :5]):
        assert (row_sums(part) == part.sum(axis=1)).all()
