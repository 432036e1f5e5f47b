"""Turns that the attitude shows and the gyro does not, and what turns with them."""

import numpy as np
import pytest

from companion.estimation.known_obstacles import ObstacleEstimator
from companion.estimation.obstacle_map import ObstacleConfig, ObstacleMap
from companion.estimation.parallax_map import ParallaxMap
from companion.estimation.surface_map import SurfaceConfig
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.estimation.turns import UnexplainedTurns
from companion.perception.config import CameraConfig
from companion.perception.parallax import FixedPoints
from companion.perception.view import View, load_camera
from companion.types import Detection, Trunk
from mavlink_bridge.shared.frames import integrate, multiply
from mavlink_bridge.wire.messages import Attitude, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def swaying(t):
    return np.array([0.4 * np.sin(3.0 * t), 0.5 * np.cos(2.0 * t), 1.2 * np.sin(1.5 * t)])


def told(heading, seconds=8.0):
    """Attitudes at 50 Hz of a drone that sways; heading(t): rad, by which their yaw is wrong."""
    q, attitudes = LEVEL, []
    for k in range(round(seconds * 50)):
        t = k / 50
        half = 0.5 * heading(t)
        wrong = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        attitudes.append(Attitude(t, multiply(wrong, q), swaying(t)))
        for part in range(10):
            q = integrate(q, swaying(t + part / 500), 1 / 500)
    return attitudes


def test_a_turn_of_the_estimate_about_the_vertical_is_found():
    attitudes = told(lambda t: np.radians(20.0) * (1.0 - np.exp(-max(t - 3.0, 0.0) / 2.0)))
    turns = UnexplainedTurns().update(attitudes)
    sums = np.cumsum([turn.up for turn in turns])
    assert np.abs(sums[:150]).max() < np.radians(0.5)
    assert sums[-1] == pytest.approx(np.radians(20.0) * (1.0 - np.exp(-2.5)), abs=np.radians(1.0))


def test_a_true_turn_is_none():
    turns = UnexplainedTurns().update(told(lambda t: 0.3))
    assert np.abs(np.cumsum([turn.off for turn in turns], axis=0)).max() < np.radians(1.0)


def test_rates_are_not_summed_up_over_a_gap():
    attitudes = told(lambda t: 0.0)
    reader = UnexplainedTurns()
    first = reader.update(attitudes[:50])
    later = reader.update(attitudes[100:103])
    assert [turn.follows for turn in first[:3]] == [False, True, True]
    assert [turn.follows for turn in later] == [False, True]
    assert later[0].time == attitudes[101].time


@pytest.mark.parametrize("sized", [False, True])
def test_what_is_remembered_turns_about_the_drone(sized):
    own = VehicleState(
        1.0, np.array([2.0, 1.0, 2.0]), np.array([1.0, 0.0, 0.0]), LEVEL, np.zeros(3)
    )
    trunks, points = ObstacleMap(ObstacleConfig(ghosts=1e-3)), ParallaxMap()
    trunks.update([Trunk(np.array([1.0, 0.0, 0.0]), 3.0, 0.3, 0.05)], own, LEVEL, 1.4)
    there = own.p + np.array([3.0, 0.0, 0.0])
    fixed = FixedPoints(there[None], np.array([0.05]), np.array([7]), np.ones(1), np.ones(1))
    points.update(fixed, own.p, 1.0)
    tracker = Tracker(TrackerConfig(size_sigma=0.3 if sized else 0.0))
    detection = Detection(np.array([1.0, 0.0, 0.0]), 3.0, 0.02, 0.1)
    tracker.update(1.0, [detection], own, LEVEL)
    (axis,), before = trunks.occluders()[:, :2], tracker.positions()[0]
    for each in (trunks, points, tracker):
        each.turn(own.p, np.pi / 2)
    east, north = axis - own.p[:2]
    assert trunks.occluders()[0, :2] == pytest.approx(own.p[:2] + np.array([-north, east]))
    east, north, up = before - own.p
    assert tracker.positions()[0] == pytest.approx(own.p + np.array([-north, east, up]))
    assert points._points[0, :3] == pytest.approx([2.0, 4.0, there[2]])


def test_the_turn_of_what_is_known_reaches_trunks_and_points(monkeypatch):
    turned = []
    for kind in (ObstacleMap, ParallaxMap):
        monkeypatch.setattr(kind, "turn", lambda self, p, angle: turned.append((type(self), angle)))
    view = View(load_camera(CameraConfig()), needs_foot=False)
    ObstacleEstimator(view, ObstacleConfig(), SurfaceConfig()).turn(np.zeros(3), 0.1)
    assert turned == [(ObstacleMap, 0.1), (ParallaxMap, 0.1)]
