"""Reciprocity: how far a neighbour that is met is expected to give way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.guidance.reciprocity import ReciprocityConfig, give_way_velocity
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState

CONFIG = ReciprocityConfig()
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
NUMBER = st.floats(-5, 5)


def state(p, v):
    return VehicleState(0.0, np.array(p, float), np.array(v, float), LEVEL, np.zeros(3))


def yields(p, v, own=(1.0, 0.0, 0.0), config=CONFIG):
    """The change of a neighbour at p with velocity v, met by a drone in the origin with own."""
    track = Track(1, np.array(p, float), np.array(v, float), np.eye(6), 1.0, 0.0)
    return give_way_velocity(state([0, 0, 0], own), track, 0.8, config)


def least_distance(p, v, own):
    """The least distance [m] of two drones at constant velocity."""
    r, w = np.array(p, float), np.array(v, float) - own
    return np.linalg.norm(r + w * max(-(r @ w) / (w @ w), 0.0))


def test_a_neighbour_makes_half_of_the_room_that_lacks():
    p, v, own = np.array([2.0, 0.2, 0.0]), np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0, 0])
    assert least_distance(p, v, own) == pytest.approx(0.2)
    assert least_distance(p, v + yields(p, v), own) == pytest.approx(0.5, abs=0.03)


def test_both_drones_together_make_the_whole_room():
    p, v, own = np.array([2.0, 0.2, 0.0]), np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0, 0])
    theirs, ours = yields(p, v, own), yields(-p, own, v)
    assert ours == pytest.approx(-theirs)
    assert least_distance(p, v + theirs, own + ours) == pytest.approx(0.8, abs=0.06)


def test_on_a_collision_course_the_neighbour_goes_to_its_right():
    assert yields([2.0, 0.0, 0.0], [-1.0, 0.0, 0.0])[1] > 0.0


@pytest.mark.parametrize(
    ("p", "v"),
    [
        ([2.0, 1.0, 0.0], [-1.0, 0.0, 0.0]),  # passes far enough
        ([1.0, 0.1, 0.0], [0.5, 0.0, 0.0]),  # flies ahead, does not look back
    ],
)
def test_a_neighbour_that_passes_far_or_does_not_see_does_not_give_way(p, v):
    assert not yields(p, v).any()


def test_a_neighbour_that_hardly_moves_may_look_anywhere():
    assert yields([1.0, 0.1, 0.0], [0.1, 0.0, 0.0])[1] > 0.0


def test_without_a_share_the_neighbour_flies_on_as_in_eq_14():
    assert not yields([2.0, 0.2, 0.0], [-1.0, 0, 0], config=ReciprocityConfig(share=0)).any()


@given(*[st.tuples(NUMBER, NUMBER, NUMBER)] * 3)
def test_the_change_is_finite_and_bounded(p, v, own):
    given_way = yields(p, v, own)
    assert np.isfinite(given_way).all()
    assert np.linalg.norm(given_way) <= CONFIG.most + 1e-9


@pytest.mark.parametrize(
    ("p", "v", "own", "change"),
    [
        # Passes 0.2 m off in 1 s: half of the 0.6 m that lack, straight off.
        ([2.0, 0.2, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.3, 0.0]),
        ([-0.2, 2.0, 5.0], [0.0, -1.0, 0.4], [0.0, 1.0, -0.3], [-0.3, 0.0, 0.0]),
        # In 1.7 s; looked ahead for 1.5 s, when it is (0.4, 0.2) off.
        ([3.4, 0.2, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.10518, 0.05259, 0.0]),
        # In 0.3 s: 0.35 m in the least time of 0.4 s, at the highest speed.
        ([0.6, 0.1, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.8, 0.0]),
        ([0.6, 0.5, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.375, 0.0]),
        # Slow: in 1 s all the same.
        ([0.5, 0.2, 0.0], [-0.3, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.3, 0.0]),
        # Goes away already, but is too near.
        ([0.5, 0.0, 0.0], [0.2, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.375, 0.0, 0.0]),
        # Both stand.
        ([0.4, 0.3, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.3, 0.225, 0.0]),
        # On a collision course: to the right of the line to it, whichever side it would pass.
        ([2.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.4, 0.0]),
        ([2.0, -0.05, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.00937, 0.37488, 0.0]),
        ([2.0, -0.07, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -0.365, 0.0]),
        # Passes exactly at the distance, and in the very same place.
        ([2.0, 0.8, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ],
)
def test_the_change_is_what_lacks_by_the_time_of_the_pass(p, v, own, change):
    assert yields(p, v, own) == pytest.approx(change, abs=1e-5)


@pytest.mark.parametrize(
    ("speed", "cosine", "sees"),
    [(0.5, 0.25, True), (0.5, 0.15, False), (0.31, 0.15, False), (0.3, -1.0, True)],
)
def test_a_neighbour_sees_as_far_off_its_way_as_configured(speed, cosine, sees):
    way = np.array([-cosine, np.sqrt(1.0 - cosine**2), 0.0])
    assert yields([0.5, 0.0, 0.0], speed * way, own=(0.0, 0.0, 0.0)).any() == sees
    back = way * [1.0, -1.0, 1.0]
    assert yields([0.5, 0.0, 0.0], speed * back, own=(0.0, 0.0, 0.0)).any() == sees
    wide, narrow = ReciprocityConfig(sees=-1.0), ReciprocityConfig(sees=1.0)
    assert yields([0.5, 0.0, 0.0], speed * way, own=(0.0, 0.0, 0.0), config=wide).any()
    assert yields([0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], own=(0.0, 0.0, 0.0), config=narrow).any()
