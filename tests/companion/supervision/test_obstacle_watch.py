"""The obstacle watch: a trunk that moves has a course and is named, one that stands has none."""

import numpy as np
import pytest

from companion.perception.frontend import Detections
from companion.supervision import obstacle_watch
from companion.supervision.obstacle_watch import ObstacleWatch
from companion.types import Track, Trunk
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

FORWARD = np.array([0.5, -0.5, 0.5, -0.5])  # a camera that looks along the body's x axis
TURNED = np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])  # 46° to the left of east
RADIUS, SIGMA = 0.3, 0.02


def look(time, axis, own_speed=0.0, q=TURNED, **trunk):
    """A picture of the trunk whose axis is at `axis` (2,) m, from 2 m above the ground."""
    own = VehicleState(time, np.array([own_speed * time, 1.0, 2.0]), np.zeros(3), q, np.zeros(3))
    offset = np.array([*axis, 2.0]) - own.p
    away = float(np.hypot(*offset[:2]))
    ray = (rotation_matrix(q) @ rotation_matrix(FORWARD)).T @ offset / np.linalg.norm(offset)
    seen = Trunk(ray, away, RADIUS, SIGMA)
    trunks = [Trunk(**(vars(seen) | trunk))]
    return Detections(time=time, own=own, trunks=trunks, searched=True, started=True)


def watched(velocity, seconds=1.5, **more):
    """What is known after so many seconds of looks at a trunk that moves."""
    watch = ObstacleWatch(FORWARD)
    for time in np.arange(0.0, seconds, 0.1):
        found = watch.update(time, look(time, np.array([4.0, 3.0]) + time * velocity, **more))
    return watch, found


@pytest.mark.parametrize("velocity", [(1.5, 0.0), (-0.4, -0.9)])
def test_a_trunk_that_moves_has_its_place_radius_doubt_and_course(velocity):
    _, found = watched(np.array(velocity))
    ((x, y, radius, sigma, vx, vy),) = found.cylinders
    assert (x, y) == pytest.approx(np.array([4.0, 3.0]) + 1.4 * np.array(velocity), abs=0.1)
    assert radius == RADIUS
    assert 0.01 < sigma < 0.1
    assert (vx, vy) == pytest.approx(velocity, abs=0.25)
    (words,) = found.broken
    assert f"{np.hypot(vx, vy):.1f} m/s" in words


def test_own_motion_moves_no_trunk():
    _, found = watched(np.zeros(2), own_speed=1.5)
    assert not len(found.cylinders)
    assert found.broken == ()


@pytest.mark.parametrize("trunk", [{"sigma": 0.2}, {"assumed": True}])
def test_a_range_that_is_not_sure_tells_of_no_motion(trunk):
    _, found = watched(np.array([1.5, 0.0]), **trunk)
    assert not len(found.cylinders)


def test_a_course_is_forgotten_where_the_trunk_is_not_seen():
    watch, found = watched(np.array([1.5, 0.0]))
    (before,) = found.cylinders
    (then,) = watch.update(1.7, Detections()).cylinders
    assert then[0] == pytest.approx(before[0] + 1.5 * 0.3, abs=0.15)
    assert not len(watch.update(2.1, Detections()).cylinders)


def test_reset_forgets():
    watch, _ = watched(np.array([1.5, 0.0]))
    watch.reset()
    assert watch.update(1.5, look(1.5, (6.25, 3.0))).broken == ()


def test_two_trunks_side_by_side_keep_their_own_radii():
    watch, velocity = ObstacleWatch(FORWARD), np.array([0.9, 0.0])
    for time in np.arange(0.0, 1.5, 0.1):
        one, other = (np.array([x, 3.0]) + time * velocity for x in (2.0, 5.0))
        both, second = look(time, one, radius=0.2), look(time, other, radius=0.7)
        both.trunks.extend(second.trunks)
        found = watch.update(time, both)
    radii = {round(float(row[0])): row[2] for row in found.cylinders}
    assert radii == {3: 0.2, 6: 0.7}


@pytest.mark.parametrize("axis", [3, 4])
def test_a_speed_within_its_doubt_along_either_axis_is_none(axis):
    """At 1 m/s, with the other axis exact: 3 σ of the mean of both variances."""
    for sigma, moves in ((0.46, True), (0.48, False)):
        covariance = np.zeros((6, 6))
        covariance[axis, axis] = sigma**2
        course = np.array([0.0, 1.0, 0.0])
        track = Track(1, np.zeros(3), course, covariance, age=1.0, unseen=0.0)
        assert obstacle_watch._moves(track) is moves
