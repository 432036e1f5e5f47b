"""The moves of a commissioning flight: small, about all axes, and over after half a minute."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.known_obstacles import KnownObstacles
from companion.guidance.commissioning import DURATION, Commissioning
from companion.guidance.guidance import Guidance
from companion.perception.camera_health import CameraFault
from companion.settings.config import CompanionConfig
from companion.types import Phase
from mavlink_bridge.shared.frames import quaternion_from_euler
from tests.companion.depth_images import state

OWN = state([3.0, -2.0, 2.5])
SOON = Delay(0.06, 0.003)
TIMES = np.arange(0.0, DURATION + 1.0, 0.1)


def test_the_moves_stay_near_and_end_where_they_began():
    moves = Commissioning()
    made = [moves.update(replace(OWN, time=100.0 + t)) for t in TIMES]
    offsets = np.array([m.goal for m in made]) - OWN.p
    assert np.abs(offsets).max() < 1.0
    assert (np.ptp(offsets, axis=0) > 0.6).all()
    np.testing.assert_allclose(offsets[-1], 0.0)
    assert [m.complete for m in made] == [t > DURATION for t in 100.0 + TIMES - 100.0]
    assert 25.0 < DURATION < 35.0
    yaws = np.array([moves.yaw(100.0 + t) for t in TIMES])
    assert np.ptp(yaws) > 1.4
    assert np.abs(np.diff(yaws)).max() < 0.2  # rad from tick to tick


def test_guidance_flies_the_moves_and_takes_no_other_goals():
    config = CompanionConfig.model_validate(
        {"mission": {"commission": True}, "log": {"path": "flight.mcap"}}
    )
    guidance = Guidance(config.guidance())
    guidance.set_goals([np.array([50.0, 0.0, 2.0])])
    known = KnownObstacles()
    for t in TIMES:
        own = replace(OWN, time=t)
        reference = guidance.decide(own, [], known, CameraFault.NONE, Phase.FLY, delay=SOON)
        assert np.linalg.norm(reference.target - OWN.p) < 1.4
        assert reference.speed_limit != "visibility"
    assert reference.land


@pytest.mark.parametrize("yaw", [0.0, 0.5, np.pi / 2, 2.5, np.pi, -1.2])
def test_each_move_goes_where_the_drone_looked_at_the_start(yaw):
    """Each of the twenty lasts 1.3 s and leads 0.8 m aside or 0.35 m up, or both."""
    moves, start = Commissioning(), state(OWN.p, quaternion_from_euler(0.0, 0.0, yaw), 50.0)
    forward = 0.8 * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    left = 0.8 * np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    up = np.array([0.0, 0.0, 0.35])
    there_and_back = [a for axis in (forward, left, up) for a in (axis, -axis, axis, -axis)]
    corner = forward + left + up
    other = forward - left + up
    oblique = [corner, -corner, other, -other]
    expected = [np.zeros(3), *there_and_back, *oblique, *oblique, np.zeros(3)]
    moves.update(start)
    for n, offset in enumerate(expected):
        for late in (0.01, 1.29):  # s since the last move began, which is before the start at first
            elsewhere = state([9.0, 9.0, 9.0], time=50.0 + 0.7 + 1.3 * n + late)
            made = moves.update(elsewhere)
            assert made.goal == pytest.approx(OWN.p + offset), n
            assert made.index == min(n, 20)
            assert not made.complete


def test_the_line_of_sight_swings_while_the_drone_moves():
    moves = Commissioning()
    assert moves.yaw(5.0) == 0.0  # it has not begun
    moves.update(state(OWN.p, quaternion_from_euler(0.0, 0.0, 0.4), 50.0))
    for since in (-3.0, 0.0, 1.9, 2.0):
        assert moves.yaw(50.0 + since) == pytest.approx(0.4)
    for since in (2.5, 10.0, 27.9):  # to and fro by 0.8 rad, 0.3 times a second
        swung = 0.4 + 0.8 * np.sin(0.6 * np.pi * (since - 2.0))
        assert moves.yaw(50.0 + since) == pytest.approx(swung)
    at_the_end = moves.yaw(78.0)
    assert moves.yaw(79.0) == moves.yaw(90.0) == pytest.approx(at_the_end)


def test_the_moves_are_over_after_half_a_minute():
    moves = Commissioning()
    moves.update(replace(OWN, time=50.0))
    assert not moves.update(replace(OWN, time=80.0)).complete
    assert moves.update(replace(OWN, time=80.1)).complete
    assert moves.update(replace(OWN, time=80.1)).index == 20
    assert not moves.update(replace(OWN, time=3.0)).complete  # a clock that begins anew
