"""The visual gyro's rotation, from rays of known points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from companion.perception.visual_rotation import fit_rotation

SIGMA = 0.002


def seen_points(turn, moved, seed, count=40):
    """Unit rays of random points before and after a camera turned by `turn` and moved."""
    rng = np.random.default_rng(seed)
    rays = rng.normal([0.0, 0.0, 1.5], 1.0, (count, 3))
    points = rays / np.linalg.norm(rays, axis=1)[:, None] * rng.uniform(2.0, 20.0, (count, 1))
    before = points + SIGMA * rng.normal(size=points.shape)
    r = Rotation.from_rotvec(turn).as_matrix()
    after = (points - r @ moved) @ r
    return (p / np.linalg.norm(p, axis=1)[:, None] for p in (before, after))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("moved", [np.zeros(3), np.array([0.1, 0.0, 0.12])])
def test_the_rotation_is_found_among_points_near_and_far(seed, moved):
    turn = np.array([0.03, -0.2, 0.05])
    before, after = seen_points(turn, moved, seed)
    found = fit_rotation(before, after, moved, SIGMA)
    assert np.abs(found.vector - turn).max() < 0.006
    assert found.sigma < 0.003


def test_a_third_of_wrong_matches_does_no_harm():
    turn = np.array([0.0, 0.15, -0.02])
    before, after = seen_points(turn, np.zeros(3), 7)
    after = np.array(list(after))
    after[:13] = np.roll(after[:13], 1, axis=0)
    found = fit_rotation(np.array(list(before)), after, np.zeros(3), SIGMA)
    assert np.abs(found.vector - turn).max() < 0.005


def test_points_that_agree_on_nothing_give_no_rotation():
    rng = np.random.default_rng(0)
    before, after = (rng.normal([0.0, 0.0, 2.0], 1.0, (40, 3)) for _ in range(2))
    before, after = (p / np.linalg.norm(p, axis=1)[:, None] for p in (before, after))
    assert fit_rotation(before, after, np.zeros(3), SIGMA) is None
