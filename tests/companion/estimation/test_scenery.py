"""Scenery: what is far behind is dropped, and no neighbour is."""

import math

import numpy as np
import pytest

from companion.estimation.scenery import Scenery
from companion.types import Detection
from mavlink_bridge.shared.frames import quaternion_from_euler, rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

MOUNT = quaternion_from_euler(-math.pi / 2, 0.0, -math.pi / 2)  # looks along body x
LEVEL = quaternion_from_euler(0.0, 0.0, 0.0)
NOISE = 0.008  # rad, of a find's direction
UNSURE = 0.1  # share of its range


def weaving(t):
    """A way [m] and velocity [m/s] north, round trunks on both sides."""
    p = np.array([0.3 * t, 0.4 * math.sin(0.9 * t), 0.0])
    return p, np.array([0.3, 0.36 * math.cos(0.9 * t), 0.0])


def steady(t):
    return np.array([0.8 * t, 0.2 * t, 0.0]), np.array([0.8, 0.2, 0.0])


def own(t, way=weaving, jump=0.0):
    p, v = way(t)
    return VehicleState(t, p + jump, v, LEVEL, np.zeros(3))


def found(state, place, rng, told=1.0):
    """A find of what is at (3,) m, its range `told` times the true one."""
    away = (place - state.p) @ rotation_matrix(MOUNT)
    distance = np.linalg.norm(away)
    direction = away / distance + rng.normal(0.0, NOISE, 3)
    told_range = told * distance * (1.0 + rng.normal(0.0, UNSURE))
    return Detection(direction / np.linalg.norm(direction), told_range)


def kept(place, seconds=20.0, told=lambda distance: 1.0, way=weaving, jump=None, scenery=None):
    """When [s] finds of what is at `place(t)` are kept, of ten a second."""
    rng, scenery, times = np.random.default_rng(3), scenery or Scenery(), []
    for t in np.arange(0.0, seconds, 0.1):
        state = own(t, way)
        share = told(float(np.linalg.norm(place(t) - state.p)))
        find = found(state, np.asarray(place(t), float), rng, share)
        reported = state if jump is None else own(t, way, jump(t))
        if scenery.without([find], t, reported, MOUNT):
            times.append(t)
    return np.array(times)


def as_at(distance):
    """Return what a detector tells of something that looks like a drone at `distance` m."""
    return lambda true: distance / true


def woods(t):
    return np.array([80.0, 10.0, 1.0])


def test_woods_that_look_like_a_drone_nearby_are_dropped_within_ten_seconds():
    times = kept(woods, told=as_at(1.7))
    assert times.max() < 10.0


def test_woods_cannot_be_told_from_a_neighbour_by_steady_flight():
    """One that flies along would look the same."""
    assert len(kept(woods, told=as_at(1.7), way=steady)) == 200


def wobble(t, size=0.06):
    return size * np.array([math.sin(1.7 * t), math.cos(2.3 * t), math.sin(1.1 * t + 1.0)])


NEIGHBOURS = {
    "hovers": lambda t: np.array([7.0, 1.0, 0.0]),
    "flies straight": lambda t: np.array([1.8 + 0.3 * t, -0.5, 0.1]),
    "comes": lambda t: np.array([14.0 - 0.5 * t, 0.2, 0.0]),
    "weaves, too, a second later": lambda t: weaving(t - 1.0)[0] + [2.1, 0.4, 0.0],
    "passes": lambda t: np.array([4.0, 8.0 - 0.8 * t, 0.3]),
}


@pytest.mark.parametrize("name", NEIGHBOURS)
def test_a_neighbour_is_kept(name):
    place = NEIGHBOURS[name]
    assert len(kept(lambda t: place(t) + wobble(t))) == 200


def test_one_that_comes_on_a_collision_course_is_kept_though_its_direction_stays():
    def comes(t):
        p, _ = weaving(t)
        return p + (12.0 - 0.6 * t) * np.array([0.96, 0.28, 0.0])

    assert len(kept(comes, seconds=18.0)) == 180


def test_a_position_that_jumps_moves_no_neighbour():
    """The autopilot's place goes to and fro by half a metre, its velocity does not."""

    def beside(t):
        p, _ = steady(t)
        return p + np.array([1.0, 1.6, 0.0]) + wobble(t, 0.03)

    def jumps(t):
        return np.array([0.0, 0.5 * math.sin(2.0 * t), 0.0])

    assert len(kept(beside, way=steady, jump=jumps)) == 200


def known():
    """Scenery that knows the woods, 20 s after the start."""
    scenery = Scenery()
    kept(woods, told=as_at(1.7), scenery=scenery)
    return scenery


@pytest.mark.parametrize(
    ("share", "is_kept"),
    [(1.0, False), (3.0, True)],  # as large as the woods seem; as far as a third of that says
)
def test_before_known_scenery_another_size_is_kept(share, is_kept):
    state = own(20.0)
    find = found(state, woods(20.0), np.random.default_rng(1), 1.7 * share / 80.0)
    assert bool(known().without([find], 20.0, state, MOUNT)) is is_kept


def test_beside_known_scenery_a_drone_is_kept():
    state = own(20.0)
    find = found(state, state.p + np.array([1.6, 0.6, 0.0]), np.random.default_rng(1))
    assert known().without([find], 20.0, state, MOUNT)


def test_known_scenery_turns_with_the_heading():
    scenery, angle = known(), 0.3
    scenery.turn(angle)
    turned = VehicleState(
        20.0, np.zeros(3), np.zeros(3), quaternion_from_euler(0.0, 0.0, angle), np.zeros(3)
    )
    state = own(20.0)
    find = found(state, woods(20.0), np.random.default_rng(1), 1.7 / 80.0)
    assert not scenery.without([find], 20.0, turned, MOUNT)
    assert scenery.without([find], 20.1, own(20.1), MOUNT)


def quiet(scenery, until):
    """Pictures without a find, up to a time [s]."""
    for t in np.arange(20.0, until, 0.5):
        scenery.without([], t, own(t), MOUNT)


FORGOTTEN = {
    "reset": lambda s: s.reset(),
    "twenty seconds without it": lambda s: quiet(s, 41.0),
    "no pictures for a second": lambda s: s.without([], 22.0, own(22.0), MOUNT),
}


@pytest.mark.parametrize("name", FORGOTTEN)
def test_scenery_is_forgotten(name):
    scenery = known()
    FORGOTTEN[name](scenery)
    find = found(own(20.0), woods(20.0), np.random.default_rng(1), 1.7 / 80.0)
    assert scenery.without([find], 41.0, own(20.0), MOUNT)


def test_scenery_is_known_after_ten_seconds_without_it():
    scenery = known()
    quiet(scenery, 30.0)
    find = found(own(30.0), woods(30.0), np.random.default_rng(1), 1.7 / 80.0)
    assert not scenery.without([find], 30.0, own(30.0), MOUNT)


def test_a_velocity_that_is_no_number_drops_nothing_and_raises_nothing():
    scenery, rng = Scenery(), np.random.default_rng(2)
    for t in np.arange(0.0, 8.0, 0.1):
        state = VehicleState(t, weaving(t)[0], np.full(3, np.nan), LEVEL, np.zeros(3))
        find = found(state, woods(t), rng, 1.7 / 80.0)
        assert scenery.without([find], t, state, MOUNT) == [find]
