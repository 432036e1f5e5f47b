"""Neighbours: carried to now, remembered behind a trunk, turned and forgotten with the frame."""

import numpy as np
import pytest

from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.neighbours import NeighbourEstimator
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.camera import Camera
from companion.perception.frontend import Detections
from companion.perception.view import View
from companion.types import Detection
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

OWN = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
VIEW = View(Camera.equidistant(640, 480, 120.0), needs_foot=False)
NOTHING = KnownObstacles()
START, V = np.array([6.0, -1.0, 0.5]), np.array([0.0, 1.0, 0.0])
LATE = 0.1  # s from a picture to its tick


def place(time):
    """Where the neighbour is, that flies to the left before a drone that hovers at the origin."""
    return START + V * time


def look(*places):
    """Looks from the origin at places (3,) m."""
    mount = rotation_matrix(VIEW.mount)
    return [
        Detection(p @ mount / np.linalg.norm(p), float(np.linalg.norm(p)), 0.003, 0.05)
        for p in places
    ]


def that_follows(seconds=2.0):
    """An estimator that has seen the neighbour ten times a second, and its last tracks."""
    neighbours = NeighbourEstimator(VIEW, TrackerConfig())
    for k in range(round(10 * seconds) + 1):
        seen = Detections(0.1 * k, OWN, look(place(0.1 * k)))
        tracks = neighbours.update(0.1 * k + LATE, seen, NOTHING)
    return neighbours, tracks


def test_tracks_are_carried_from_the_picture_to_the_tick():
    _, (track,) = that_follows(2.0)
    assert track.v == pytest.approx(V, abs=0.05)
    assert track.p == pytest.approx(place(2.1), abs=0.02)


def test_a_tick_without_a_picture_carries_the_tracks_on():
    neighbours, _ = that_follows(2.0)
    (track,) = neighbours.update(2.3, Detections(5.0, None, look(np.ones(3))), NOTHING)
    assert track.p == pytest.approx(place(2.3), abs=0.04)
    assert track.unseen == pytest.approx(0.3, abs=0.01)


def unseen(seconds, obstacles, to):
    """Return the tracks after pictures without the neighbour, of a drone of attitude `to`."""
    neighbours, tracks = that_follows(2.0)
    own = VehicleState(0.0, np.zeros(3), np.zeros(3), np.array(to), np.zeros(3))
    for k in range(1, round(10 * seconds) + 1):
        tracks = neighbours.update(2.1 + 0.1 * k, Detections(2.0 + 0.1 * k, own), obstacles)
    return tracks


AHEAD, ASTERN = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
TRUNK = KnownObstacles(occluders=np.array([[3.0, 0.6, 1.0]]))  # x, y, radius, m
ASIDE = KnownObstacles(occluders=np.array([[3.0, -4.0, 1.0]]))


@pytest.mark.parametrize(
    ("attitude", "obstacles", "left"),
    [(AHEAD, NOTHING, 0), (AHEAD, ASIDE, 0), (AHEAD, TRUNK, 1), (ASTERN, NOTHING, 1)],
)
def test_a_neighbour_that_should_show_and_does_not_is_soon_no_more(attitude, obstacles, left):
    """Behind a trunk, or out of the picture, nothing is said of it."""
    assert len(unseen(0.6, obstacles, attitude)) == left


def test_who_is_near_the_edge_of_the_picture_and_in_doubt_is_not_missed():
    """Seen last 53° off the axis, of 60° that show: it may have left the picture at once."""
    neighbours = NeighbourEstimator(VIEW, TrackerConfig())
    near = np.array([0.6, 0.8, 0.0])  # 1 m away, 53° off
    for k in range(6):
        neighbours.update(0.1 * k, Detections(0.1 * k, OWN, look(near)), NOTHING)
    for k in range(6, 16):
        tracks = neighbours.update(0.1 * k, Detections(0.1 * k, OWN), NOTHING)
    assert len(tracks) == 1
    for k in range(6):  # 6 m away, where its doubt is a small angle
        neighbours.update(2.0 + 0.1 * k, Detections(2.0 + 0.1 * k, OWN, look(START)), NOTHING)
    ids = [t.id for t in neighbours.update(2.6, Detections(), NOTHING)]
    for k in range(6, 16):
        tracks = neighbours.update(2.0 + 0.1 * k, Detections(2.0 + 0.1 * k, OWN), NOTHING)
    assert max(ids) not in [t.id for t in tracks]


def test_a_turn_of_the_frame_turns_the_tracks_about_the_drone():
    neighbours, (before,) = that_follows(2.0)
    neighbours.turn(np.array([1.0, 0.0, 0.0]), 0.1)
    (after,) = neighbours.update(2.1, Detections(), NOTHING)
    c, s = np.cos(0.1), np.sin(0.1)
    east, north = before.p[0] - 1.0, before.p[1]
    expected = [1.0 + c * east - s * north, s * east + c * north, before.p[2]]
    assert after.p == pytest.approx(expected, abs=1e-6)


def test_where_the_frame_begins_anew_no_neighbour_is_known():
    neighbours, _ = that_follows(2.0)
    neighbours.reset()
    assert neighbours.update(2.2, Detections(), NOTHING) == []


def test_eyes_are_steady_that_show_the_same_neighbour_again_and_again():
    neighbours, _ = that_follows(0.9)  # ten finds, of which the first two make it known
    assert neighbours.steady
    neighbours.reset()
    assert not neighbours.steady


@pytest.mark.parametrize("also_right", [False, True])
def test_eyes_are_not_steady_that_show_something_else_in_each_picture(also_right):
    """Beside what is new each time, a right one or none: half of what is shown, or nothing."""
    neighbours = NeighbourEstimator(VIEW, TrackerConfig())
    rng = np.random.default_rng(7)
    for k in range(50):
        ghost = np.append(rng.uniform(3.0, 8.0), rng.uniform(-4.0, 4.0, 2))
        shown = look(ghost, *[place(0.0)] * also_right)
        neighbours.update(0.1 * k, Detections(0.1 * k, OWN, shown), NOTHING)
        assert not neighbours.steady
