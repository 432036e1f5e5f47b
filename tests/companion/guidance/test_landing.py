"""Landing: the look round at the goal, and the wait while a neighbour is below."""

import numpy as np
import pytest

from companion.guidance.gaze import Gaze, GazeConfig
from companion.guidance.landing import Landing
from companion.guidance.mission import Mission, MissionConfig
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
GOAL = [0.0, 0.0, 1.3]


def at(time):
    return VehicleState(time, np.array(GOAL), np.zeros(3), LEVEL, np.zeros(3))


def track(*p):
    return Track(1, np.array(p), np.zeros(3), np.eye(6), age=1.0, unseen=0.0)


def lands_at(config, seen_at, **keys):
    """Time [s] at which the drone lands; seen_at: the tracks known at a time."""
    look = GazeConfig(**keys)
    landing = Landing(MissionConfig(goals=[GOAL], **config), 0.5, turns=look.survey > 0.0)
    gaze = Gaze(look)
    mission = Mission(MissionConfig(goals=[GOAL]))
    assert mission.update(at(0.0)).complete
    for tick in range(300):
        time = tick / 10
        gaze.update(time, np.zeros(3), np.zeros(3), 0.0)
        # A look round at the goal does not begin the mission anew.
        assert mission.update(at(time), gaze.surveyed).goal == pytest.approx(GOAL)
        step = landing.update(at(time), seen_at(time), gaze.surveyed)
        if step.look_round:
            gaze.look_round()
        if step.land:
            return time
    return None


def no_tracks(time):
    return []


def test_without_a_wait_the_drone_lands_at_once():
    assert lands_at({}, lambda time: [track(0.1, 0.0, 0.6)]) == 0.0
    assert lands_at({"land": False, "land_wait": 10.0}, no_tracks) == 0.0


def test_the_drone_looks_once_all_round_before_it_lands():
    turn = 2 * np.pi / GazeConfig().slew
    assert lands_at({"land_wait": 10.0}, no_tracks) == pytest.approx(turn, abs=0.2)


@pytest.mark.parametrize(
    ("p", "waits"),
    [((0.3, 0.3, 0.6), True), ((0.3, 0.3, 1.5), False), ((0.4, 0.4, 0.6), False)],
)
def test_the_drone_waits_while_a_neighbour_is_below(p, waits):
    landed = lands_at({"land_wait": 20.0}, lambda time: [track(*p)] if time < 7.0 else [], survey=0)
    assert landed == (7.0 if waits else 0.0)


def test_the_wait_before_landing_ends():
    assert lands_at({"land_wait": 5.0}, lambda time: [track(0.0, 0.0, 0.6)]) == 5.0


def test_a_clock_that_begins_anew_ends_the_wait_before_landing():
    landing = Landing(MissionConfig(goals=[GOAL], land_wait=10.0), 0.5, turns=True)
    below = [track(0.0, 0.0, 0.6)]
    assert not landing.update(at(900.0), below, surveyed=True).land
    assert landing.update(at(1.0), below, surveyed=True).land
