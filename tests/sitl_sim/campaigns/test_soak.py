"""A soak of seconds: flights, collisions, and growth of memory and open files."""

import numpy as np
import pytest

from sitl_sim.campaigns.soak import SoakResult, _collisions, growth, soak


def test_two_short_flights():
    results = list(soak(hours=20.0 / 3600.0, drones=1, minutes=10.0 / 60.0, seed=1))
    assert len(results) == 2
    assert all(p.collisions == 0 and p.rss_mb > 10 and p.files > 3 for p in results)


def test_growth_counts_from_the_second_flight():
    flights = [
        SoakResult(0.1 * n, 1, 0, 0, 2, mb, 9 + n) for n, mb in enumerate([100, 150, 151, 152])
    ]
    assert growth(flights) == (2, 2)


WORLD = {"cylinders": [{"x": 20.0, "y": 0.0, "radius": 0.5, "height": 8.0}], "boxes": []}
RADIUS = 0.2


def truth(*places):
    """Drones that hover 2 m up, each at its list of (x, y, z) m, one every 20 ms."""
    p = np.stack([np.array(place, float) for place in places], axis=1)
    return {"position": p, "velocity": np.zeros_like(p)}


def hover(x, y=0.0, z=2.0):
    return [(x, y, z)] * 50


def pass_by(gap):
    """On a line beside a drone that hovers at the origin."""
    return [(0.1 * k - 2.5, gap, 2.0) for k in range(50)]


@pytest.mark.parametrize(
    ("drones", "grounded", "count"),
    [
        ([hover(0.0), hover(1.0)], set(), 0),
        ([hover(0.0), pass_by(0.39)], set(), 1),
        ([hover(0.0), pass_by(0.41)], set(), 0),
        ([hover(0.0), pass_by(0.39), pass_by(0.3)], set(), 3),  # every pair of the three
        ([hover(0.0), pass_by(0.39)], {1}, 0),  # a drone that a fault grounds may fall on others
        ([hover(19.35), hover(0.0)], set(), 1),  # 0.15 m from the trunk
        ([hover(19.25), hover(0.0)], set(), 0),
        ([hover(19.35), hover(0.0)], {0}, 0),
        ([hover(0.0, z=0.0), hover(0.1, z=0.0)], set(), 0),  # side by side on the ground
    ],
)
def test_collisions_of_healthy_drones_are_counted(drones, grounded, count):
    assert _collisions(truth(*drones), grounded, RADIUS, WORLD) == count


def test_a_healthy_drone_that_falls_is_counted():
    z = np.maximum(2.0 - 0.1 * np.arange(50), 0.0)
    fallen = truth([(0.0, 0.0, h) for h in z], hover(5.0))
    fallen["velocity"][:20, 0, 2] = -5.0
    assert _collisions(fallen, set(), RADIUS, WORLD) == 1
    assert _collisions(fallen, {0}, RADIUS, WORLD) == 0
