"""What stands around, from points known by parallax."""

import numpy as np
import pytest

from companion.estimation.landmark_places import Drift
from companion.estimation.parallax_map import ParallaxMap, doubted, with_others
from companion.perception.parallax import FixedPoints

HERE = np.array([0.0, 0.0, 2.0])


def points(places, first=0, base=1.0, since=1.0, sigma=0.1):
    places = np.array(places, float).reshape(-1, 3)
    n = len(places)
    names = np.arange(first, first + n)
    return FixedPoints(places, np.full(n, sigma), names, np.full(n, base), np.full(n, since))


def trunk(x, y, radius, count=8, first=0):
    angles = np.linspace(np.pi / 2, 3 * np.pi / 2, count)  # its side towards the drone
    ring = [
        [x + radius * np.cos(a), y + radius * np.sin(a), 1.5 + 0.1 * k]
        for k, a in enumerate(angles)
    ]
    return points(ring, first)


def after(*looks):
    seen = ParallaxMap()
    for n, fixed in enumerate(looks):
        seen.update(fixed, HERE, 0.1 * n)
    return seen.standing()


def test_points_on_a_trunk_become_a_cylinder():
    found = after(*[trunk(4.0, 0.5, 0.6)] * 3).cylinders
    np.testing.assert_allclose(found, [[4.0, 0.5, 0.6, 0.1]], atol=0.05)


def test_a_point_that_stands_alone_does_not_count():
    assert not len(after(*[points([[4.0, 0.0, 2.0]])] * 3).cylinders)


def test_ground_and_far_points_are_not_in_the_way():
    ground = points([[3.0, 0.1 * k, 0.1] for k in range(9)])
    far = points([[9.5, 0.1 * k, 2.0] for k in range(9)], first=20)
    high = points([[3.0, 0.1 * k, 7.0] for k in range(9)], first=40)
    assert not len(after(ground, far, high).cylinders)


def test_ground_that_stands_by_its_doubt_alone_is_not_in_the_way():
    """Ground 2 m below, seen a quarter too near: 0.5 m over the ground, known to 0.3 m."""
    too_near = [[1.2, 0.1 * k, 0.5] for k in range(9)]
    assert not len(after(*[points(too_near, sigma=0.3)] * 3).cylinders)
    assert len(after(*[points(too_near, sigma=0.03)] * 3).cylinders) == 1
    level = [[1.2, 0.1 * k, 2.0] for k in range(9)]  # its doubt lies along the ray: it stands
    assert len(after(*[points(level, sigma=0.3)] * 3).cylinders) == 1


def test_a_wall_stays_a_set_of_points():
    wall = points([[4.0, y, 2.0] for y in np.arange(-3.0, 3.0, 0.3)])
    found = after(wall, wall, wall)
    assert not len(found.cylinders)
    assert len(found.points) == 20


def test_a_corner_whose_place_is_refined_moves():
    found = after(trunk(5.0, 0.0, 0.4), trunk(4.5, 0.0, 0.4), trunk(4.0, 0.0, 0.4)).cylinders
    assert len(found) == 1
    assert abs(found[0, 0] - 4.0) < 0.05


def test_points_are_forgotten_after_a_while():
    seen = ParallaxMap()
    seen.update(trunk(4.0, 0.0, 0.5), HERE, 0.0)
    for n in range(3):
        seen.update(FixedPoints.none(), HERE, 13.0 + n)
    assert not len(seen.standing().cylinders)


def test_what_a_known_trunk_explains_is_not_told_twice():
    known = np.array([[4.0, 0.0, 1.0, 0.05]])
    others = np.array([[3.2, 0.3, 0.2, 0.1], [4.0, 2.0, 0.3, 0.1]])
    np.testing.assert_array_equal(
        with_others(known, others, HERE), [[4.0, 0.0, 1.0, 0.05], [4.0, 2.0, 0.3, 0.1]]
    )


def test_a_doubtful_own_motion_makes_points_doubtful():
    """With 0.3 m/√s of drift, a base of 1 m after 1 s leaves 30 % of each distance in doubt."""
    near = points([[1.0, 0.0, 2.0], [4.0, 0.0, 2.0]])
    assert len(doubted(near, HERE, Drift(position=0.05)).names) == 2
    assert not len(doubted(near, HERE, Drift(position=0.3)).names)
    longer = points([[4.0, 0.0, 2.0]], base=4.0)
    kept = doubted(longer, HERE, Drift(position=0.3))
    np.testing.assert_allclose(kept.sigmas, np.hypot(0.1, 0.3), rtol=1e-6)
    turned = doubted(points([[4.0, 0.0, 2.0]]), HERE, Drift(yaw=0.02))
    np.testing.assert_allclose(turned.sigmas, np.hypot(0.1, 0.02 * 16), rtol=1e-6)


def test_points_that_drift_has_made_poor_are_forgotten():
    seen = ParallaxMap()
    seen.update(trunk(4.0, 0.0, 0.5), HERE, 0.0)
    sigmas = []
    for n in range(1, 9):
        seen.update(FixedPoints.none(), HERE, 0.1 * n, drift=Drift(position=0.15))
        sigmas += seen.standing().cylinders[:, 3].tolist()
    assert sigmas[0] < sigmas[-1] < 0.45
    assert not len(seen.standing().cylinders)


def test_drift_makes_a_point_doubtful_by_its_distance_over_the_base_and_by_the_time():
    """8 m off: yaw and what is left of the tilt add 8 m each, and 8 / 2 of it is along."""
    fixed = points([[8.0, 0.0, 2.0]], base=2.0, since=0.5)
    second = Drift(position=0.02, yaw=0.003, tilt=0.01, tilt_kept=0.6)
    turn = 0.003**2 + 0.01**2 * (1.0 - 0.36)
    expected = np.sqrt(0.1**2 + (0.02**2 + turn * 64.0) * 0.5 * 16.0)
    assert doubted(fixed, HERE, second).sigmas == pytest.approx([expected])
