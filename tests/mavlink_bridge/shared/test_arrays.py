"""Products of short vectors are numpy's own, to the last bit."""

import numpy as np
import pytest

from mavlink_bridge.shared.arrays import cross


@pytest.mark.parametrize(
    ("a", "b"), [((3,), (3,)), ((7, 3), (7, 3)), ((7, 3), (3,)), ((3,), (7, 3))]
)
def test_cross_is_numpys(a, b):
    rng = np.random.default_rng(1)
    for _ in range(100):
        x, y = rng.normal(size=a), rng.normal(size=b)
        np.testing.assert_array_equal(cross(x, y), np.cross(x, y))
