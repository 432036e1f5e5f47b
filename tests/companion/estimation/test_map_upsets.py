"""Upsets of the obstacle map: trunks that were known for good, and moved or vanished."""

import numpy as np
import pytest

from companion.estimation.landmark_association import Landmark
from companion.estimation.landmark_places import Drift
from companion.estimation.map_upsets import MapUpsets
from companion.estimation.obstacle_map import ObstacleConfig, ObstacleMap
from companion.types import Trunk
from mavlink_bridge.wire.messages import VehicleState

FORWARD = np.array([0.5, -0.5, 0.5, -0.5])  # a camera that looks along the body's x axis
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
PLACES = np.array([[3.0, -2.0], [4.0, 0.5], [3.5, 2.5], [5.0, -0.8]])


def see(known, time, error=(0.0, 0.0), places=PLACES, **seen):
    """Take one look from (0, 0, 2) m at `time` [s]; the own state is wrong by `error` [m]."""
    trunks = [
        Trunk(np.array([-y, 0.0, x]) / np.hypot(x, y), float(np.hypot(x, y)), 0.2, 0.05)
        for x, y in places
    ]
    own = VehicleState(time, np.array([*error, 2.0]), np.zeros(3), LEVEL, np.zeros(3))
    known.update(trunks, own, FORWARD, np.radians(80.0), drift=Drift(0.005, 0.001), **seen)
    return known.upsets(time)


def test_a_map_that_is_right_has_no_upsets():
    known, rng = ObstacleMap(ObstacleConfig()), np.random.default_rng(3)
    assert [see(known, 0.1 * k, rng.normal(0.0, 0.02, 2)) for k in range(100)] == 100 * [0]


def test_a_position_that_steps_by_a_metre_upsets_each_known_trunk():
    """All four seem to be gone, and four others to be there."""
    known = ObstacleMap(ObstacleConfig())
    for k in range(20):
        assert see(known, 0.1 * k) == 0
    upsets = [see(known, 2.0 + 0.1 * k, (1.0, 0.0)) for k in range(10)]
    assert upsets[0] == 0
    assert upsets[-1] == 4


def test_a_trunk_of_few_looks_that_vanishes_upsets_nothing():
    known = ObstacleMap(ObstacleConfig())
    for k in range(10):
        see(known, 0.1 * k, places=PLACES[:3])
    for k in range(5):
        see(known, 1.0 + 0.1 * k)
    for k in range(10):
        upsets = see(known, 1.5 + 0.1 * k, places=PLACES[:3])
    assert upsets == 0


def landmark(x, sigma=0.1):
    return Landmark((x, 0.0), 0.3, sigma**2, 0.0, odds=5.0, confirmed=True)


@pytest.mark.parametrize(
    ("x", "shift", "upsets"), [(4.0, 0.44, 0), (4.0, 0.46, 1), (4.0, -0.46, 1), (6.1, 0.46, 0)]
)
def test_a_near_landmark_is_not_shifted_by_more_than_four_sigma_and_5_cm(x, shift, upsets):
    counter, known = MapUpsets(), landmark(x)
    counter.before([known], (0.0, 0.0))
    known.axis = x + shift, 0.0
    counter.shifted(1.0)
    assert counter.lately(1.0) == upsets


def test_a_landmark_that_is_gone_counts_once_and_for_20_seconds():
    counter, known, other = MapUpsets(), landmark(4.0), landmark(4.0)
    counter.before([known], (0.0, 0.0))
    counter.vanished(1.0, [known, other])
    assert [counter.lately(t) for t in (1.0, 20.9, 21.1)] == [1, 1, 0]
