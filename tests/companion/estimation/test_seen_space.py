"""Seen space: looks fill it up to the first obstacle; time and the own way empty it."""

import numpy as np
import pytest

from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.seen_space import SECTORS, SeenSpace
from companion.perception.config import CameraConfig
from companion.perception.view import View, load_camera
from mavlink_bridge.wire.messages import VehicleState

REACH = 5.0
EAST, WEST = 0, SECTORS // 2
NOTHING = KnownObstacles()


@pytest.fixture(scope="module")
def view():
    return View(load_camera(CameraConfig()), needs_foot=False)


def at(p=(0.0, 0.0, 2.0), time=0.0, yaw=0.0):
    q = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    return VehicleState(time, np.array(p, float), np.zeros(3), q, np.zeros(3))


def test_a_look_shows_what_is_ahead_and_nothing_behind(view):
    free = SeenSpace(view, REACH).update(at(), at(), NOTHING, 0.3)
    assert free[EAST] == REACH
    assert free[WEST] == 0.0
    seen = {*(np.flatnonzero(free > 0.0) * 360 // SECTORS).tolist()}
    ahead = {*range(0, 80, 10), *range(290, 360, 10)}  # 160° of view
    assert ahead <= seen <= ahead | {80, 280}


def test_without_a_look_nothing_is_seen(view):
    assert not SeenSpace(view, REACH).update(at(), None, NOTHING, 0.3).any()


@pytest.mark.parametrize("known", ["cylinders", "occluders"])
def test_an_obstacle_hides_what_is_behind_it(view, known):
    trunk = np.array([[3.0, 1.0, 0.5]])
    free = SeenSpace(view, REACH).update(
        at((1.0, 1.0, 2.0)), at((1.0, 1.0, 2.0)), KnownObstacles(**{known: trunk}), 0.3
    )
    assert free[EAST] == pytest.approx(1.5)
    assert free[EAST + 3] == REACH
    behind = np.array([[-3.0, 1.0, 0.5]])
    free = SeenSpace(view, REACH).update(
        at((1.0, 1.0, 2.0)), at((1.0, 1.0, 2.0)), KnownObstacles(**{known: behind}), 0.3
    )
    assert free[EAST] == REACH


def test_what_is_not_looked_at_any_more_is_lost_at_the_speed_of_what_may_come(view):
    space = SeenSpace(view, REACH)
    space.update(at(), at(), NOTHING, 0.3)
    free = space.update(at(time=2.0, yaw=np.pi), at(time=2.0, yaw=np.pi), NOTHING, 0.3)
    assert free[WEST] == REACH
    assert free[EAST] == pytest.approx(REACH - 0.3 * 2.0)
    assert space.update(at(time=60.0), None, NOTHING, 0.3)[EAST] == 0.0


def test_flying_on_brings_the_edge_nearer_ahead_and_a_little_aside(view):
    space = SeenSpace(view, REACH)
    space.update(at(), at(), NOTHING, 0.0)
    free = space.update(at((1.0, 0.0, 2.0), time=0.1), None, NOTHING, 0.0)
    assert free[EAST] == pytest.approx(REACH - 1.3)
    assert free[EAST + 6] == pytest.approx(REACH - 0.8)  # 60° off the way
    back = space.update(at((0.0, 0.0, 2.0), time=0.2), None, NOTHING, 0.0)
    assert back[EAST] == pytest.approx(REACH - 1.6)  # never farther than before


def test_reset_forgets_looks_and_place(view):
    space = SeenSpace(view, REACH)
    space.update(at(), at(), NOTHING, 0.3)
    space.reset()
    free = space.update(at((50.0, 0.0, 2.0), time=0.1), at((50.0, 0.0, 2.0)), NOTHING, 0.3)
    assert free[EAST] == REACH
    assert free[WEST] == 0.0
