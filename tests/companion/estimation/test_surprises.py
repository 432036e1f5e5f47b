"""Surprises: what counts as one, and for how long."""

import math

import numpy as np
import pytest

from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.neighbours import NeighbourEstimator
from companion.estimation.surprises import Surprises
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.camera import Camera
from companion.perception.frontend import Detections
from companion.perception.view import View
from companion.types import Detection
from mavlink_bridge.shared.frames import quaternion_from_euler, rotation_matrix
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.tracks import track

VIEW = View(Camera.equidistant(640, 400, 160.0), needs_foot=False)
NOTHING = KnownObstacles()


def own(yaw=0.0):
    q = quaternion_from_euler(0.0, 0.0, yaw)
    return VehicleState(0.0, np.zeros(3), np.zeros(3), q, np.zeros(3))


def sure(place, v=(0.0, 0.0, 0.0), n=1):
    """A new track known to 0.1 m."""
    t = track(n, place, v)
    t.P[:] *= 0.01
    return t


def counted(place, v=(0.0, 0.0, 0.0), obstacles=NOTHING, looks=6, yaw_then=0.0, counting=True):
    """Surprises of a track that is new at 0.6 s, after pictures without it along `yaw_then`."""
    surprises = Surprises(VIEW)
    for k in range(looks):
        surprises.update(0.1 * k, own(yaw_then), [], obstacles)
    surprises.update(0.1 * looks, own(), [sure(place, v)], obstacles, counting=counting)
    surprises.update(0.1 * looks, own(), [sure(place, v)], obstacles)  # known by now
    return surprises.lately(0.1 * looks)


def trunk(x, y):
    return KnownObstacles(occluders=np.array([[x, y, 0.2]]))


@pytest.mark.parametrize(
    ("count", "situation"),
    [
        (1, {"place": [2.0, 0.5, 0.0]}),
        (1, {"place": [2.9, 0.0, 0.0]}),
        (0, {"place": [3.1, 0.0, 0.0]}),  # far enough for a first look
        (0, {"place": [2.0, 0.5, 0.0], "counting": False}),  # others still take off
        (0, {"place": [2.0, 0.5, 0.0], "looks": 3}),  # it has hardly looked yet
        (0, {"place": [-1.0, 2.0, 0.0]}),  # beyond the picture's edge
        (0, {"place": [2.0, 0.5, 0.0], "yaw_then": math.pi}),  # it looked the other way
        (0, {"place": [0.6, 2.0, 0.0], "v": [3.0, 0.0, 0.0]}),  # flew in from the side
        (0, {"place": [2.0, 0.5, 0.0], "obstacles": trunk(1.0, 0.25)}),
        (0, {"place": [2.0, 0.5, 0.0], "obstacles": trunk(1.0, -0.3)}),  # it came out behind it
        (1, {"place": [2.0, 0.5, 0.0], "obstacles": trunk(1.0, -0.7)}),
        (1, {"place": [2.0, 0.5, 0.0], "obstacles": trunk(3.0, 0.8)}),
    ],
)
def test_a_surprise_is_new_and_near_and_was_in_plain_view(count, situation):
    assert counted(**situation) == count


@pytest.mark.parametrize(("pictures", "count"), [(1, 0), (2, 1), (5, 1)])
def test_pictures_searched_half_as_often_count_as_long(pictures, count):
    surprises = Surprises(VIEW)
    for k in range(pictures):
        surprises.update(0.2 * k, own(), [], NOTHING)
    surprises.update(0.2 * pictures, own(), [sure([2.0, 0.5, 0.0])], NOTHING)
    assert surprises.lately(0.2 * pictures) == count


@pytest.mark.parametrize(("partly", "counts"), [(False, [1, 1]), (True, [0, 1])])
def test_what_is_looked_at_without_a_search_is_judged_with_the_next_search(partly, counts):
    neighbours = NeighbourEstimator(VIEW, TrackerConfig())
    place = np.array([2.0, 0.5, 0.2])
    ray = place @ rotation_matrix(VIEW.mount) / np.linalg.norm(place)
    look = [Detection(ray, float(np.linalg.norm(place)), 0.003, 0.05)]
    for k in range(11):
        neighbours.update(0.1 * k, Detections(0.1 * k, own(), look if k >= 10 else []), NOTHING)
    found = []
    for k, part in ((11, partly), (12, False)):
        seen = Detections(0.1 * k, own(), look, partly=part)
        neighbours.update(0.1 * k, seen, NOTHING)
        found.append(neighbours.surprises(0.1 * k))
    assert found == counts


def test_a_neighbour_that_has_come_from_afar_is_none():
    surprises = Surprises(VIEW)
    for k in range(60):
        surprises.update(0.1 * k, own(), [sure([7.0 - 0.1 * k, 0.0, 0.0], [-1.0, 0, 0])], NOTHING)
    assert surprises.lately(5.9) == 0


def test_each_counts_for_twenty_seconds_and_a_new_frame_forgets_all():
    surprises = Surprises(VIEW)
    for k in range(300):
        new = {100: [sure([2.0, 0.0, 0.0])], 150: [sure([1.5, 1.0, 0.0], n=2)]}
        surprises.update(0.1 * k, own(), new.get(k, []), NOTHING)
        assert surprises.lately(0.1 * k) == (k >= 100) + (k >= 150)
    assert surprises.lately(30.1) == 1
    assert surprises.lately(35.1) == 0
    for reset in (False, True):
        again = Surprises(VIEW)
        for k in range(6):
            again.update(0.1 * k, own(), [], NOTHING)
        if reset:
            again.reset()
        again.update(0.6, own(), [sure([2.0, 0.0, 0.0])], NOTHING)
        assert again.lately(0.6) == (not reset)


@pytest.mark.parametrize(
    ("missed", "place", "count"),
    [
        (1.0, [2.4, 0.0, 0.0], 0),  # about where it would have flown to
        (1.0, [0.8, 0.0, 0.0], 1),  # another one
        (2.5, [2.6, 0.0, 0.0], 1),  # too long ago
    ],
)
def test_one_that_was_lost_for_a_moment_is_known(missed, place, count):
    surprises = Surprises(VIEW)
    flying = [0.2, 0.0, 0.0]
    for k in range(60):
        surprises.update(0.1 * k, own(), [sure([3.5 - 0.02 * k, 0.0, 0.0], flying)], NOTHING)
    back = 6.0 + missed
    for time in np.arange(6.0, back - 0.05, 0.1):
        surprises.update(time, own(), [], NOTHING)
    surprises.update(back, own(), [sure(place, n=2)], NOTHING)
    assert surprises.lately(back) == count


@pytest.mark.parametrize(("step", "count"), [(0.15, 0), (0.35, 0), (0.6, 3)])
def test_finds_of_known_neighbours_after_a_step_of_the_own_position_are_none(step, count):
    """Circle of thirty: a step of 0.13 m, and twelve tracks began anew beside their old ones."""
    surprises = Surprises(VIEW)
    known = [sure([2.0, 0.8 * k, 0.0], n=k + 1) for k in (-1, 0, 1)]
    for k in range(6):
        surprises.update(0.1 * k, own(), known, NOTHING)
    twins = [sure([2.0 + step, 0.8 * k, 0.0], n=k + 11) for k in (-1, 0, 1)]
    surprises.update(0.6, own(), [*known, *twins], NOTHING)
    assert surprises.lately(0.6) == count


def test_one_that_was_lost_comes_back_once():
    surprises = Surprises(VIEW)
    for k in range(6):
        surprises.update(0.1 * k, own(), [sure([2.0, 0.0, 0.0])], NOTHING)
    for k in range(6, 12):
        surprises.update(0.1 * k, own(), [], NOTHING)
    two = [sure([2.0, 0.3, 0.0], n=2), sure([2.0, -0.3, 0.0], n=3)]
    surprises.update(1.2, own(), two, NOTHING)
    assert surprises.lately(1.2) == 1


def test_pictures_that_miss_a_neighbour_until_it_is_near_count():
    """Through the tracker: two clear looks make it a neighbour, so it is one from 1.1 s on."""
    neighbours = NeighbourEstimator(VIEW, TrackerConfig())
    place = np.array([2.0, 0.5, 0.2])
    ray = place @ rotation_matrix(VIEW.mount) / np.linalg.norm(place)
    look = [Detection(ray, float(np.linalg.norm(place)), 0.003, 0.05)]
    counts = []
    for k in range(13):
        neighbours.update(0.1 * k, Detections(0.1 * k, own(), look if k >= 10 else []), NOTHING)
        counts.append(neighbours.surprises(0.1 * k))
    assert counts == [0] * 11 + [1] * 2
    neighbours.reset()
    assert neighbours.surprises(1.3) == 0
